"""Twins of finite-element models: the parameter group that changed is named and sized."""

import json

import numpy as np
import pytest

from slowtime_schemas.files.model_v2 import LineModelFile
from slowtime_services.matrices import describe_reduced
from slowtime_services.models import model_file_of
from tests.twin_server.towers import GROUPS, LOSS, epoch, full_model, tower
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.registration.twin import Registration


def test_the_group_that_lost_stiffness_is_named_and_sized(frame):
    made = frame(seed=4)
    model = full_model()
    registration = Registration(
        changes="elements",
        model=tower(),
        parameters=dict.fromkeys(GROUPS, 0.3),
        learn_epochs=8,
        alarms=[{"quantity": "upper legs", "below": -0.05}],
    )
    twin = Twin(registration, Checkpoint.start(registration))
    features = [epoch(made, model, i, LOSS if i >= 10 else (0.0,) * 3) for i in range(18)]
    found = estimate([twin], features, [0] * len(features), [0] * len(features))
    bodies = [json.loads(detail.body) for detail in found.details if detail is not None]
    table = np.array(
        [[body["elements"][name]["value"] for name in GROUPS] for body in bodies[10:]]
    )
    sds = np.array([[body["elements"][name]["sd"] for name in GROUPS] for body in bodies[10:]])
    # What is measured is the change since learning: 10 % of the group as the file has it.
    np.testing.assert_allclose(table.mean(axis=0), LOSS, atol=0.02)
    assert (np.abs(table - LOSS) < 4.0 * sds).all()
    changed = [n for n in found.notices[0] if n.kind == "element_changed"]
    assert [n.details["suspect"] for n in changed] == ["upper legs"]
    alarms = [n.details["quantity"] for n in found.notices[0] if n.kind == "alarm"]
    assert alarms == ["upper legs"]


def test_a_registered_frame_is_kept_as_its_reduced_model_and_stored_alike():
    registration = Registration(changes="elements", model=tower())
    assert isinstance(registration.model, LineModelFile)
    assert set(registration.structure().free) == {*GROUPS, "other parts"}
    assert Registration.from_json(registration.to_json()) == registration
    reduced = model_file_of(describe_reduced(full_model()).description)
    geometry = registration.model.geometry
    assert registration.model.model_copy(update={"geometry": None}) == reduced
    assert geometry is not None
    assert len(geometry.nodes) == 12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"matrices": {"stiffness": "/etc/K.mtx", "mass": "M.mtx"}}, "server cannot read"),
        (
            {"sensors": [{"channel": "e", "quantity": "strain", "row": "/etc/rows.npz"}]},
            "row",
        ),
        (
            {"sensors": [
                {"channel": "e", "quantity": "strain", "row": {"file": "/etc/rows.npz"}}
            ]},
            "Sensors e name rows of files",
        ),
        ({"sensors": [{"channel": "a", "node": "9", "direction": "ux"}]}, "Node '9', direct"),
        ({"sensors": []}, "No sensors"),
    ],
)  # fmt: skip
def test_what_the_server_cannot_read_or_reduce_is_refused_with_what_to_do(change, words):
    with pytest.raises(ValueError, match=words):
        Registration(changes="elements", model=tower() | change)


def test_a_frame_that_would_hold_up_the_server_is_reduced_elsewhere():
    values = tower()
    values["frame"]["nodes"] += [
        {"id": f"x{k}", "at": [0.0, 0.0, float(k)]} for k in range(500)
    ]
    with pytest.raises(ValueError, match=r"512 nodes. Allowed in a registration are 500"):
        Registration(changes="elements", model=values)

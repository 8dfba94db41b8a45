"""Twins of many elements: the one that changed is named and sized, and nothing else is."""

import itertools
import json
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime_schemas.messages import Mode
from slowtime_schemas.quantities import Quantity
from slowtime_services.models import model_file_of
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.history import states as rows
from twin_server.registration.twin import Registration

STOREYS = ("storey1", "storey2", "storey3")
LOSS = (0.0, -0.08, 0.0)


def begin(**registration):
    made = Registration(**registration)
    return Twin(made, Checkpoint.start(made))


def run(twin, features, cuts=()):
    """Estimate in pieces: states, bodies of details, the last twin, all notices."""
    bounds = [0, *sorted(cuts), len(features)]
    states, bodies, notices = [], [], []
    for first, last in itertools.pairwise(bounds):
        part = features[first:last]
        found = estimate([twin], part, [0] * len(part), [0] * len(part))
        written = Checkpoint.from_json(found.checkpoints[0].to_json())
        assert written.to_json() == found.checkpoints[0].to_json()
        twin = twin._replace(checkpoint=written)
        states.append(found.states)
        bodies += [detail.body for detail in found.details if detail is not None]
        notices += [n._replace(row=n.row + first) for n in found.notices[0]]
    return np.concatenate(states), bodies, twin, notices


def told(bodies):
    return [json.loads(body) for body in bodies]


def table(bodies, names=STOREYS):
    """Value, sd, lo and hi of each parameter at each epoch."""
    return np.array(
        [[list(body["elements"][name].values()) for name in names] for body in told(bodies)]
    )


@pytest.fixture(scope="module")
def weakened(frame):
    """60 epochs still, 20 of them learnt from; then 40 with the second storey weaker."""
    made = frame(seed=3)
    features = [made.epoch(i, LOSS if i >= 60 else (0.0,) * 3) for i in range(75)]
    twin = begin(**made.registration(alarms=[{"quantity": "elements", "below": -0.05}]))
    return features, run(twin, features)


@pytest.mark.long
def test_the_storey_that_lost_stiffness_is_named_and_sized(weakened):
    _, (states, bodies, _, notices) = weakened
    assert (states["reasons"][20:] == 0).all()
    changed = [n for n in notices if n.kind == "element_changed"]
    assert [(n.row, n.severity, n.details["suspect"]) for n in changed] == [
        (62, "warning", "storey2")
    ]
    assert changed[0].message.startswith("storey2 has lost ")
    assert changed[0].message.endswith(" % of its stiffness.")
    assert Counter(tuple(b["suspects"]) for b in told(bodies[60:])) == {("storey2",): 15}
    mean = table(bodies[60:])[:, :, 0].mean(axis=0)
    np.testing.assert_allclose(mean, LOSS, atol=0.006)
    alarms = [(n.row, n.details["quantity"]) for n in notices if n.kind == "alarm"]
    assert alarms == [(62, "storey2")]


@pytest.mark.long
def test_the_truth_a_simulator_knows_is_shown_and_not_looked_at(weakened, frame):
    features, (_, bodies, _, _) = weakened
    assert told(bodies)[70]["truth"] == dict(zip(STOREYS, LOSS, strict=True))
    blind = [message.model_copy(update={"truth": None}) for message in features]
    _, again, _, _ = run(begin(**frame().registration()), blind)
    for one, other in zip(told(bodies), told(again), strict=True):
        assert other.pop("truth") is None
        one.pop("truth")
        assert one == other


def test_an_error_of_the_model_is_not_called_a_change(weakened):
    _, (_, bodies, twin, notices) = weakened
    assert [n.kind for n in notices if n.row < 60] == ["nominal_learnt"]
    assert not any(body["suspects"] for body in told(bodies[:60]))
    moved = np.exp(twin.checkpoint.elements.theta[:3])
    np.testing.assert_allclose(moved, [1.05, 0.95, 1.05], atol=0.02)


@pytest.mark.parametrize(
    ("seeds", "lowest", "highest"),
    [(1, 0.86, 1.0), pytest.param(12, 0.94, 0.98, marks=pytest.mark.slow)],
)
def test_intervals_hold_the_truth_as_often_as_they_say(frame, seeds, lowest, highest):
    held = []
    for seed in range(seeds):
        made = frame(seed=seed, frequency_sd=0.002, shape_sd=0.01)
        rng = np.random.default_rng(seed)
        truth = [(0.0,) * 3] * 20 + [tuple(rng.uniform(-0.15, 0.05, 3)) for _ in range(30)]
        features = [made.epoch(i, changes) for i, changes in enumerate(truth)]
        _, bodies, _, _ = run(begin(**made.registration()), features)
        numbers, true = table(bodies[20:]), np.array(truth[20:])
        held.append((numbers[..., 2] <= true) & (true <= numbers[..., 3]))
    assert lowest < np.mean(held) < highest


@pytest.mark.long
@settings(max_examples=2, deadline=None)
@given(cuts=st.sets(st.integers(1, 22), max_size=6))
def test_cutting_the_stream_anywhere_changes_no_bit(frame, cuts):
    made = frame(seed=5)
    features = [made.epoch(i, LOSS if i >= 19 else (0.0,) * 3) for i in range(23)]
    twin = begin(**made.registration(learn_epochs=8))
    whole, bodies, last, notices = run(twin, features)
    cut, cut_bodies, cut_last, cut_notices = run(twin, features, cuts)
    assert cut.tobytes() == whole.tobytes()
    assert cut_bodies == bodies
    assert cut_last.checkpoint.to_json() == last.checkpoint.to_json()
    assert cut_notices == notices


def test_twins_of_elements_and_of_one_mode_are_estimated_as_if_alone(frame, ageing):
    made = frame(seed=6)
    frames = [made.epoch(i) for i in range(25)]
    beams = ageing(25)
    twins = [begin(learn_epochs=5), begin(**made.registration())]
    mixed = [message for pair in zip(beams, frames, strict=True) for message in pair]
    found = estimate(twins, mixed, [0, 1] * 25, list(range(50)))
    alone = estimate([twins[0]], beams, [0] * 25, list(range(0, 50, 2)))
    frame_alone = estimate([twins[1]], frames, [0] * 25, list(range(1, 50, 2)))
    assert found.states[::2].tobytes() == alone.states.tobytes()
    assert found.states[1::2].tobytes() == frame_alone.states.tobytes()
    assert found.details[::2] == [None] * 25
    assert found.details[1::2] == frame_alone.details
    assert [n.row for n in found.notices[0]] == [2 * n.row for n in alone.notices[0]]
    assert [n.row for n in found.notices[1]] == [2 * n.row + 1 for n in frame_alone.notices[0]]


def test_an_edge_that_starts_again_and_renames_its_modes_changes_nothing(frame):
    plain, renamed = frame(seed=7), frame(seed=7)
    names = {1: 7, 2: 1, 3: None}
    still = [plain.epoch(i) for i in range(30)]
    other = []
    for i in range(30):
        message = renamed.epoch(i, boot="b1" if i < 25 else "b2")
        modes = tuple(
            m.model_copy(update={"identity": names[m.identity] if i >= 25 else m.identity})
            for m in message.modes
        )
        other.append(message.model_copy(update={"modes": modes}))
    first = told(run(begin(**plain.registration()), still)[1])
    second = told(run(begin(**plain.registration()), other)[1])
    assert [b["elements"] for b in first] == [b["elements"] for b in second]


def test_a_machine_s_line_and_a_mode_that_is_missing_do_no_harm(frame):
    made = frame(seed=8)
    features = []
    for i in range(42):
        message = made.epoch(i, LOSS if i >= 35 else (0.0,) * 3)
        line = made.mode(4.0, np.array([1.0, 0.2, 0.1]), kind="harmonic")
        modes = [m for m in message.modes if not (m.identity == 2 and i % 4 == 3)]
        features.append(made.message(i, [*modes, line]))
    states, bodies, _, notices = run(begin(**made.registration()), features)
    assert (states["reasons"][20:] == 0).all()
    assert [n.details["suspect"] for n in notices if n.kind == "element_changed"] == ["storey2"]
    numbers = [mode["model_mode"] for mode in told(bodies)[40]["modes"]]
    assert numbers == [0, None, 1, 2]
    wider = table(bodies[23:24])[0, :, 1].sum() / table(bodies[24:25])[0, :, 1].sum()
    assert wider > 1.02


def symmetric(shapes):
    """Example 3.3: equal masses and springs, seen by frequencies alone or by shapes too."""
    springs = [1e6, 1e6, 1e6, 1e6]
    built = chain([1000.0] * 3, springs)

    def epoch(make, i, factor):
        modes = undamped_modes(assemble(chain([1000.0] * 3, [1e6 * factor, *springs[1:]])))
        found = []
        for j, f in enumerate(modes.frequency_hz.tolist()):
            mode = make.mode(f, modes.shapes[:, j], identity=j)
            found.append(mode if shapes else mode.model_copy(update={"shape": None}))
        return make.message(i, found, channels=("a_m1", "a_m2", "a_m3"))

    return model_file_of(built).model_dump(mode="json"), epoch


@pytest.mark.long
@pytest.mark.parametrize(("shapes", "word"), [(False, "k1 or k4"), (True, "k1")])
def test_what_cannot_be_told_is_said_and_not_guessed(frame, shapes, word):
    model, epoch = symmetric(shapes)
    make = frame(frequency_sd=5e-4)
    features = [epoch(make, i, 0.9 if i >= 20 else 1.0) for i in range(30)]
    registration = {"changes": "elements", "model": model, "parameters": None}
    _, bodies, _, notices = run(begin(**registration), features)
    changed = [n for n in notices if n.kind == "element_changed"]
    assert [n.details["suspect"] for n in changed] == [word]
    assert told(bodies)[-1]["suspects"] == [word]
    if not shapes:
        assert changed[0].message.startswith("k1 or k4 has changed; the readings do not")
        assert changed[0].message.count("has lost") == 2
        ratio = told(bodies)[-1]["posterior_to_prior"]
        assert min(ratio["k1"], ratio["k4"]) > 3 * min(ratio["k2"], ratio["k3"], 0.03)


def test_a_mass_that_may_change_is_told_from_stiffness_by_shapes(frame):
    made = frame(seed=9, shape_sd=0.002, frequency_sd=5e-4)
    heavy = [made.epoch(i) for i in range(20)]
    heavy += [made.epoch(i, masses=(0.0, 0.0, 0.1)) for i in range(20, 26)]
    free = dict.fromkeys(STOREYS, 0.1) | {"floor3.mass": 0.1}
    _, bodies, _, notices = run(begin(**made.registration(parameters=free)), heavy)
    last = told(bodies)[-1]
    assert last["elements"].keys() == {*STOREYS, "floor3.mass"}
    assert last["elements"]["floor3.mass"]["value"] == pytest.approx(0.1, abs=0.03)
    assert last["truth"]["floor3.mass"] == 0.1
    changed = [n for n in notices if n.kind == "element_changed"]
    assert changed[0].message.startswith("floor3 has gained ")
    assert changed[0].message.endswith(" % of its mass.")


def _heard_otherwise(mode):
    """The same motion in mm/s^2, m/s and cm; an acceleration is (i w)^2 x."""
    w = 2 * np.pi * mode.frequency_hz.value
    factor = np.array([1e3, 1.0 / (1j * w), 1e2 / (1j * w) ** 2])
    shape = (np.array(mode.shape.re) + 1j * np.array(mode.shape.im)) * factor
    norm = np.linalg.norm(shape)
    sd = np.array(mode.shape.sd) * np.abs(factor) / norm
    largest = shape[np.argmax(np.abs(shape))]
    shape = shape * largest.conjugate() / abs(largest) / norm
    parts = {"re": tuple(shape.real), "im": tuple(shape.imag), "sd": tuple(sd)}
    return mode.model_copy(update={"shape": mode.shape.model_copy(update=parts)})


def test_sensors_of_other_quantities_and_units_tell_the_same(frame):
    made = frame(seed=10)
    plain = [made.epoch(i, LOSS) for i in range(25)]
    model = json.loads(json.dumps(made.model))
    units = [("acceleration", "mm/s^2"), ("velocity", "m/s"), ("displacement", "cm")]
    for sensor, (quantity, unit) in zip(model["sensors"], units, strict=True):
        sensor["quantity"], sensor["unit"] = quantity, unit

    other = [
        m.model_copy(update={"modes": tuple(map(_heard_otherwise, m.modes))}) for m in plain
    ]
    one = table(run(begin(**made.registration()), plain)[1][20:])
    two = table(run(begin(changes="elements", model=model), other)[1][20:])
    np.testing.assert_allclose(one, two, atol=1e-9)


def test_while_learning_there_is_no_change_and_a_reason(frame):
    made = frame()
    states, bodies, twin, notices = run(
        begin(**made.registration()), [made.epoch(i) for i in range(22)]
    )
    assert (states["reasons"][:20] == rows.LEARNING).all()
    assert told(bodies)[0]["elements"] == {}
    assert len(told(bodies)[0]["modes"]) == 3
    assert [(n.kind, n.row) for n in notices] == [("nominal_learnt", 19)]
    assert notices[0].message.startswith(
        "The structure has been learnt from 3 of its modes: 2."
    )
    first = states["frequency_hz"][:, 0]
    assert np.isfinite(first).all()
    assert first.max() < 3.0
    nominal = twin.checkpoint.nominal()
    assert nominal["frequency_hz"] == pytest.approx(first.mean(), rel=1e-3)


def test_modes_that_are_none_of_the_model_s_are_refused_in_words(frame):
    made = frame()
    alien = [made.message(i, [made.mode(77.0, np.array([1.0, 1.0, 1.0]))]) for i in range(20)]
    states, _, twin, notices = run(begin(**made.registration()), alien)
    assert [n.kind for n in notices] == ["nominal_not_learnt"]
    assert "Compare the frequencies and sensor channels of the model" in notices[0].message
    assert (states["reasons"] == rows.LEARNING).all()
    learnt = [made.epoch(i) for i in range(20, 40)]
    states, _, _, _ = run(twin, [*learnt, alien[0], made.message(41, [])])
    assert states["reasons"][-2:].tolist() == [rows.NO_MODEL_MODE, rows.NO_MODE]


def test_what_no_free_parameter_explains_is_not_valid(frame):
    made = frame(seed=11)
    fixed = made.registration(parameters={"storey1": 0.3})
    features = [made.epoch(i, (0.0, -0.3, 0.1) if i >= 20 else (0.0,) * 3) for i in range(24)]
    states, _, _, _ = run(begin(**fixed), features)
    assert (states["reasons"][20:] & rows.MODEL_MISFIT > 0).all()
    assert "let more elements and masses be free" in rows.sentences(rows.MODEL_MISFIT)[0]


def test_a_change_that_goes_away_is_said_to_have_gone(frame):
    made = frame(seed=12)
    features = [made.epoch(i, LOSS if 20 <= i < 30 else (0.0,) * 3) for i in range(40)]
    _, _, _, notices = run(begin(**made.registration()), features)
    changes = [(n.kind, n.severity, n.row) for n in notices if n.kind.startswith("element")]
    assert changes == [("element_changed", "warning", 22), ("element_restored", "info", 32)]


@settings(max_examples=20, deadline=None)
@given(
    value=st.floats(5e-324, 1.7e308),
    sd=st.floats(0, 1.7e308),
    damping=st.floats(-1e308, 1.7e308),
    shape_sd=st.floats(0, 1e300),
    learns=st.booleans(),
)
def test_no_number_that_a_message_may_hold_fails_or_leaves_the_finite(
    frame, value, sd, damping, shape_sd, learns
):
    made = frame()
    good = [made.epoch(i) for i in range(0 if learns else 2)]
    template = made.mode(2.4, np.array([0.3, 0.7, 1.0]))
    wild = Mode(
        frequency_hz=Quantity(value=value, sd=sd),
        damping_ratio=Quantity(value=damping, sd=sd),
        shape=template.shape.model_copy(update={"sd": (shape_sd,) * 3}),
    )
    features = [*good, *(made.message(i, [wild]) for i in range(2, 6))]
    states, bodies, _, _ = run(begin(**made.registration(learn_epochs=2)), features)
    assert not np.isinf(states["frequency_hz"]).any()
    assert not np.isinf(states["damping_ratio"]).any()
    for body in bodies:
        assert b"NaN" not in body
        assert b"Infinity" not in body
        json.loads(body)


def test_readings_that_scatter_more_than_they_say_are_believed_less(frame):
    made = frame(seed=13)
    boastful = []
    for i in range(60):
        message = made.epoch(i)
        modes = [
            mode.model_copy(
                update={
                    "frequency_hz": mode.frequency_hz.model_copy(
                        update={"sd": mode.frequency_hz.sd / 4}
                    ),
                    "shape": mode.shape.model_copy(update={"sd": (made.shape_sd / 4,) * 3}),
                }
            )
            for mode in message.modes
        ]
        boastful.append(made.message(i, modes))
    _, bodies, twin, notices = run(begin(**made.registration()), boastful)
    for baseline in twin.checkpoint.elements.baselines:
        assert 2.0 < baseline.scatter < 7.0
        assert 2.5 < baseline.shape_scatter < 5.5
    assert [n.kind for n in notices] == ["nominal_learnt"]
    numbers = table(bodies[20:])
    assert np.mean((numbers[..., 2] <= 0) & (numbers[..., 3] >= 0)) > 0.85

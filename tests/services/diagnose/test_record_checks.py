"""Models and records that are refused before a diagnosis."""

import pytest

from slowtime.dynamics.description import (
    Description,
    Input,
    Node,
    Sensor,
    Spring,
    Support,
    Tolerance,
)
from slowtime_services.diagnose.record_checks import refuse_large_models
from slowtime_services.files import RecordError


@pytest.mark.parametrize(("masses", "tolerance", "refused"), [
    (200, 0.01, True), (200, 0.0, False), (60, 0.01, False),
])  # fmt: skip
@pytest.mark.parametrize("reducible", [True, False])
def test_a_model_that_takes_more_memory_than_machines_have_is_refused_with_the_cure(
    masses, tolerance, refused, reducible
):
    model = Description(
        name="chain",
        nodes=tuple(Node(id=f"f{k}", mass_kg=50.0) for k in range(1, masses + 1)),
        elements=tuple(
            Spring(
                id=f"s{k}", between=("base" if k == 1 else f"f{k - 1}", f"f{k}"),
                stiffness_n_per_m=4e6, damping_n_s_per_m=400.0,
            )
            for k in range(1, masses + 1)
        ),
        inputs=(Input(channel="u", kind="force", node="f1", unit="N", hold="first"),),
        sensors=(Sensor(channel="a", quantity="acceleration", node="f1", unit="m/s^2"),),
        supports=() if reducible else (Support(id="wall"),),
        tolerance=Tolerance(stiffness=tolerance, damping=tolerance, mass=0.0),
    )  # fmt: skip
    if refused and not reducible:
        with pytest.raises(
            RecordError, match=r"about 19 GB .* beside the base .* `slowtime model reduce`"
        ):
            refuse_large_models(model)
    else:
        refuse_large_models(model)

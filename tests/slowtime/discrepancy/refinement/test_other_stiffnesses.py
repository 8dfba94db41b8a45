"""Stiffnesses of lightly damped structures are found though their claim is out of step."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.constant_release import refit_from_other_stiffnesses
from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring, Tolerance
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered

KINDS = catalogue()
RATE, MASS, SAMPLES = 128.0, 5.0, 1024
STOREYS = np.array([34e3, 43e3, 38e3])
CLAIMED = 40e3
DAMPING = 3.0


def frame(claimed):
    """Three storeys of one claimed stiffness, struck at the top."""
    names = ("base", "floor1", "floor2", "floor3")
    return Description(
        name="frame",
        nodes=tuple(Node(id=name, mass_kg=MASS) for name in names[1:]),
        elements=tuple(
            Spring(
                id=f"storey{i + 1}", between=(names[i], names[i + 1]),
                stiffness_n_per_m=claimed, damping_n_s_per_m=1.5 * DAMPING,
            )
            for i in range(3)
        ),
        inputs=(Input(channel="f", kind="force", node="floor3", unit="N"),),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"floor{i}", unit="m/s^2")
            for i in (1, 2, 3)
        ),
        tolerance=Tolerance(stiffness=0.3, damping=1.0, mass=0.05),
    )  # fmt: skip


def struck(seed):
    """Accelerations after a pulse held for one sample, by the exponential of the matrix."""

    def chain(values):
        return (
            np.diag(values + np.append(values[1:], 0))
            - np.diag(values[1:], 1)
            - np.diag(values[1:], -1)
        )

    inner = -np.hstack([chain(STOREYS), chain(np.full(3, DAMPING))]) / MASS
    a = np.vstack([np.hstack([np.zeros((3, 3)), np.eye(3)]), inner])
    b = np.array([0, 0, 0, 0, 0, 1 / MASS])
    both = np.zeros((7, 7))
    both[:6, :6], both[:6, 6] = a / RATE, b / RATE
    step = scipy.linalg.expm(both)
    force = np.zeros(SAMPLES)
    force[16] = 100.0
    x, outputs = np.zeros(6), np.empty((SAMPLES, 3))
    for number, push in enumerate(force):
        outputs[number] = (a @ x + b * push)[3:]
        x = step[:6, :6] @ x + step[:6, 6] * push
    noise = 1e-3 * outputs.std(axis=0)
    outputs += noise * np.random.default_rng(seed).standard_normal(outputs.shape)
    return Trial(inputs=force[:, None], outputs=outputs, rate_hz=RATE)


@pytest.fixture(scope="module")
def fits():
    trials, found = (struck(1),), {}
    for share in (0.6, 0.7, 0.95, 1.3, 1.5, 1.7):
        model = frame(share * CLAIMED)
        model = dataclasses.replace(
            model, inputs=(dataclasses.replace(model.inputs[0], hold="zero"),)
        )
        first = refit(Plant.of(model, kinds=KINDS), trials)
        with metered() as meter:
            found[share] = first, refit_from_other_stiffnesses(first, trials)
        assert meter.spent == 0, "it takes from the budget of the search"
    return found


def test_stiffnesses_are_found_whatever_was_claimed_within_tolerance(fits):
    for first, found in fits.values():
        assert found.chi2_in_band < 1.5
        by_name = dict(zip(found.plant.parameters, found.values, strict=True))
        told = [by_name["stiffness", f"storey{i}"] for i in (1, 2, 3)]
        assert told == pytest.approx(STOREYS, rel=0.01)
        assert found.chi2_in_band <= 1.01 * first.chi2_in_band


def test_claims_that_are_far_off_lead_a_refit_astray(fits):
    """So that the other values are what found them."""
    assert sum(first.chi2_in_band > 100 for first, _ in fits.values()) >= 2


def test_a_fit_in_step_stays_as_it_is(fits):
    first, found = fits[0.95]
    assert found is first

"""Virtual sensors: intervals that hold, streams cut anywhere, reasons and refusals."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from slowtime.dynamics.description import Tolerance, assemble
from slowtime.estimation.virtual import (
    VirtualSensor,
    VirtualSettings,
    displacement,
    drift,
    element_force,
    moment,
)
from slowtime.estimation.virtual.filters import _steady
from slowtime.estimation.virtual.levels import Groups, fit_levels
from slowtime.estimation.virtual.tolerances import members_of
from tests.slowtime.estimation.virtual.simulated import (
    LOADS,
    RATE_HZ,
    estimated,
    frame,
    held,
    truth,
)


@pytest.mark.parametrize("load", ["white", pytest.param("wind", marks=pytest.mark.long)])
def test_intervals_hold_and_are_worth_having(load):
    found = np.array([held(load, seed, seconds=60) for seed in range(1)])
    coverage, error, _ = found.mean(axis=0)
    assert (coverage > 0.85).all()
    assert (error < 0.5).all()


@pytest.mark.slow
@pytest.mark.parametrize("load", LOADS)
def test_intervals_hold_over_many_models_within_the_tolerance(load):
    coverage = np.mean([held(load, seed)[0] for seed in range(25)], axis=0)
    assert (coverage > 0.90).all()


def test_cutting_the_stream_anywhere_changes_nothing():
    description = frame()
    samples, _ = truth(description, "white", 3, 50)
    settings = VirtualSettings(members=4, window_s=10.0)
    sensor, whole = estimated(description, samples, settings)
    state, parts = sensor.start(), []
    for part in np.split(samples, [1, 700, 701, 1984, 3003]):
        state, windows = sensor.step(state, part)
        parts += windows
    parts += sensor.finish(state)[1]
    assert len(parts) == len(whole)
    for one, other in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.sd, other.sd)


def test_deviations_grow_with_noise_and_with_tolerance():
    sizes = {}
    for name, tolerance, noise in (
        ("exact", (0.0, 0.0, 0.0), 3e-3),
        ("noisy", (0.0, 0.0, 0.0), 1e-1),
        ("loose", (0.2, 0.3, 0.05), 3e-3),
    ):
        samples, _ = truth(frame((0.0, 0.0, 0.0)), "white", 5, 40, noise=noise)
        windows = estimated(frame(tolerance), samples)[1]
        sizes[name] = windows[0].sd[-500:].mean(axis=0)
    assert (sizes["noisy"] > 1.1 * sizes["exact"]).all()
    assert (sizes["loose"] > sizes["exact"]).all()


def test_the_gain_is_that_of_the_riccati_equation():
    rng = np.random.default_rng(0)
    transition = 0.95 * np.linalg.qr(rng.standard_normal((6, 6)))[0]
    process = np.diag(rng.uniform(0.1, 1.0, 6))
    sensing, noise = rng.standard_normal((2, 6)), np.diag([0.3, 0.1])
    predicted = scipy.linalg.solve_discrete_are(transition.T, sensing.T, process, noise)
    gain = predicted @ sensing.T @ np.linalg.inv(sensing @ predicted @ sensing.T + noise)
    ours, after = _steady(transition, process, sensing, noise)
    np.testing.assert_allclose(ours, gain, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(
        after, predicted - gain @ sensing @ predicted, rtol=1e-8, atol=1e-10
    )


def test_covariances_of_forces_are_recovered():
    rng = np.random.default_rng(1)
    groups = Groups.of(4000, 100.0, 1.0, 40.0)
    count = len(groups.sizes)
    given = rng.standard_normal((2, count, 2, 2)) + 1j * rng.standard_normal((2, count, 2, 2))
    shape, share = np.array([[4.0, 1.0], [1.0, 0.5]]), np.array([0.3, 1.0])
    each = given @ shape @ given.conj().transpose(0, 1, 3, 2)
    density = np.tensordot(share, each, 1) + np.eye(2) * 0.02 * 2 / 100.0
    found = fit_levels(density, given, groups.sizes, np.full(2, np.nan), 100.0, iterations=800)
    wanted = share[:, None, None] * shape
    np.testing.assert_allclose(found.forces, wanted, atol=0.02)
    assert found.misfit == pytest.approx(1.0, abs=1e-3)


def test_a_design_spreads_a_linear_result_by_its_variance():
    description = frame((0.01, 0.0, 0.0))
    members = members_of(description, 32)
    rows = [sum(1 / e.stiffness()[0, 0] for e in m.elements[:5]) for m in members]
    relative = np.std(rows, ddof=0) / np.mean(rows)
    # Common and own parts of five equal springs in series.
    assert relative == pytest.approx(0.01 * np.sqrt(0.5 + 0.5 / 5), rel=0.1)
    assert members_of(dataclasses.replace(description, tolerance=Tolerance()), 16) == (
        dataclasses.replace(description, tolerance=Tolerance()),
    )


def test_outputs_are_those_of_statics():
    description = frame()
    structure = assemble(description)
    moved = np.linalg.solve(structure.stiffness, np.eye(5)[-1])  # 1 N at the top
    assert element_force("k1").row(description) @ moved == pytest.approx(1.0)
    assert element_force("k3").row(description) @ moved == pytest.approx(1.0)
    assert drift("base", "f1").row(description) @ moved == pytest.approx(1 / 4e7)
    assert displacement("f5").row(description) @ moved == pytest.approx(5 / 4e7)


def test_a_mode_that_no_sensor_sees_is_a_reason():
    # The middle of three equal masses between equal springs stands still in the second mode.
    description = frame(heard=(2,), floors=3)
    ends = dataclasses.replace(
        description,
        elements=(
            *description.elements,
            dataclasses.replace(description.elements[0], id="k4", between=("f3", "base")),
        ),
    )
    sensor = VirtualSensor(ends, ["a2"], [drift("f1", "f2")], 100.0)
    assert sensor.unseen == (1,)
    rng = np.random.default_rng(0)
    _, windows = sensor.step(sensor.start(), rng.standard_normal((sensor.window, 1)))
    assert "unseen_mode_2" in windows[0].reasons


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda d: drift("f1", "f9").row(d), r"no node 'f9'. Allowed: base, f1"),
        (lambda d: element_force("k9").row(d), r"no element 'k9'. Allowed: k1"),
        (lambda d: moment("k1").row(d), "is not a beam. Ask for the moment of a beam"),
        (lambda d: VirtualSensor(d, ["b"], [drift("base", "f1")], 100.0), "no sensor on"),
        (lambda d: VirtualSensor(d, ["a1"], [drift("base", "f1")], 3.0), "Sample faster"),
        (lambda d: VirtualSensor(d, ["a1"], [], 100.0), "at least one output"),
        (lambda d: VirtualSettings(members=3), "not a power of 2"),
    ],
)  # fmt: skip
def test_what_cannot_be_says_why(make, says):
    with pytest.raises(ValueError, match=says):
        make(frame())


def test_dead_channels_give_zero_with_a_deviation_and_no_fault():
    sensor = VirtualSensor(frame(), ["a1", "a3"], [drift("base", "f1")], float(RATE_HZ))
    _, windows = sensor.step(sensor.start(), np.zeros((sensor.window, 2)))
    assert (windows[0].values == 0).all()
    assert np.isfinite(windows[0].sd).all()


def test_missing_samples_are_refused():
    sensor = VirtualSensor(frame(), ["a1"], [drift("base", "f1")], float(RATE_HZ))
    with pytest.raises(ValueError, match="Bridge short gaps"):
        sensor.step(sensor.start(), np.full((10, 1), np.nan))

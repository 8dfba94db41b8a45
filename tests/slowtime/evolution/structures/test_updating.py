"""Updating of sparse and reduced models; placement of sensors."""

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import least_squares

from slowtime.evolution.structures import (
    MeasuredModes,
    ModePrecision,
    ParametricStructure,
    PlacementProblem,
    ReducedStructure,
    SparseStructure,
    estimate,
    identifiability_limits,
    place_sensors,
)
from slowtime.evolution.structures.fit import total_misfit
from slowtime.evolution.structures.measured_modes import mode_misfit
from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime.finite_elements.reduction import BasisSettings, project, reduce_modal
from tests.slowtime.finite_elements.frames import small_tower


def chain(number):
    """Unit masses in a row from a support, as sparse and as dense parts."""
    parts = np.zeros((number, number, number))
    for e in range(number):
        parts[e, e, e] = number**2
        if e:
            parts[e, e - 1, e - 1] = number**2
            parts[e, e - 1, e] = parts[e, e, e - 1] = -(number**2)
    names = tuple(f"spring {e + 1}" for e in range(number))
    light = SparseStructure(
        matrices=ParametricMatrices(
            stiffness=sparse.csr_array(parts.sum(axis=0)),
            mass=sparse.csr_array(np.eye(number)),
            names=names,
            stiffness_parts=tuple(sparse.csr_array(part) for part in parts),
        )
    )
    dense = ParametricStructure(
        mass=np.eye(number),
        stiffness=parts.sum(axis=0),
        stiffness_parts=parts,
        element_names=names,
    )
    return light, dense


def measured(structure, sensors, theta, modes, seed, shape_sd=0.01, frequency_sd=1e-3):
    random = np.random.default_rng(seed)
    true = structure.sensed_modes(theta, sensors, modes)
    shapes = true.sensed[:, :modes].T
    sd = shape_sd * np.abs(shapes).max(axis=1, keepdims=True) * np.ones(shapes.shape)
    frequency = true.frequency_hz[:modes]
    return MeasuredModes(
        frequency_hz=frequency * (1 + frequency_sd * random.standard_normal(modes)),
        frequency_sd_hz=frequency_sd * frequency,
        shapes=shapes + sd * random.standard_normal(shapes.shape),
        shape_sd=sd,
        channels=sensors,
    )


def test_sparse_and_dense_structures_give_one_posterior():
    light, dense = chain(20)
    sensors = np.eye(20)[[2, 7, 11, 15, 19]]
    theta = np.zeros(20)
    theta[6] = np.log(0.8)
    data = measured(light, sensors, theta, 6, seed=1)
    one, other = estimate(light, data, 0.1, starts=2), estimate(dense, data, 0.1, starts=2)
    np.testing.assert_allclose(one.theta, other.theta, atol=1e-4)
    np.testing.assert_allclose(one.sd, other.sd, rtol=1e-4)


def test_a_large_structure_is_solved_by_its_sparse_twin():
    light, dense = chain(70)
    sensors = np.eye(70)[[10, 40, 69]]
    theta = 0.1 * np.random.default_rng(3).standard_normal(70)
    one, other = light.sensed_modes(theta, sensors, 5), dense.sensed_modes(theta, sensors, 5)
    np.testing.assert_allclose(one.log_frequency_slope, other.log_frequency_slope, atol=1e-9)
    exact = dense.modes(theta)
    np.testing.assert_allclose(other.frequency_hz[:5], exact.frequency_hz[:5], rtol=1e-9)
    slope = np.tensordot(sensors, exact.shape_slope[:, :5], 1)
    sign = np.sign(np.sum(other.sensed * (sensors @ exact.shape[:, :5]), axis=0))
    np.testing.assert_allclose(
        other.sensed_slope * sign[:, None], slope, atol=1e-3 * np.abs(slope).max()
    )


def test_forty_parameters_are_those_of_scipys_least_squares():
    light, _ = chain(40)
    sensors = np.eye(40)[np.linspace(2, 39, 10).round().astype(int)]
    theta = 0.1 * np.random.default_rng(0).standard_normal(40)
    data = measured(light, sensors, theta, 8, seed=2)
    found, prior = estimate(light, data, 0.1, starts=0), np.full(40, 0.1)

    def residual(white):
        here = total_misfit(light, (data,), prior * white, prior)
        return np.concatenate([here.residual, -white])

    def slope(white):
        here = total_misfit(light, (data,), prior * white, prior)
        return -np.vstack([here.slope * prior, np.eye(40)])

    peer = least_squares(residual, np.zeros(40), jac=slope, xtol=1e-12, ftol=1e-12)
    jac = np.asarray(peer.jac, dtype=float)
    sd = prior * np.sqrt(np.diag(np.linalg.inv(jac.T @ jac)))
    assert np.abs(found.theta - prior * peer.x).max() < 0.02 * sd.min()
    np.testing.assert_allclose(found.sd, sd, rtol=1e-3)


def test_more_parameters_than_data_leave_the_prior_where_nothing_is_told():
    light, _ = chain(60)
    frequency = light.sensed_modes(np.zeros(60), np.zeros((0, 60)), 3).frequency_hz[:3]
    data = MeasuredModes(frequency_hz=frequency, frequency_sd_hz=1e-3 * frequency)
    found = estimate(light, data, 0.1, starts=0)
    # Three numbers lower the trace of the posterior, in prior variances, by at most three.
    assert 57.0 <= np.sum(found.ratio**2) < 58.0
    assert identifiability_limits(chain(6)[0], estimate(chain(6)[0], data, 0.1, starts=0))


@pytest.fixture(scope="module")
def tower():
    frame = small_tower(6)
    return frame, assemble(frame)


def test_a_reduced_tower_is_updated_as_the_full_one(tower):
    _, model = tower
    reduced = ReducedStructure(model=reduce_modal(model, BasisSettings(modes=10), trials=0))
    full = SparseStructure(matrices=model)
    rows = [("6.0", "ux"), ("6.1", "uy"), ("4.2", "ux"), ("3.3", "uy"), ("2.0", "ux")]
    sensors = np.array([model.dofs.row(n, {d: 1.0}) for n, d in rows])
    theta = np.log([1.0, 0.9, 1.0, 1.0, 1.1, 1.0])
    data = measured(full, sensors, theta, 6, seed=5)
    one, other = estimate(full, data, 0.1, starts=0), estimate(reduced, data, 0.1, starts=0)
    np.testing.assert_allclose(one.theta, other.theta, atol=0.05 * one.sd.min())
    np.testing.assert_allclose(one.sd, other.sd, rtol=0.02)


def test_close_modes_are_compared_as_subspaces(tower):
    _, model = tower
    reduced = ReducedStructure(model=reduce_modal(model, BasisSettings(modes=10), trials=0))
    rows = [("6.0", "ux"), ("6.0", "uy"), ("3.0", "ux"), ("3.0", "uy"), ("2.1", "ux")]
    sensors = np.array([model.dofs.row(n, {d: 1.0}) for n, d in rows])
    modes = reduced.sensed_modes(np.zeros(6), sensors, 4)
    assert modes.frequency_hz[1] / modes.frequency_hz[0] < 1.001
    shapes = modes.sensed[:, :2]
    turned = shapes @ np.array([[0.6, -0.8], [0.8, 0.6]])
    data = MeasuredModes(
        frequency_hz=modes.frequency_hz[:2],
        frequency_sd_hz=1e-3 * modes.frequency_hz[:2],
        shapes=turned.T,
        shape_sd=np.full((2, 5), 0.01 * np.abs(shapes).max()),
        channels=sensors,
    )
    here = total_misfit(reduced, (data,), np.zeros(6), np.full(6, 0.1))
    assert np.abs(here.residual).max() < 1e-6
    assert np.isfinite(here.slope).all()


def modes_of_a_draw(reduced, model, seed):
    """Parts drawn from the prior, and their noisy modes, which come in pairs of equal ones."""
    rows = [(f"{k}.{c}", d) for k in (2, 4, 6) for c, d in ((0, "ux"), (2, "uy"))]
    sensors = np.array([model.dofs.row(n, {d: 1.0}) for n, d in rows])
    theta = 0.1 * np.random.default_rng(seed).standard_normal(6)
    return theta, measured(reduced, sensors, theta, 6, seed=100 + seed)


@pytest.mark.parametrize("seed", [3, 5])
def test_equal_modes_are_paired_with_any_of_their_span(tower, seed):
    """Sensors hear directions between those that the model's solver happens to give."""
    _, model = tower
    reduced = ReducedStructure(model=reduce_modal(model, BasisSettings(modes=10), trials=0))
    theta, data = modes_of_a_draw(reduced, model, seed)
    here = mode_misfit(reduced, data, theta, np.full(6, 0.1))
    assert sorted(here.pairs.tolist()) == list(range(6))
    assert here.residual @ here.residual < 60.0  # of some thirty free ones


def test_frequencies_and_intervals_hold_the_truth_over_seeds(tower):
    _, model = tower
    reduced = ReducedStructure(model=reduce_modal(model, BasisSettings(modes=10), trials=0))
    squares = []
    for seed in range(30):
        theta, data = modes_of_a_draw(reduced, model, seed)
        found = estimate(reduced, data, 0.1, starts=3)
        away = found.theta - theta
        squares.append(away @ np.linalg.solve(found.covariance, away))
    # Chi-square with 180 degrees of freedom: 0.8 to 1.25 of its mean holds for 97 % of runs.
    assert 0.8 < np.mean(squares) / 6 < 1.25


def placement_problem(tower, **precision):
    frame, model = tower
    reduced = ReducedStructure(model=reduce_modal(model, BasisSettings(modes=10), trials=0))
    places = [(n, d) for n in frame.node_names[4:] for d in ("ux", "uy")]
    rows = np.array([model.dofs.row(n, {d: 1.0}) for n, d in places])
    settings = ModePrecision(**({"modes": 8, "frequency_sd": 0.01} | precision))
    return reduced, rows, PlacementProblem(reduced, rows, np.arange(len(rows)), settings, 0.2)


def test_gains_are_the_differences_of_the_criterion(tower):
    _, _, problem = placement_problem(tower)
    chosen, tried = (3, 17, 30), np.array([0, 8, 25, 40])
    before = problem.placement(chosen)
    gains = problem.gains(chosen, tried, "determinant")
    falls = problem.gains(chosen, tried, "variance")
    for site, gain, fall in zip(tried.tolist(), gains, falls, strict=True):
        after = problem.placement((*chosen, site))
        assert after.gain - before.gain == pytest.approx(gain, rel=1e-5, abs=1e-6)
        change = np.sum(before.posterior_sd**2) - np.sum(after.posterior_sd**2)
        assert change == pytest.approx(fall, rel=1e-5, abs=1e-9)


def test_the_expected_posterior_is_that_of_an_estimate(tower):
    reduced, rows, problem = placement_problem(tower, frequency_sd=1e-3, shape_sd=0.01)
    sites = (4, 11, 22, 37, 44)
    modes = reduced.sensed_modes(np.zeros(6), rows, 8)
    sd = 0.01 * np.abs(modes.sensed[:, :8]).max(axis=0)[:, None] * np.ones((8, len(sites)))
    data = MeasuredModes(
        frequency_hz=modes.frequency_hz[:8],
        frequency_sd_hz=1e-3 * modes.frequency_hz[:8],
        shapes=modes.sensed[list(sites), :8].T,
        shape_sd=sd,
        channels=rows[list(sites)],
    )
    found = estimate(reduced, data, 0.2, starts=0)
    np.testing.assert_allclose(problem.placement(sites).posterior_sd, found.sd, rtol=1e-3)


@pytest.mark.parametrize("criterion", ["determinant", "variance"])
def test_chosen_places_beat_even_ones_and_random_ones(tower, criterion):
    _, rows, problem = placement_problem(tower)
    best = place_sensors(problem, 4, criterion=criterion)
    even = problem.placement(
        tuple(np.linspace(0, len(rows) - 1, 4).round().astype(int).tolist())
    )
    random = np.random.default_rng(0)
    others = [
        problem.placement(tuple(random.choice(len(rows), 4, replace=False).tolist()))
        for _ in range(200)
    ]
    assert len(set(best.sites)) == 4
    if criterion == "determinant":
        assert best.gain >= max(one.gain for one in (even, *others)) - 1e-9
    else:
        least = min(np.sum(one.posterior_sd**2) for one in (even, *others))
        assert np.sum(best.posterior_sd**2) <= least + 1e-12


def test_no_exchange_improves_the_result_and_fixed_sites_stay(tower):
    _, rows, problem = placement_problem(tower)
    best = place_sensors(problem, 3, fixed=(5,))
    assert best.sites[0] == 5
    for place in (1, 2):
        for site in range(len(rows)):
            others = [s for k, s in enumerate(best.sites) if k != place]
            if site not in others:
                assert problem.placement((*others, site)).gain <= best.gain + 1e-4


def test_placements_that_cannot_be_are_refused(tower):
    _, _, problem = placement_problem(tower)
    with pytest.raises(ValueError, match="1 sites were asked for, 2 of them fixed"):
        place_sensors(problem, 1, fixed=(0, 1))
    with pytest.raises(ValueError, match="Allowed are positive values"):
        ModePrecision(modes=3, shape_sd=0.0)


def test_a_fixed_basis_gives_the_same_sensed_modes(tower):
    _, model = tower
    whole = project(model, np.eye(model.size))
    sensors = np.array([model.dofs.row("6.0", {"ux": 1.0}), model.dofs.row("3.1", {"uy": 1.0})])
    theta = np.log([0.9, 1.2, 1.0, 0.8, 1.1, 1.0])
    one = ReducedStructure(model=whole).sensed_modes(theta, sensors, 4)
    other = SparseStructure(matrices=model).sensed_modes(theta, sensors, 4)
    np.testing.assert_allclose(one.frequency_hz, other.frequency_hz, rtol=1e-8)
    np.testing.assert_allclose(
        one.log_frequency_slope, other.log_frequency_slope, rtol=1e-5, atol=1e-7
    )


def test_parameters_are_told_apart_by_what_they_act_on():
    """A parameter that scales stiffness and mass counts for the stiffness."""
    one = sparse.csr_array(np.diag([1.0, 0.0]))
    structure = SparseStructure(
        matrices=ParametricMatrices(
            stiffness=sparse.csr_array(2.0 * np.eye(2)),
            mass=sparse.csr_array(np.eye(2)),
            names=("spring", "load", "girder"),
            stiffness_parts=(one, None, one),
            mass_parts=(None, one, one),
        )
    )
    assert structure.element_names == ("spring", "girder")
    assert structure.node_names == ("load",)

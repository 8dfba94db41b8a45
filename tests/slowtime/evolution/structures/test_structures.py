import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from slowtime.evolution.structures import (
    MeasuredModes,
    ParametricStructure,
    estimate,
    identifiability_limits,
    name_changes,
    propose_measurements,
)
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import normalised
from slowtime.identification.modes import Mode


def chain(masses, springs, *, heavy=False):
    """Springs ground - mass 1 - mass 2 ..., and to the ground again if one spring more."""
    n = len(masses)
    ends = np.zeros((len(springs), n))
    for e in range(len(springs)):
        ends[e, e : e + 1] = 1.0
        ends[e, max(e - 1, 0) : e] = -1.0
    parts = np.asarray(springs)[:, None, None] * ends[:, :, None] * ends[:, None, :]
    own = np.asarray(masses)[:, None, None] * np.eye(n)[:, :, None] * np.eye(n)[:, None, :]
    return ParametricStructure(
        mass=np.diag(np.asarray(masses, dtype=float)),
        stiffness=parts.sum(axis=0),
        stiffness_parts=parts,
        mass_parts=own if heavy else None,
    )


SIX = chain(np.ones(6), np.full(6, 1000.0))
TWELVE = chain(np.ones(6), np.full(6, 1000.0), heavy=True)
THREE = chain(np.ones(3), np.ones(4))  # Example 3.3 of the book
DAMAGE = np.log([0.9, 1.0, 1.0, 0.8, 1.0, 1.0])


def measure(structure, theta, rng=None, *, sd=1e-3, shape_sd=0.01, channels=None, **more):
    """What an identification would give; without a generator, exactly the truth."""
    modes = structure.modes(theta, more.get("added_mass"))
    count = len(modes.eigenvalue)
    error = np.zeros(count) if rng is None else sd * rng.normal(size=count)
    frequency = modes.frequency_hz * (1.0 + error)
    shapes = None
    if shape_sd is not None:
        columns = modes.shape if channels is None else channels @ modes.shape
        if not more.get("scaled"):
            columns = columns / np.linalg.norm(columns, axis=0)
        shapes = columns.T.copy()
        if rng is not None:
            shapes += shape_sd * rng.normal(size=shapes.shape)
    return MeasuredModes(
        frequency_hz=frequency,
        frequency_sd_hz=sd * frequency,
        shapes=shapes,
        shape_sd=None if shapes is None else np.full(shapes.shape, shape_sd),
        channels=channels,
        **more,
    )


def located(seeds):
    """Mean chi2 per parameter; parts named; errors of their sizes in standard deviations."""
    joint, names, sizes = [], [], []
    for seed in seeds:
        measured = measure(SIX, DAMAGE, np.random.default_rng(seed))
        posterior = estimate(SIX, measured, 0.3)
        error = posterior.theta - DAMAGE
        joint.append(error @ np.linalg.solve(posterior.covariance, error) / 6.0)
        best = name_changes(SIX, measured).hypotheses[0]
        names.append(best.names)
        if best.names == ("spring 1", "spring 4"):
            sizes.append((best.change - [-0.1, -0.2]) / best.sd)
    return np.mean(joint), names, np.array(sizes)


def test_springs_1_and_4_are_named_and_sized():
    joint, names, sizes = located(range(10))
    assert set(names) == {("spring 1", "spring 4")}
    assert 0.6 < joint < 1.5
    assert np.abs(sizes).max() < 3.5


@pytest.mark.slow
def test_springs_1_and_4_are_named_and_sized_with_posteriors_that_hold_over_200_seeds():
    joint, names, sizes = located(range(200))
    assert names.count(("spring 1", "spring 4")) >= 198
    assert 0.8 < joint < 1.25
    assert (np.mean(np.abs(sizes) < 1.96, axis=0) > 0.9).all()


@pytest.mark.slow
def test_the_posterior_of_each_single_parameter_holds():
    # 200 seeds would leave each mean square an sd of 0.1; 1,000 leave 0.045.
    scores = []
    for seed in range(1000):
        measured = measure(SIX, DAMAGE, np.random.default_rng(seed))
        posterior = estimate(SIX, measured, 0.3, starts=0)
        scores.append((posterior.theta - DAMAGE) / np.sqrt(np.diag(posterior.covariance)))
    each = np.mean(np.square(scores), axis=0)
    assert ((each > 0.85) & (each < 1.18)).all(), each


def test_the_symmetric_chain_of_example_3_3_answers_spring_1_or_4():
    measured = measure(THREE, np.log([0.8, 1.0, 1.0, 1.0]), shape_sd=None)
    named = name_changes(THREE, measured)
    first, second = named.hypotheses[:2]
    assert {first.names, second.names} == {("spring 1",), ("spring 4",)}
    assert first.probability == pytest.approx(second.probability, rel=1e-3)
    assert first.probability > 0.45
    assert first.change[0] == pytest.approx(-0.2, abs=0.003)
    # As likely as each other but for rounding: either may come first.
    told = [f"spring {i} by -20.0 ± 0.5 %" for i in (1, 4)]
    both = named.sentence.lower()
    assert " or ".join(told) in both or " or ".join(reversed(told)) in both
    assert named.inclusion["spring 2"] < 0.05


def test_what_looks_alike_is_said_and_so_is_what_would_tell():
    measured = measure(THREE, np.zeros(4), shape_sd=None)
    posterior = estimate(THREE, measured)
    limits = identifiability_limits(THREE, posterior)
    assert [(limit.kind, limit.names) for limit in limits] == [
        ("alike", ("spring 1", "spring 4")),
        ("alike", ("spring 2", "spring 3")),
    ]
    assert all(limit.ratio > 0.99 for limit in limits)
    assert limits[0].sentence.startswith("spring 1 or spring 4")
    remedies = {r.means: r for r in propose_measurements(THREE, measured, posterior, limits)}
    assert set(remedies) == {"sensor", "added mass", "measured force"}
    assert all(len(r.tells) == 2 for r in remedies.values())
    # A mass in the middle keeps the mirror; one beside it breaks it.
    assert remedies["added mass"].where in {("DOF 1",), ("DOF 3",)}
    assert "spring 1 from spring 4" in remedies["sensor"].sentence


def test_two_sensors_break_the_mirror_as_promised():
    seen = np.eye(3)[[0, 2]]
    damage = np.log([0.8, 1.0, 1.0, 1.0])
    measured = measure(THREE, damage, np.random.default_rng(1), shape_sd=0.02, channels=seen)
    assert name_changes(THREE, measured).hypotheses[0].names == ("spring 1",)
    assert identifiability_limits(THREE, estimate(THREE, measured)) == ()


def test_a_mirror_shows_as_several_optima_of_equal_probability():
    measured = measure(THREE, np.log([0.6, 1.0, 1.0, 1.0]), shape_sd=None)
    posterior = estimate(THREE, measured, starts=12)
    mirrored = [o.theta[::-1] for o in posterior.optima]
    for optimum, weight in zip(posterior.optima, posterior.weights, strict=True):
        near = [np.abs(optimum.theta - m).max() < 0.05 for m in mirrored]
        assert any(near)
        assert posterior.weights[near.index(True)] == pytest.approx(weight, rel=0.05)
    assert len(posterior.optima) >= 2


@pytest.mark.parametrize(
    ("how", "rank"),
    [
        ({"shape_sd": None}, 6),
        ({"shape_sd": 0.01}, 11),
        ({"shape_sd": 0.01, "scaled": True}, 12),
    ],
)
def test_frequencies_know_6_of_12_shapes_11_and_scaled_shapes_all(how, rank):
    posterior = estimate(TWELVE, measure(TWELVE, np.zeros(12), **how), starts=0)
    singular = np.linalg.svd(posterior.optima[0].whitened, compute_uv=False)
    assert np.sum(singular > 1e-9 * singular[0]) == rank


def test_a_known_mass_on_one_node_tells_even_the_scale():
    heavier = np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    sets = [
        measure(TWELVE, np.zeros(12), sd=1e-5),
        measure(TWELVE, np.zeros(12), sd=1e-5, added_mass=heavier),
    ]
    alone, both = estimate(TWELVE, sets[0], starts=0), estimate(TWELVE, sets, starts=0)
    assert [limit.kind for limit in identifiability_limits(TWELVE, alone)] == ["scale"]
    assert "One common factor" in identifiability_limits(TWELVE, alone)[0].sentence
    assert identifiability_limits(TWELVE, both) == ()
    assert alone.ratio.min() > 0.25
    assert both.ratio.max() < 0.01


def test_mass_against_stiffness_is_told_as_such_and_counted():
    measured = measure(TWELVE, np.zeros(12), shape_sd=None)
    limits = identifiability_limits(TWELVE, estimate(TWELVE, measured, starts=0))
    assert [limit.kind for limit in limits] == ["scale"] + 5 * ["mass against stiffness"]
    directions = np.array([limit.direction for limit in limits])
    np.testing.assert_allclose(directions @ directions.T, np.eye(6), atol=1e-6)


def test_a_parameter_that_moves_nothing_is_said_to_be_unseen():
    parts = np.concatenate([SIX.stiffness_parts, 1e-9 * SIX.stiffness_parts[:1]])
    structure = ParametricStructure(
        mass=SIX.mass, stiffness=parts.sum(axis=0), stiffness_parts=parts
    )
    posterior = estimate(structure, measure(structure, np.zeros(7)), starts=0)
    limits = identifiability_limits(structure, posterior)
    assert [(limit.kind, limit.names) for limit in limits] == [("unseen", ("spring 7",))]
    assert posterior.ratio[6] == pytest.approx(1.0, abs=1e-6)


springs = st.lists(st.floats(0.3, 3.0), min_size=4, max_size=4)


@settings(max_examples=25)
@given(springs, springs)
def test_slopes_are_what_differences_say(stiff, heavy):
    structure = chain(heavy, stiff, heavy=True)
    theta, step = np.linspace(-0.2, 0.3, 8), 1e-5
    modes = structure.modes(theta)
    for p in range(8):
        move = step * np.eye(8)[p]
        up, down = structure.modes(theta + move), structure.modes(theta - move)
        slope = np.log(up.eigenvalue / down.eigenvalue) / (4 * step)
        np.testing.assert_allclose(modes.log_frequency_slope[:, p], slope, atol=1e-7)
        signs = [np.sign(np.sum(one.shape * modes.shape, axis=0)) for one in (up, down)]
        turned = (up.shape * signs[0] - down.shape * signs[1]) / (2 * step)
        np.testing.assert_allclose(modes.shape_slope[:, :, p], turned, atol=1e-4)


def test_lowest_modes_at_sensors_equal_those_of_all_modes():
    rng = np.random.default_rng(2)
    # Parts that are full, as those of a reduced model are, and more modes than are needed.
    rows = rng.standard_normal((3, 90, 90))
    parts = rows @ rows.transpose(0, 2, 1)
    structure = ParametricStructure(
        mass=np.diag(rng.uniform(0.5, 2.0, 90)),
        stiffness=parts.sum(axis=0) + 10.0 * np.diag(np.arange(1.0, 91.0)),
        stiffness_parts=parts,
    )
    theta, sensors = np.array([-0.2, 0.1, 0.3]), rng.standard_normal((5, 90))
    all_modes = structure.modes(theta)
    found = structure.sensed_modes(theta, sensors, 8)
    count = len(found.eigenvalue)
    assert 8 <= count < 90
    np.testing.assert_allclose(found.eigenvalue, all_modes.eigenvalue[:count], rtol=1e-12)
    np.testing.assert_allclose(
        found.log_frequency_slope, all_modes.log_frequency_slope[:count], rtol=1e-9
    )
    signs = np.sign(np.sum(found.sensed * (sensors @ all_modes.shape[:, :count]), axis=0))
    seen = np.einsum("sd,dmp->smp", sensors, all_modes.shape_slope[:, :count])
    np.testing.assert_allclose(found.sensed_slope, signs[:, None] * seen, rtol=1e-6, atol=1e-9)


def test_slopes_obey_the_identities_of_euler():
    modes = TWELVE.modes(np.linspace(-0.3, 0.3, 12))
    np.testing.assert_allclose(modes.log_frequency_slope[:, :6].sum(axis=1), 0.5, rtol=1e-12)
    np.testing.assert_allclose(modes.log_frequency_slope[:, 6:].sum(axis=1), -0.5, rtol=1e-12)


def test_a_free_structure_is_compared_without_its_rigid_motion():
    free = chain(np.ones(3), np.array([1e-300, 2.0, 3.0]))
    found = free.modes(np.zeros(3)).frequency_hz
    assert len(found) == 2
    assert found[0] > 0.1


def test_the_optimum_is_that_of_a_general_optimiser_on_the_same_posterior():
    measured = measure(SIX, DAMAGE, np.random.default_rng(3))
    assert measured.shapes is not None

    def residual(theta):
        modes = SIX.modes(theta)
        rows = [np.log(measured.frequency_hz / modes.frequency_hz) / 1e-3, theta / 0.3]
        for y, x in zip(measured.shapes, modes.shape.T, strict=True):
            rows.append((y - x * (x @ y) / (x @ x)) / 0.01)
        return np.concatenate(rows)

    general = least_squares(residual, np.zeros(6), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    posterior = estimate(SIX, measured)
    np.testing.assert_allclose(posterior.theta, general.x, atol=1e-6)
    curvature = np.linalg.inv(np.asarray(general.jac).T @ np.asarray(general.jac))
    np.testing.assert_allclose(posterior.covariance, curvature, rtol=0.03, atol=3e-7)


def test_order_of_modes_sign_and_norm_of_shapes_do_not_matter():
    given_ = measure(SIX, DAMAGE, np.random.default_rng(4))
    assert given_.shapes is not None
    assert given_.shape_sd is not None
    factors = np.array([-1.0, 3.0, 0.1, -7.0, 1.0, 2.0])[:, None]
    order = np.array([3, 1, 5, 0, 2, 4])
    other = MeasuredModes(
        frequency_hz=given_.frequency_hz[order],
        frequency_sd_hz=given_.frequency_sd_hz[order],
        shapes=(factors * given_.shapes)[order],
        shape_sd=(np.abs(factors) * given_.shape_sd)[order],
    )
    one, two = estimate(SIX, given_), estimate(SIX, other)
    np.testing.assert_allclose(one.theta, two.theta, atol=1e-8)
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-6)


def test_some_modes_from_some_sensors_are_enough_and_a_dead_channel_is_passed_over():
    rng = np.random.default_rng(5)
    seen = np.eye(6)[[1, 3, 5]]
    whole = measure(SIX, DAMAGE, rng, channels=seen)
    assert whole.shapes is not None
    assert whole.shape_sd is not None
    shapes = whole.shapes[:4].copy()
    shapes[2, 1] = np.nan
    part = MeasuredModes(
        frequency_hz=whole.frequency_hz[:4],
        frequency_sd_hz=whole.frequency_sd_hz[:4],
        shapes=shapes,
        shape_sd=whole.shape_sd[:4],
        channels=seen,
    )
    posterior = estimate(SIX, part)
    error = posterior.theta - DAMAGE
    assert error @ np.linalg.solve(posterior.covariance, error) < 16.8  # 99 % of chi2 of 6


def test_nothing_is_named_where_nothing_has_changed():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        named = name_changes(SIX, measure(SIX, 0.003 * rng.normal(size=6), rng))
        assert named.hypotheses[0].names == ()
        assert named.sentence.startswith("Nothing has changed")


def test_a_model_that_does_not_hold_is_known_by_its_misfit():
    rng = np.random.default_rng(6)
    right = estimate(SIX, measure(SIX, DAMAGE, rng), starts=2)
    mass = np.zeros(12)
    mass[7] = np.log(1.3)
    wrong = estimate(SIX, measure(TWELVE, mass, rng), starts=2)
    assert right.p_value > 0.01
    assert wrong.p_value < 1e-6


def test_a_parameter_that_cannot_have_changed_does_not():
    prior = np.array([0.3, 0.3, 0.3, 0.0, 0.3, 0.3])
    posterior = estimate(SIX, measure(SIX, DAMAGE), prior)
    assert posterior.theta[3] == 0.0
    assert posterior.ratio[3] == 0.0
    assert posterior.sd[3] == 0.0


def test_identified_modes_are_taken_over_without_harmonics():
    truth = SIX.modes(DAMAGE)
    modes = [
        Mode(
            frequency_hz=Measured(f, 1e-3 * f),
            damping_ratio=Measured(0.01, 0.001),
            correlation=0.0,
            shape=normalised(1j * shape),
            shape_sd=np.full(6, 0.01),
        )
        for f, shape in zip(truth.frequency_hz, truth.shape.T, strict=True)
    ]
    modes.insert(2, dataclasses.replace(modes[0], kind="harmonic"))
    posterior = estimate(SIX, MeasuredModes.of(modes))
    np.testing.assert_allclose(posterior.theta, DAMAGE, atol=0.002)
    low, high = posterior.interval()
    assert ((low < np.expm1(DAMAGE)) & (np.expm1(DAMAGE) < high)).all()


def test_senseless_input_is_refused_with_the_cure():
    good = measure(SIX, DAMAGE)
    with pytest.raises(ValueError, match="leave out modes that were not identified"):
        MeasuredModes(frequency_hz=np.array([np.nan]), frequency_sd_hz=np.ones(1))
    with pytest.raises(ValueError, match="Give the sd of each component"):
        MeasuredModes(
            frequency_hz=np.ones(1), frequency_sd_hz=np.ones(1), shapes=np.ones((1, 6))
        )
    with pytest.raises(ValueError, match="one row a channel"):
        estimate(THREE, good)
    with pytest.raises(ValueError, match="but the model has only 3"):
        estimate(THREE, measure(SIX, DAMAGE, shape_sd=None))
    with pytest.raises(ValueError, match="0 for what cannot have changed"):
        estimate(SIX, good, -1.0)
    with pytest.raises(ValueError, match="share between 0 and 1"):
        name_changes(SIX, good, changed_share=1.0)
    with pytest.raises(ValueError, match="not symmetric"):
        ParametricStructure(
            mass=np.eye(2),
            stiffness=np.triu(np.ones((2, 2))),
            stiffness_parts=np.ones((1, 2, 2)),
        )
    with pytest.raises(ValueError, match="has no mass"):
        ParametricStructure(
            mass=np.diag([1.0, 0.0]), stiffness=np.eye(2), stiffness_parts=np.ones((1, 2, 2))
        )
    with pytest.raises(ValueError, match="Give one name each"):
        ParametricStructure(
            mass=np.eye(2),
            stiffness=np.eye(2),
            stiffness_parts=np.ones((1, 2, 2)),
            element_names=("a", "b"),
        )


def row_of_masses(coupling):
    """Masses on springs of their own, each a little stiffer, and weakly tied to the next."""
    count = 6
    parts = np.zeros((count, count, count))
    parts[np.arange(count), np.arange(count), np.arange(count)] = 1.0 + 0.04 * np.arange(count)
    ends = np.diff(np.eye(count), axis=0)
    stiffness = parts.sum(axis=0) + coupling * ends.T @ ends
    return ParametricStructure(mass=np.eye(count), stiffness=stiffness, stiffness_parts=parts)


@pytest.mark.parametrize("coupling", [0.005, 0.02])
@pytest.mark.parametrize("which", range(1, 6))
def test_a_change_at_which_modes_exchange_their_shapes_is_named_alone(coupling, which):
    """On the way to it the frequencies of two modes and more come near each other, and veer."""
    structure, sd = row_of_masses(coupling), 1e-3
    change = np.zeros(6)
    change[which] = np.log(0.85)
    modes, rng = structure.modes(change), np.random.default_rng(which)
    assert np.argmax(np.abs(modes.shape[which])) < which  # it was the mode of that number
    measured = MeasuredModes(
        frequency_hz=modes.frequency_hz * np.exp(1e-4 * rng.standard_normal(6)),
        frequency_sd_hz=1e-4 * modes.frequency_hz,
        shapes=modes.shape.T + sd * rng.standard_normal((6, 6)),
        shape_sd=np.full((6, 6), sd),
    )
    named = name_changes(structure, measured, changed_sd=0.2, most=2).hypotheses[0]
    assert named.names == (structure.names[which],)
    assert named.probability > 0.9
    assert abs(named.change[0] + 0.15) < 4 * named.sd[0]

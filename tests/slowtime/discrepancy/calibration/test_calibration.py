import dataclasses
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from slowtime.discrepancy.calibration import (
    FitAbandoned,
    attempt,
    levenberg_marquardt,
    prior_of,
    refit,
)
from slowtime.discrepancy.calibration import fit as fitting
from slowtime.discrepancy.calibration.levenberg_marquardt import (
    FitControl,
    NormalEquations,
    _bounded_step,
)
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.calibration.spectral_weights import spectral_weights
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.records import MIN_SAMPLES
from slowtime.dynamics.description import Tolerance
from slowtime.dynamics.effects import Effect, Place
from slowtime.dynamics.plant import Plant


def truth(rig):
    return np.concatenate([rig.stiffnesses, rig.dampings])


def plant_of(rig):
    return Plant.of(rig.description)


@pytest.fixture(scope="module")
def clean(campaign):
    """Three fits where nothing is missing: white noise, coloured noise, another start."""
    found = []
    cases: list[dict[str, Any]] = [
        {"mode": "states", "masses": 2},
        {"mode": "accelerations", "pole": 0.9, "kick": 1.0, "stiffness_sd": 0.05},
        {"mode": "partial", "drive": "base", "kick": 1.0, "stiffness_sd": 0.03},
    ]
    for seed, more in enumerate(cases):
        rig, trials = campaign(seed, **more)
        found.append((rig, trials, refit(plant_of(rig), trials)))
    return found


def test_constants_come_out_within_their_errors(clean):
    scores = np.concatenate([(fit.free - truth(rig)) / fit.sd for rig, _, fit in clean])
    assert np.abs(scores).max() < 3.5
    assert np.std(scores) == pytest.approx(1.0, abs=0.45)


def test_what_is_left_is_the_noise_whatever_its_colour(clean):
    for _, _, fit in clean:
        assert abs(fit.chi2_per_datum - 1) < 3.5 * fit.chi2_sd
        assert abs(fit.chi2_in_band - 1) < 3.5 * fit.in_band_sd
    white = [all(row[0].coloured == 0 for row in fit.noise.colours) for _, _, fit in clean]
    assert white == [True, False, True]


def test_records_that_do_not_start_from_rest_are_followed_from_the_first_sample(clean):
    _, trials, fit = clean[1]
    early = np.std(trials[0].outputs[:50], axis=0)
    noise = np.std(fit.residual[0], axis=0)
    assert np.std(fit.residual[0][:50], axis=0) == pytest.approx(noise, rel=0.6)
    assert np.all(early > 4 * noise)
    assert np.abs(fit.states[0][:3]).max() > 1e-3


def test_pulls_are_in_units_of_what_the_model_claims(clean):
    rig, _, fit = clean[1]
    claimed = rig.description.elements[0].stiffness_n_per_m
    moved = fit.values[fit.plant.parameters.index(("stiffness", "j0"))] / claimed - 1
    assert fit.pulls["stiffness", "j0"] == pytest.approx(moved / 0.05)


@pytest.mark.parametrize("error", [np.linalg.LinAlgError, FloatingPointError, FitAbandoned])
def test_a_step_that_breaks_down_gives_nothing_and_a_mistake_is_raised(error):
    def broken(number):
        raise error

    assert attempt(broken, 1) is None
    assert attempt(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        attempt(divmod, 7, 0)


@pytest.mark.long
def test_a_refit_never_ends_above_its_start(campaign, wrong):
    gap = wrong(element=0, force=lambda e, v, t: 2e4 * np.sign(e) * max(abs(e) - 5e-3, 0))
    rig, trials = campaign(4, gap, masses=1, levels=(2.0,), seconds=8.0)
    noise = white_noise([[1e-6, 1e-4, 1e-1]])
    start = refit(plant_of(rig), trials, noise=noise, free=())
    for horizons in ((0.15, 0.4, 1.0), (1.0,)):
        fit = refit(plant_of(rig), trials, noise=noise, horizons=horizons)
        assert fit.cost <= start.cost
        assert fit.cost < 0.9 * start.cost


def test_what_is_far_from_the_best_on_a_first_part_is_given_up_there(campaign):
    rig, trials = campaign(8, masses=1, seconds=8.0, levels=(1.0,))
    plant = plant_of(rig)
    right = refit(plant, trials)
    wrong = with_values(rig.description, {("stiffness", "j0"): 2 * rig.stiffnesses[0]})
    wrong = dataclasses.replace(wrong, tolerance=Tolerance(stiffness=1e-6, damping=0.1))
    rest: dict[str, Any] = {"noise": right.noise, "horizons": (0.4, 1.0)}
    assert refit(Plant.of(wrong), trials, **rest).cost > 100 * right.cost
    with pytest.raises(levenberg_marquardt.FitAbandoned):
        refit(Plant.of(wrong), trials, **rest, control=FitControl(cost_to_beat=right.cost))
    assert (
        refit(plant, trials, **rest, control=FitControl(cost_to_beat=right.cost)).cost
        <= 1.01 * right.cost
    )


def test_the_very_first_part_is_fitted_to_the_end_before_anything_is_compared(
    campaign, monkeypatch
):
    """One that begins far off comes down there, where that costs nothing."""
    rig, trials = campaign(8, masses=1, seconds=20.0, levels=(1.0,))
    right = refit(plant_of(rig), trials)
    goals = []

    def noted(problem, start, control):
        part, whole = control.data
        beat = None if control.cost_to_beat is None else control.cost_to_beat * part / whole
        goals.append((problem.samples[0] / len(trials[0].outputs), beat))
        return descended(problem, start, control)

    descended = levenberg_marquardt.minimise
    monkeypatch.setattr("slowtime.discrepancy.calibration.fit.minimise", noted)
    parts: dict[str, Any] = {
        "noise": right.noise, "horizons": (0.09, 0.3, 1.0),
        "control": FitControl(cost_to_beat=2 * right.cost),
    }  # fmt: skip
    refit(plant_of(rig), trials, **parts)
    assert goals[0][1] is None
    assert goals[1][1] == pytest.approx(2 * right.cost * goals[1][0])
    assert goals[2][1] == 2 * right.cost
    far = with_values(rig.description, {("stiffness", "j0"): 2 * rig.stiffnesses[0]})
    far = dataclasses.replace(far, tolerance=Tolerance(stiffness=1e-6, damping=0.1))
    with pytest.raises(levenberg_marquardt.FitAbandoned):
        refit(Plant.of(far), trials, **parts)


@pytest.mark.parametrize("growth", [-0.3, 0.0, 1.5])
def test_what_a_state_makes_in_chaos_outgrows_the_record(clean, growth):
    measured = clean[1][1][0].measured
    times = np.linspace(0.0, 20.0, len(measured))
    swing = np.exp(growth * times) * np.cos(9.0 * times)
    slopes = np.broadcast_to(swing[:, None, None], (*measured.shape, 2))
    outgrown = levenberg_marquardt._sensitivity_growth(slopes, measured)
    if growth <= 0:
        assert np.all(outgrown < 30.0)
    else:
        # Of a first part it then explains about as much as elsewhere of a whole record.
        first = max(int(len(times) * levenberg_marquardt.FIRST_PARTS[0]), MIN_SAMPLES)
        by = [
            np.linalg.norm(one[:first]) / np.linalg.norm(one)
            for one in (measured / measured.std(axis=0), swing)
        ]
        np.testing.assert_allclose(outgrown, by[0] / by[1], rtol=0.5)
        assert np.all(outgrown > levenberg_marquardt.CHAOTIC_GROWTH)


def test_a_sensor_that_hears_nothing_does_not_say_how_a_state_grows(clean):
    measured = clean[1][1][0].measured.copy()
    slopes = np.ones((*measured.shape, 2))
    measured[:, 0] = 0.0
    assert np.all(levenberg_marquardt._sensitivity_growth(slopes, measured) < 30.0)


@pytest.mark.parametrize(
    ("bends", "outgrown", "held"),
    [
        (True, 1e6, 1e6),
        (True, 0.9 * levenberg_marquardt.CHAOTIC_GROWTH, 1.0),
        (False, 1e6, 1.0),
    ],
)
def test_initial_states_are_held_less_where_motion_is_chaotic(
    clean, monkeypatch, bends, outgrown, held
):
    rig, trials, fit = clean[1]
    law = Effect("cubic_hardening", Place("element", "j0"), {"k3_n_per_m3": 0.0})
    given = dataclasses.replace(rig.description, effects=(law.entry(),) if bends else ())
    plant = Plant.of(given)
    weights = tuple(spectral_weights(t, fit.noise, i) for i, t in enumerate(trials))
    problem = levenberg_marquardt.LeastSquaresProblem(
        plant=plant, prior=prior_of(plant), trials=tuple(trials), weights=weights,
        samples=tuple(len(t.outputs) for t in trials),
    )  # fmt: skip
    point = levenberg_marquardt.Iterate(values=plant.values, states=fit.states)
    _, known = levenberg_marquardt.normal_equations(problem, point)
    many = np.full(len(fit.states[0]), outgrown)
    monkeypatch.setattr(levenberg_marquardt, "_sensitivity_growth", lambda *_: many)
    _, spread = levenberg_marquardt.normal_equations(problem, point)
    for one, before in zip(spread, known, strict=True):
        np.testing.assert_allclose(one, before * held)


def test_what_grows_beyond_bounds_is_refused_and_nobody_is_warned(clean, monkeypatch):
    """Warnings are errors here; to whom diagnoses they would be noise."""
    rig, trials, fit = clean[1]
    plant = Plant.of(rig.description)
    problem = levenberg_marquardt.LeastSquaresProblem(
        plant=plant, prior=prior_of(plant), trials=tuple(trials[:1]),
        weights=(spectral_weights(trials[0], fit.noise, 0),), samples=(len(trials[0].outputs),),
    )  # fmt: skip
    point = levenberg_marquardt.Iterate(values=plant.values, states=fit.states[:1])
    far = Plant.sensitivities

    def huge(*args, **more):
        outputs, slopes = far(*args, **more)
        return outputs, 1e200 * slopes

    monkeypatch.setattr(Plant, "sensitivities", huge)
    with pytest.raises(FloatingPointError, match="diverged"):
        levenberg_marquardt.normal_equations(problem, point)


def test_of_what_nothing_tells_the_variance_is_without_bound_and_nobody_is_warned():
    matrix = np.diag([1.0, 1e-320, 1e-320])
    normal = NormalEquations(cost=0.0, matrix=matrix, gradient=np.zeros(3), states=0)
    variance = np.diag(normal.covariance)
    assert variance[0] == pytest.approx(1.0)
    assert np.all(variance[1:] > 1e300)


def test_what_neither_data_nor_a_prior_tell_is_not_settled(clean):
    rig, trials, fit = clean[1]
    plant = Plant.of(rig.description)
    prior = prior_of(plant)
    count = len(prior.names)
    problem = levenberg_marquardt.LeastSquaresProblem(
        plant=plant, prior=dataclasses.replace(prior, sd=np.full(count, np.inf)),
        trials=(trials[0],), weights=(spectral_weights(trials[0], fit.noise, 0),),
        samples=(len(trials[0].outputs),),
    )  # fmt: skip
    told = np.append(np.ones(count - 1), 1e-320)
    normal = NormalEquations(cost=0.0, matrix=np.diag(told), gradient=np.zeros(count), states=0)
    assert fitting._effective_unknowns(problem, normal) == count - 1


def test_a_point_costs_the_same_with_slopes_and_without(clean):
    for _, trials, fit in clean:
        weights = tuple(spectral_weights(t, fit.noise, i) for i, t in enumerate(trials))
        problem = levenberg_marquardt.LeastSquaresProblem(
            plant=fit.plant, prior=fit.prior, trials=tuple(trials), weights=weights,
            samples=tuple(len(t.outputs) for t in trials),
        )  # fmt: skip
        point = levenberg_marquardt.Iterate(values=1.01 * fit.values, states=fit.states)
        normal, spread = levenberg_marquardt.normal_equations(problem, point)
        alone = levenberg_marquardt.with_cost(problem, point, spread).cost
        assert normal.cost == pytest.approx(alone, rel=1e-9)


@pytest.mark.long
def test_an_effect_with_its_law_is_fitted_to_the_noise(campaign, wrong):
    cubic = wrong(element=0, force=lambda e, v, t: 4e5 * e**3)
    rig, trials = campaign(5, cubic, masses=1, mode="accelerations", seconds=8.0)
    entry = {"effect": "cubic_hardening", "element": "j0", "k3_n_per_m3": 1e5}
    more = dataclasses.replace(rig.description, effects=(entry,))
    fit = refit(Plant.of(more), trials)
    i = fit.prior.names.index(("effect", 0, "k3_n_per_m3"))
    assert abs(fit.free[i] - 4e5) < 3.5 * fit.sd[i]
    assert fit.sd[i] < 0.05 * 4e5
    assert fit.chi2_in_band == pytest.approx(1.0, abs=4 * fit.in_band_sd)
    assert refit(plant_of(rig), trials).chi2_in_band > 3


@pytest.mark.long
def test_numbers_that_are_told_only_together_end_where_the_claim_of_one_puts_them(
    campaign, wrong, monkeypatch
):
    # The records tell the sum of two dampings, and a factor over the square of a length.
    sings = wrong(element=0, force=lambda e, v, t: 1.6 * ((e / 1e-3) ** 2 - 1) * v)
    rig, trials = campaign(3, sings, masses=1, seconds=8.0, snr_db=60.0)
    entry = {"effect": "van_der_pol", "element": "j0", "cn_n_s_per_m": 1.6, "e0_m": 1e-3}
    plant = Plant.of(dataclasses.replace(rig.description, effects=(entry,)))
    bottom = refit(plant, trials)
    damping, factor, length = (
        plant.parameters.index(name)
        for name in (("damping", "j0"), ("effect", 0, "cn_n_s_per_m"), ("effect", 0, "e0_m"))
    )
    sd = bottom.prior.sd[bottom.prior.names.index(("damping", "j0"))]
    # What is little beside chi squared of so many samples.
    monkeypatch.setattr(levenberg_marquardt, "RELATIVE_MIN_GAIN", 10.0 / bottom.cost)
    for away in (-1.5, 1.5):
        values = bottom.values.copy()
        values[damping] += away * sd
        values[factor] += away * sd
        values[length] *= np.sqrt(values[factor] / bottom.values[factor])
        fits = [
            refit(
                plant, trials, noise=bottom.noise, values=values, states=bottom.states,
                horizons=(1.0,), control=FitControl(to_convergence=fine),
            )
            for fine in (False, True)
        ]  # fmt: skip
        plain, fine = (fit.pulls["damping", "j0"] for fit in fits)
        assert abs(plain) > 1
        assert abs(fine) < 0.01


@pytest.mark.long
def test_a_wrong_model_is_not_followed_to_its_bottom_because_most_data_lie_above_it(
    campaign, wrong, monkeypatch
):
    """In band it leaves several times the noise, of all data together less than three times."""
    rig, trials = campaign(
        5, wrong(element=0, force=lambda e, v, t: 1e4 * e**3), mode="states", masses=2,
        stiffness_sd=0.05,
    )  # fmt: skip
    points = []

    def counted(*args, **more):
        points.append(args)
        return costed(*args, **more)

    costed = levenberg_marquardt.with_cost
    monkeypatch.setattr(levenberg_marquardt, "with_cost", counted)

    def tried():
        points.clear()
        return refit(plant_of(rig), trials, horizons=(1.0,)), len(points)

    soon, few = tried()
    monkeypatch.setattr(levenberg_marquardt, "EXCESS_MIN_GAIN", 0.0)
    bottom, many = tried()
    assert soon.chi2_in_band > 2
    assert soon.chi2_per_datum < levenberg_marquardt.WRONG_MODEL_CHI2
    assert few < many
    assert soon.cost - bottom.cost < 0.01 * (bottom.cost - bottom.data)


def test_masked_samples_do_not_matter(campaign):
    rig, trials = campaign(6, masses=1, seconds=8.0)
    spoilt = []
    for trial in trials:
        outputs, use = trial.outputs.copy(), np.ones(trial.outputs.shape, dtype=bool)
        outputs[200:300, 0], use[200:300, 0] = 1e3, False
        outputs[400:410, 1] = np.nan
        spoilt.append(dataclasses.replace(trial, outputs=outputs, use=use))
    fit = refit(plant_of(rig), spoilt)
    assert np.abs((fit.free - truth(rig)) / fit.sd).max() < 3.5
    assert fit.chi2_per_datum == pytest.approx(1.0, abs=4 * fit.chi2_sd)
    assert fit.data == 2 * (3 * 512 - 110)


def test_only_what_is_claimed_with_a_tolerance_moves(campaign):
    rig, _ = campaign(7, masses=1, seconds=1.0, levels=(1.0,))
    assert prior_of(plant_of(rig)).names == (("stiffness", "j0"), ("damping", "j0"))
    silent = dataclasses.replace(rig.description, tolerance=None)
    assert prior_of(Plant.of(silent)).sd[0] == pytest.approx(
        0.2 * rig.description.elements[0].stiffness_n_per_m
    )
    stiff = dataclasses.replace(rig.description, tolerance=Tolerance(damping=0.1))
    assert prior_of(Plant.of(stiff)).names == (("damping", "j0"),)
    with pytest.raises(ValueError, match=r"There is no .*j9.* in the plant"):
        prior_of(plant_of(rig), [("stiffness", "j9")])


def test_values_find_their_way_into_the_description(campaign):
    rig, _ = campaign(7, masses=2, seconds=1.0, levels=(1.0,))
    entry = {"effect": "coulomb", "element": "j1", "friction_n": 1.0}
    plant = Plant.of(dataclasses.replace(rig.description, effects=(entry,)))
    changed = plant.values * np.linspace(1.1, 1.7, len(plant.values))
    named = dict(zip(plant.parameters, changed.tolist(), strict=True))
    assert Plant.of(with_values(plant.description, named)).values == pytest.approx(changed)


def test_a_record_may_begin_before_its_sensors_hear_anything(campaign):
    rig, (trial, *_) = campaign(4, mode="states", masses=2)
    use = trial.used.copy()
    use[: len(use) // 3] = False
    fit = refit(plant_of(rig), [dataclasses.replace(trial, use=use)])
    assert np.abs((fit.free - truth(rig)) / fit.sd).max() < 4.0


def test_what_is_left_widens_what_the_records_tell_and_not_what_is_claimed(clean):
    fit = clean[1][2]
    calm = dataclasses.replace(fit, chi2_in_band=1.0)
    np.testing.assert_allclose(calm.inflated_sd, fit.sd, rtol=1e-6)
    loud = dataclasses.replace(fit, chi2_in_band=1e6)
    assert (loud.inflated_sd <= 1.001 * fit.prior.sd).all()
    assert (loud.inflated_sd > 5 * fit.sd).any()
    free = dataclasses.replace(fit.prior, sd=np.full_like(fit.prior.sd, np.inf))
    unclaimed = dataclasses.replace(fit, prior=free, chi2_in_band=9.0)
    np.testing.assert_allclose(unclaimed.inflated_sd, 3 * fit.sd, rtol=1e-6)


@hypothesis.given(
    seed=st.integers(0, 2**32 - 1), free=st.integers(1, 8), wide=st.floats(0.01, 3)
)
def test_a_step_is_the_best_that_its_room_allows(seed, free, wide):
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((2 * free + 4, free + 2)) * rng.uniform(0.01, 100, free + 2)
    left = rng.standard_normal(len(slopes))
    normal = NormalEquations(
        cost=0.0, matrix=slopes.T @ slopes, gradient=slopes.T @ left, states=2
    )
    room = wide * rng.uniform(0, 1, (2, free)) / np.linalg.norm(slopes[:, :free], axis=0)
    step, gain = _bounded_step(normal, 0.0, -room[0], room[1])
    assert (-room[0] * (1 + 1e-9) <= step[:free]).all()
    assert (step[:free] <= room[1] * (1 + 1e-9)).all()
    assert gain == pytest.approx(left @ left - np.sum((left - slopes @ step) ** 2), abs=1e-6)
    # Karush, Kuhn, Tucker: nothing more is to be had but beyond a bound.
    slope = slopes.T @ (left - slopes @ step) / np.linalg.norm(slopes, axis=0)
    up = np.r_[step[:free] > room[1] * (1 - 1e-6), False, False]
    down = np.r_[step[:free] < -room[0] * (1 - 1e-6), False, False]
    assert (slope[~up] < 1e-6).all()
    assert (slope[~down] > -1e-6).all()


def test_equations_that_rounding_left_indefinite_are_damped(monkeypatch, campaign):
    """A numerical failure is answered by damping, and ends no fit."""
    rig, trials = campaign(0, mode="states", masses=2)
    wanted = refit(plant_of(rig), trials)
    module = vars(levenberg_marquardt)
    solved = module["solve_within"]

    def indefinite(matrix, right, low, high):
        if matrix.diagonal().min() < 1 + 1e-4:
            raise np.linalg.LinAlgError("not positive definite")
        return solved(matrix, right, low, high)

    monkeypatch.setattr(levenberg_marquardt, "solve_within", indefinite)
    found = refit(plant_of(rig), trials)
    assert found.cost < wanted.cost + 1.0

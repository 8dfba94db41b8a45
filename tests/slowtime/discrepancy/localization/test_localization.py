import dataclasses
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import scipy.stats

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.localization import LinearModel, characterise, locate
from slowtime.discrepancy.localization import latent_force as latent
from slowtime.discrepancy.localization.character import MotionRange
from slowtime.discrepancy.localization.gain_probability import gain_probability
from slowtime.discrepancy.localization.perturbed_reference import (
    LinearConstants,
    PerturbedReference,
)
from slowtime.discrepancy.localization.spectral_lines import TrialLines, trial_lines
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.proposers.base_motion import _grows, base_motion
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Description, Input, Node, Sensor
from slowtime.dynamics.effects import Place, catalogue
from slowtime.dynamics.effects.library.sensors import timed
from slowtime.dynamics.plant import Plant
from slowtime.signals.spectra import transform


def cubic(e, v, t):
    return 4e5 * e**3


def friction(e, v, t):
    return 0.15 * np.tanh(v / 2e-3)


def gap(e, v, t):
    return 2000 * np.sign(e) * max(abs(e) - 2e-3, 0.0)


def loosened(e, v, t):
    return -60.0 * e * (t > 32.0)


def unstable(e, v, t):
    return 4.0 * (e**2 / 1.5e-3**2 - 1) * v


def gained(reading):
    return 1.1 * reading


def located(campaign, seed, wrong, **more):
    rig, trials = campaign(seed, wrong, **more)
    fit = refit(Plant.of(rig.description), trials)
    return rig, trials, locate(fit, trials)


STATES: dict[str, Any] = {"mode": "states", "masses": 2}
ACCELERATIONS: dict[str, Any] = {"mode": "accelerations", "drive": "base", "stiffness_sd": 0.03}
PARTIAL: dict[str, Any] = {"mode": "partial", "kick": 1.0}
CASES: dict[str, tuple[Place, dict[str, Any], dict[str, Any]]] = {
    "cubic": (Place("element", "j1"), {"element": 1, "force": cubic}, STATES),
    "friction": (Place("element", "j2"), {"element": 2, "force": friction}, ACCELERATIONS),
    "base": (Place("base", "base"), {"base_rms": 0.2}, {"mode": "accelerations", "pole": 0.9}),
    "jump": (Place("element", "j1"), {"element": 1, "force": loosened}, PARTIAL),
}
MORE: dict[str, tuple[Place, dict[str, Any], dict[str, Any]]] = {
    "gap": (Place("element", "j1"), {"element": 1, "force": gap}, PARTIAL),
    "sensor": (Place("sensor", "v2"), {"sensor": 4, "fault": gained}, {"mode": "states"}),
    "cubic": (Place("element", "j0"), {"element": 0, "force": cubic}, ACCELERATIONS),
    "friction": (Place("element", "j1"), {"element": 1, "force": friction}, PARTIAL),
}


@pytest.fixture(scope="module")
def found(campaign, wrong):
    """Every case of the list above, located."""
    return {
        name: (place, located(campaign, 3, wrong(**lacking), **more))
        for name, (place, lacking, more) in CASES.items()
    }


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_the_place_is_found_from_whatever_is_measured(found, name):
    place, (_, _, result) = found[name]
    best = result.groups[0]
    assert place in best.places or place in best.twins
    assert result.p_value < 1e-12
    assert best.share > 0.9
    assert best.left == pytest.approx(1.0, abs=0.3)
    others = [g for g in result.groups if place not in (*g.places, *g.twins)]
    assert others[0].score < 0.99 * best.score


@pytest.mark.long
def test_places_that_the_sensors_cannot_tell_apart_are_named_together(found):
    _, (_, _, result) = found["base"]
    assert Place("node", "m1") in result.group(Place("element", "j0")).places
    assert Place("base", "base") in result.group(Place("element", "j0")).twins
    _, (_, _, whole) = found["cubic"]
    assert whole.group(Place("element", "j0")).twins == ()


@pytest.mark.long
def test_the_base_comes_before_its_twins_and_before_nothing_else(found):
    _, (_, _, result) = found["base"]
    others = [g for g in result.groups if Place("base", "base") not in g.places]
    twin = next(g for g in others if Place("base", "base") in g.twins)
    rest = tuple(g for g in result.groups if g is not twin)
    behind = dataclasses.replace(result, groups=(twin, *rest))
    assert Place("base", "base") in behind.with_base_first().groups[0].places
    _, (_, _, whole) = found["cubic"]
    assert whole.with_base_first() is whole


def test_only_the_base_comes_before_a_place_with_a_parallel_transfer():
    rig = chain([2.0, 1.0], [800.0, 600.0], dampings_n_s_per_m=[1.6, 1.0])
    rig = dataclasses.replace(
        rig,
        inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m2", unit="m"),),
    )
    plant, rng = Plant.of(rig), np.random.default_rng(5)
    push = rng.standard_normal((200, 1))
    seen = plant.simulate(plant.values, push, 64.0) + 1e-5 * rng.standard_normal((200, 1))
    trials = (Trial(inputs=push, outputs=seen, rate_hz=64.0),)
    result = locate(refit(plant, trials, horizons=(1.0,)), trials)
    own, base = Place("element", rig.elements[0].id), Place("base", "base")
    other, beyond = Place("node", "m2"), Place("element", rig.elements[1].id)

    def order(*twins):
        """Groups of `own`, whose transfer is parallel to those of `twins`, then of others."""
        groups = tuple(
            dataclasses.replace(result.groups[0], places=(place,), twins=alike)
            for place, alike in ((own, twins), (beyond, ()), (other, (own,)), (base, (own,)))
        )
        moved = dataclasses.replace(result, groups=groups).with_base_first()
        return [group.places[0] for group in moved.groups]

    assert order(base) == [base, own, beyond, other]
    assert order(other, base) == [base, own, beyond, other]
    assert order(other) == [own, beyond, other, base]
    assert order(other, beyond) == [own, beyond, other, base]
    assert order() == [own, beyond, other, base]


@pytest.mark.long
@pytest.mark.parametrize(("name", "grows"), [("base", False), ("cubic", True), ("jump", True)])
def test_a_motion_of_the_base_knows_nothing_of_what_drives_the_structure(found, name, grows):
    _, (_, _, result) = found[name]
    assert _grows(result, Place("base", "base")) is grows


def test_what_grows_with_the_drive_is_not_named_a_motion_of_the_base(found, monkeypatch):
    _, (_, _, result) = found["base"]
    kinds = catalogue()
    named = base_motion(result.with_base_first(), [], kinds, first=True)
    assert named is not None
    assert named.effect.kind == "base_motion"
    monkeypatch.setattr("slowtime.discrepancy.proposers.base_motion._grows", lambda *_: True)
    assert base_motion(result.with_base_first(), [], kinds, first=True) is None


def test_the_force_is_recovered_with_an_honest_error(found):
    rig, trials, result = found["cubic"][1]
    names = [s.channel for s in rig.description.sensors]
    for number, trial in enumerate(trials):
        latent = result.latent(Place("element", "j1"), number)
        x1, x2 = (trial.outputs[:, names.index(n)] for n in ("x1", "x2"))
        assert np.std(latent.motion.e - (x2 - x1)) < 3 * np.std(x2) * 10**-1.5
        basis = np.stack([latent.motion.e, latent.motion.v], axis=1)
        missing = cubic(latent.motion.e, 0, 0)
        # A straight line is the stiffness's own business, within its tolerance.
        line = np.linalg.lstsq(basis, latent.force - missing, rcond=None)[0]
        error = latent.force - missing - basis @ line
        assert np.std(error) < 2 * latent.sd
        assert np.std(error) < 0.25 * np.std(missing)


@pytest.mark.long
@pytest.mark.parametrize("seed", [3, pytest.param(6, marks=pytest.mark.long)])
def test_accelerometers_tell_a_motion_and_not_their_noise_at_low_frequency(
    campaign, wrong, seed
):
    rig, trials = campaign(
        seed,
        wrong(element=0, force=unstable),
        mode="states",
        masses=1,
        snr_db=20.0,
        seconds=40.0,
    )
    names = [s.channel for s in rig.description.sensors]
    felt = np.array([name.startswith("a") for name in names])
    trials = [
        dataclasses.replace(trial, use=np.tile(felt, (len(trial.outputs), 1)))
        for trial in trials
    ]
    result = locate(refit(Plant.of(rig.description), trials), trials)
    for number, trial in enumerate(trials):
        moved = trial.outputs[:, names.index("x1")]
        told = result.latent(Place("element", "j0"), number).motion.e
        assert np.std(told - moved) < 0.5 * np.std(moved)


def test_character_tells_what_kind_of_force_it_is(found):
    told = {
        name: characterise(result, place) for name, (place, (_, _, result)) in found.items()
    }
    assert told["cubic"].exponent == pytest.approx(3.0, abs=0.6)
    assert told["cubic"].static_share > 0.97
    assert told["cubic"].odd > 0.99
    assert told["cubic"].steady is True
    some, still = MotionRange(rms=0.002, peak=0.0081), MotionRange(rms=0.0, peak=0.0)
    moving = dataclasses.replace(told["cubic"], elongation=some, rate=some, onset=0.001)
    assert moving.amplitude("an elongation", "m") == (
        "The force acts at an elongation of 0.002 m rms, 0.0081 m at most, and a rate of "
        "0.002 m/s rms, 0.0081 m/s at most; hardly any below 0.001 m."
    )
    assert dataclasses.replace(moving, elongation=still, rate=still).amplitude("it", "m") == ""
    turning = dataclasses.replace(moving, elongation=still, onset=0.0)
    assert "acts at a rate of 0.002 rad/s rms" in turning.amplitude("an elongation", "rad")
    assert told["friction"].exponent < 0.5
    assert told["friction"].odd > 0.9
    assert told["base"].static_share < 0.1
    assert not any(one.linear for one in told.values())


def test_a_change_is_dated(found):
    place, (_, _, result) = found["jump"]
    told = characterise(result, place)
    assert told.times_s
    assert told.times_s[0][0] == pytest.approx(32.0, abs=1.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", MORE)
def test_the_place_is_found_in_other_cases_too(campaign, wrong, name):
    place, lacking, more = MORE[name]
    _, _, result = located(campaign, 5, wrong(**lacking), **more)
    assert place in (*result.groups[0].places, *result.groups[0].twins)
    told = characterise(result, place)
    assert told.linear == (name == "sensor")
    if name == "gap":
        assert 5e-4 < told.onset < 5e-3


def test_nothing_is_found_where_nothing_is_missing(campaign, wrong):
    cases: list[tuple[int, dict[str, Any]]] = [
        (0, {"mode": "accelerations", "pole": 0.9, "kick": 1.0, "stiffness_sd": 0.05}),
        (1, {"masses": 1, "mode": "accelerations", "drive": "base"}),
    ]
    for seed, more in cases:
        _, _, result = located(campaign, seed, wrong(), **more)
        assert result.p_value > 1e-3


@pytest.mark.long
def test_gaps_in_a_channel_do_not_hide_the_place(campaign, wrong):
    rig, trials = campaign(3, wrong(element=1, force=cubic), mode="accelerations", seconds=10.0)
    use = np.ones(trials[0].outputs.shape, dtype=bool)
    use[300:420, 1] = use[700:705, 0] = False
    holed = [dataclasses.replace(trial, use=use) for trial in trials]
    result = locate(refit(Plant.of(rig.description), holed), holed)
    assert result.best == Place("element", "j1")
    assert result.groups[0].left < 1.5
    with pytest.raises(ValueError, match="was not examined"):
        result.group(Place("element", "none"))


@pytest.mark.long
def test_a_sensor_that_says_nothing_does_not_lessen_what_the_others_leave(campaign, wrong):
    rig, trials = campaign(3, wrong(element=1, force=cubic), mode="states", seconds=10.0)
    heard = np.arange(trials[0].outputs.shape[1]) % 3 == 0
    deaf = [
        dataclasses.replace(trial, use=np.tile(heard, (len(trial.outputs), 1)))
        for trial in trials
    ]
    result = locate(refit(Plant.of(rig.description), deaf), deaf)
    right = next(g for g in result.groups if Place("element", "j1") in (*g.places, *g.twins))
    assert right.left > 0.7


@pytest.mark.parametrize("by_modes", [True, False])
def test_free_decays_have_the_spectrum_of_what_is_run(campaign, by_modes):
    rig, _ = campaign(0, masses=2, seconds=1.0, levels=(1.0,))
    linear = LinearModel.of(rig.description)
    modes = linear.state_modes() if by_modes else None
    spectra = linear.free_decay_spectra(np.fft.rfftfreq(300, 1 / 50.0), 300, 50.0, modes)
    for k, state in enumerate(np.eye(4)):
        sensed, motion = linear.free_decay(300, 50.0, state)
        plain = transform(sensed, 50.0)[1]
        assert spectra.sensor_response[:, :, k] == pytest.approx(plain, rel=1e-6, abs=1e-9)
        for order in range(3):
            plain = transform(motion[order], 50.0)[1]
            assert spectra.moved(state)[order] == pytest.approx(plain, rel=1e-6, abs=1e-9)


def test_free_decays_of_what_floats_have_the_spectrum_of_what_is_run():
    alone = Description(
        name="one",
        nodes=(Node(id="m", mass_kg=2.0),),
        elements=(),
        sensors=(Sensor(channel="x", quantity="displacement", node="m", unit="m"),),
    )
    linear = LinearModel.of(alone)  # both its poles are 0: no matrix of modes has an inverse
    assert linear.state_modes() is None
    spectra = linear.free_decay_spectra(np.fft.rfftfreq(300, 1 / 50.0), 300, 50.0)
    state = np.array([0.5, 2.0])
    plain = transform(linear.free_decay(300, 50.0, state)[0], 50.0)[1]
    # On its own line, at 0, a pole is told of no more.
    assert (spectra.sensor_response @ state)[1:] == pytest.approx(plain[1:], rel=1e-5)


def test_a_steady_response_by_modes_is_that_by_inverses(campaign):
    rig, _ = campaign(0, masses=3, seconds=1.0, levels=(1.0,))
    linear = LinearModel.of(rig.description)
    lines = np.linspace(0.0, 30.0, 50)
    dense, modal = (linear.steady_response(lines, m) for m in (None, linear.state_modes()))
    size = np.abs(linear.compliance(lines)).max()
    force = np.random.default_rng(1).standard_normal((50, 3)) + 0j
    assert modal.displacement(force) == pytest.approx(
        dense.displacement(force), rel=1e-9, abs=1e-12 * size
    )
    rows = np.array([[1.0, 0.0, -1.0]])
    assert modal.seen_by(rows) == pytest.approx(dense.seen_by(rows), rel=1e-9, abs=1e-12 * size)


def test_changed_constants_change_the_residual_as_the_plant_does(campaign):
    rig, trials = campaign(1, masses=2, seconds=20.0, levels=(1.0,), drive="base")
    plant, trial = Plant.of(rig.description), trials[0]
    linear = LinearModel.of(rig.description)
    names = tuple((name[0], str(name[1])) for name in plant.parameters)
    known = LinearConstants.of(linear, names, np.zeros(6), np.ones(6))
    change = np.array([0.05, -0.04, 0.3, -0.2, 0.02, -0.03])
    residuals, runs = [], []
    for values in (plant.values, plant.values * (1 + change)):
        run = plant.run(values, trial.inputs, trial.rate_hz)
        residuals.append(trial.outputs - run.outputs)
        runs.append(np.stack([run.states[:, :2], run.states[:, 2:4], run.rates[:, 2:4]]))
    noise = white_noise([[1.0] * 6])
    lines = [
        trial_lines(linear, trial, r, q, noise, 0, 20.0)
        for r, q in zip(residuals, runs, strict=True)
    ]
    tuned = PerturbedReference.of(linear, lines[0], known, change)
    both = np.concatenate([tuned.decays.real, tuned.decays.imag]).reshape(-1, 4)
    for got, wanted in ((tuned.residual, lines[1].residual),):
        miss = np.concatenate([(got - wanted).real, (got - wanted).imag]).reshape(-1)
        # Initial states are free in what follows, and so they are here.
        rest = miss - both @ np.linalg.lstsq(both, miss, rcond=None)[0]
        effect = np.linalg.norm(lines[1].residual - lines[0].residual)
        assert np.linalg.norm(rest) < 0.01 * effect


def test_columns_are_the_slopes_of_the_residual(campaign):
    rig, trials = campaign(1, masses=2, seconds=10.0, levels=(1.0,), drive="base")
    plant, trial = Plant.of(rig.description), trials[0]
    linear = LinearModel.of(rig.description)
    names = tuple((name[0], str(name[1])) for name in plant.parameters)
    known = LinearConstants.of(linear, names, np.zeros(6), np.ones(6))
    run = plant.run(plant.values, trial.inputs, trial.rate_hz)
    motion = np.stack([run.states[:, :2], run.states[:, 2:4], run.rates[:, 2:4]])
    noise = white_noise([[1.0] * 6])
    lines = trial_lines(linear, trial, trial.outputs - run.outputs, motion, noise, 0, 20.0)
    still = PerturbedReference.of(linear, lines, known, np.zeros(6))
    columns = still.columns(known, lines.motion, lines.base)
    for i in range(6):
        step = 1e-6 * np.eye(6)[i]
        slope = (
            lines.residual - PerturbedReference.of(linear, lines, known, step).residual
        ) / 1e-6
        assert columns[:, :, i] == pytest.approx(
            slope, rel=1e-3, abs=1e-4 * np.abs(slope).max()
        )


def test_gains_by_chance_are_as_rare_as_is_said():
    rng = np.random.default_rng(0)
    power = rng.exponential(size=(4000, 12, 40))
    # Of one band of equal lines the likeliest variance is the mean, less the noise.
    mean = np.maximum(power.mean(axis=2), 1.0)
    gain = (40 * (power.mean(axis=2) * (1 - 1 / mean) - np.log(mean))).sum(axis=1)
    chances = np.array([gain_probability(g, 12) for g in gain])
    for level in (0.3, 0.1, 0.01):
        expected = scipy.stats.binom.interval(0.9999, 4000, level)
        assert expected[0] * 0.8 < np.sum(chances < level) < expected[1] * 1.2
    assert gain_probability(10.0, 12, 5) == pytest.approx(5 * gain_probability(10.0, 12))


def test_a_trial_of_noise_alone_has_series_and_spectrum_of_one_scale(campaign):
    rig, trials = campaign(2, masses=1, seconds=5.0, levels=(1.0,))
    linear = LinearModel.of(rig.description)
    rest = np.zeros((3, len(trials[0].outputs), 1))
    lines = trial_lines(
        linear, trials[0], trials[0].outputs, rest, white_noise([[1.0] * 3]), 0, 50.0
    )
    assert lines.series(lines.residual) == pytest.approx(trials[0].outputs)


HIDDEN = {
    "effect": "extra_dof",
    "node": "m1",
    "mass_kg": 0.2,
    "frequency_hz": 5.0,
    "damping_n_s_per_m": 0.4,
}
TURNED = {"effect": "sensor_gain", "sensor": "a1", "gain": -0.6}


@pytest.mark.long
@pytest.mark.parametrize("effect", [HIDDEN, TURNED], ids=lambda one: one["effect"])
def test_transfers_have_the_linear_effects_of_the_reference_in_them(campaign, effect):
    rig, trials = campaign(4, masses=2, seconds=20.0, levels=(1.0,), mode="accelerations")
    pushed = Input(channel="w", kind="force", node="m1", unit="N")
    description = dataclasses.replace(
        rig.description, effects=(effect,), inputs=(*rig.description.inputs, pushed)
    )
    plant, drive = Plant.of(description), trials[0].inputs
    still = np.concatenate([drive, 0 * drive], axis=1)
    both = np.concatenate([drive, drive], axis=1)
    trial = dataclasses.replace(trials[0], inputs=still)
    runs = [plant.run(plant.values, inputs, 64.0) for inputs in (still, both)]
    linear = LinearModel.of_plant(plant, plant.values)
    known = LinearConstants.of(linear, (("stiffness", "j0"),), np.zeros(1), np.ones(1))
    rest, moving = np.split(runs[0].states, 2, axis=1)
    motion = np.stack([rest, moving, np.split(runs[0].rates, 2, axis=1)[1]])
    more = runs[1].outputs - runs[0].outputs
    noise = white_noise([[1.0] * 2])
    lines = trial_lines(linear, trial, more, motion, noise, 0, 14.0)
    tuned = PerturbedReference.of(linear, lines, known, np.zeros(1))
    source = next(s for s in linear.sources() if s.place == Place("node", "m1"))
    force = transform(drive, 64.0)[1][: len(lines.frequency_hz)]
    miss = lines.residual - tuned.transfer(source) * force
    decays = np.concatenate([tuned.decays.real, tuned.decays.imag])
    decays = decays.reshape(-1, runs[0].states.shape[1])
    left = np.concatenate([miss.real, miss.imag]).reshape(-1)
    left = left - decays @ np.linalg.lstsq(decays, left, rcond=None)[0]
    assert np.linalg.norm(left) < 0.01 * np.linalg.norm(lines.residual)


@pytest.mark.long
def test_what_a_wrong_clock_tells_of_a_missing_force_is_put_where_it_was(campaign, wrong):
    missing = wrong(element=1, force=cubic)
    rig, trials = campaign(6, missing, masses=2, seconds=30.0, mode="states")
    skew = np.array([0.006])

    def told(trial):
        times = np.arange(len(trial.outputs)) / trial.rate_hz
        late = timed(trial.outputs[:, 0], times, skew)
        return dataclasses.replace(trial, outputs=np.column_stack([late, trial.outputs[:, 1:]]))

    late = tuple(told(trial) for trial in trials)
    effect = {"effect": "sensor_clock", "sensor": "x1", "skew": 0.006}
    plant = Plant.of(dataclasses.replace(rig.description, effects=(effect,)))
    found = locate(refit(plant, late), late)
    assert found.groups[0].places[0] == Place("element", "j1")
    assert found.groups[0].left < 1.5


@pytest.mark.long
@pytest.mark.parametrize("size", [np.inf, np.nan, 1.5e308])
def test_a_motion_that_grows_beyond_bounds_is_followed_no_further(
    campaign, wrong, monkeypatch, size
):
    def away(self, found):
        self.white = [
            dataclasses.replace(one, inner=np.full_like(one.inner, size)) for one in self.white
        ]

    monkeypatch.setattr(latent._PlaceIteration, "relinearise", away)
    rubs = wrong(element=1, force=friction)
    _, _, result = located(campaign, 3, rubs, masses=2, seconds=10.0, levels=(1.0,))
    assert Place("element", "j1") in result.groups[0].places


@pytest.mark.long
@pytest.mark.parametrize("density", [1e-12, 1e-20, 1e-28])
def test_a_force_beside_which_noise_is_next_to_nothing_is_located(campaign, wrong, density):
    """Of all that it takes part in, rounding leaves less than nothing."""
    quintic = wrong(element=0, force=lambda e, v, t: 3e12 * e**5)
    rig, trials = campaign(
        9, quintic, masses=1, mode="accelerations", levels=(2.0,), seconds=8.0
    )
    noise = white_noise([[density]])
    fit = refit(Plant.of(rig.description), trials, noise=noise, free=())
    found = locate(fit, trials)
    first, place = found.groups[0], Place("element", "j0")
    assert place in (*first.places, *first.twins)
    assert np.isfinite(found.latent(place, 0).force).all()


def test_a_force_is_believed_by_the_record_that_tells_of_it_whichever_that_is():
    """In one that tells of none, what little it heard would be taken for loud."""
    band = np.repeat([0, 1], 50)
    trial = Mock(spec=TrialLines, weight=np.ones(100), band=band, bands=2)
    loud = np.where(band == 0, 1.0, 3.0)
    quiet = np.where(band == 0, 1e-3, 400.0)  # its noise, where the sensors hardly hear
    heard, deaf = np.where(band == 0, 1e4, 1e-2), np.where(band == 0, 1e3, 1e-4)
    seen = [np.sqrt(one).astype(complex) for one in (heard**2 * loud + heard, deaf)]
    for order in ((0, 1), (1, 0)):
        variances = [(loud, quiet)[i] for i in order]
        believed = latent._capped_variances(
            [trial, trial],
            [seen[i] for i in order],
            [(heard, deaf)[i] for i in order],
            variances,
        )
        assert np.array_equal(believed[order.index(0)], loud)
        assert believed[order.index(1)].max() == latent.MAX_VARIANCE_RATIO * 1.0
        assert np.array_equal(believed[order.index(1)][:50], quiet[:50])

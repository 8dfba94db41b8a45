"""Laws that neither a force nor a long run tells are told by segments of the records."""

import dataclasses
import itertools
import math
import sys

import numpy as np
import pytest

from slowtime.discrepancy.calibration import (
    Fit,
    FitAbandoned,
    FitControl,
    cut_segments,
    initial_states_of_records,
    refit,
    shooting_fit,
    strongest_segments,
)
from slowtime.discrepancy.calibration.augmentation import augmented_start
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import (
    Candidate,
    label_of,
    library_candidates,
)
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.localization import Localization, locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import Proposal
from slowtime.discrepancy.proposers.segments import (
    FEW_SEGMENTS,
    MAX_LAWS,
    MAX_NEAR_LAWS,
    MAX_PROPOSED,
    MAX_REST_OF_FEW,
    MAX_REST_OF_MORE,
    MIN_LAWS_PER_PLACE,
    MIN_QUIET_CHI2,
    MORE_SEGMENTS,
    NEAR_RATIO,
    PLACE_REST_RATIO,
    POWER_SHARES,
    START_FORCE_RATIO,
    Segments,
)  # fmt: skip
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.workers import shared_among
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.effects import Effect, Place, catalogue, force_along
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from slowtime_services.engines.forks import ForkedWorkers
from tests.slowtime.discrepancy.protocol import candidate, fitted_candidate, round_of
from tests.slowtime.discrepancy.rigs import ONE, PLACE
from tests.slowtime.discrepancy.three_mass_chain import (
    EVERY,
    GROUND,
    MIDDLE,
    TOP,
    recorded,
)

NAMES = (
    "quadratic_stiffness", "cubic_hardening", "gap_symmetric", "gap_one_sided",
    "quadratic_damping", "viscous_damping", "stiffness_loss", "stiffness_jump", "extra_dof",
    "harmonic_force",
)  # fmt: skip
KINDS = {name: kind for name, kind in catalogue().items() if name in NAMES}
TURNED = {
    name: catalogue()[name]
    for name in ("pendulum_sine", "viscous_damping", "quadratic_damping", "stiffness_jump")
}
SOFT = Effect("quadratic_stiffness", MIDDLE, {"k2_n_per_m2": -2.5e3})
STOP = Effect("gap_one_sided", GROUND, {"kg_n_per_m": 4000.0, "gap_m": 0.01, "side": -1.0})
HARD = Effect("cubic_hardening", TOP, {"k3_n_per_m3": 3e6})
DAMPED = Effect("quadratic_damping", GROUND, {"c2_n_s2_per_m2": 300.0})
TONE = Effect(
    "harmonic_force", Place("node", "m1"),
    {"amplitude_n": 6.0, "frequency_hz": 3.1, "phase_rad": 0.4},
)  # fmt: skip


class Remembered:
    """Fits to segments as `shooting_fit` does, the same ones once."""

    def __init__(self):
        self.known: dict[object, tuple[Fit, list[np.ndarray]]] = {}

    def __call__(self, plant, parts, noise, values, control):
        heard = tuple(part.outputs.tobytes() for part in parts)
        key = (
            repr(plant.description),
            tuple(plant.kinds),
            hash(heard),
            values.tobytes(),
            control.cost_to_beat,
        )
        if key not in self.known:
            self.known[key] = shooting_fit(plant, parts, noise, values, control)
        return self.known[key]


SHOOT = Remembered()


@dataclasses.dataclass(frozen=True)
class Lacking:
    """A model without what its records show, and what a force says of that."""

    before: Fit
    trials: tuple[Trial, ...]
    located: Localization
    tried: list[Candidate]

    def round(self, tried=None, labels=None, kinds=KINDS, **more):
        """Give the round in which laws are tried, those of the shortlist before others."""
        some = self.tried if tried is None else tried
        return round_of(
            self.before, self.trials, kinds, tried=some,
            shortlist=some[:3] if labels is None else labels, localized=self.located, **more,
        )  # fmt: skip

    def told(self, tried=None, labels=None, shoot=SHOOT, **more):
        """Give what is proposed, with what it leaves of the segments."""
        some = self.tried if tried is None else tried
        first = some[:3] if labels is None else labels
        names = {one.effect.kind for one in (*some, *first)}
        kinds = KINDS if tried is None else {name: KINDS[name] for name in names}
        # What they leave along the force is no bound here for what they leave of segments.
        first = [dataclasses.replace(one, cost=math.inf) for one in first]
        return Segments(shoot=shoot)(self.round(some, first, kinds, **more)).candidates


def lacking(*effects, level=8.0):
    trials = recorded(EVERY, effects, level=level, seconds=12.0)
    before = refit_within_tolerances(refit(Plant.of(EVERY, kinds=KINDS), trials), trials)
    located = locate(before, trials)
    return Lacking(before, trials, located, library_candidates(before, located, KINDS))


@pytest.fixture(scope="module")
def stop():
    return lacking(STOP)


@pytest.fixture(scope="module")
def two():
    return lacking(STOP, Effect("cubic_hardening", MIDDLE, {"k3_n_per_m3": 3e5}))


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "level"), [(SOFT, 4.0), (STOP, 8.0), (HARD, 2.0), (HARD, 8.0), (DAMPED, 8.0)]
)
def test_segments_tell_a_strong_law_and_its_strength(effect, level):
    given = lacking(effect, level=level)
    best, *others = given.told()
    assert label_of(best.effect) == label_of(effect)
    assert best.cost < 1.2 * given.before.data
    assert best.cost_without > LIMITS.far_off_chi2 * given.before.data
    assert len(others) < MAX_PROPOSED
    for name, value in effect.parameters.items():
        assert best.effect.parameters[name] == pytest.approx(value, rel=0.03)
    # From there the whole of the records is in the basin of the right minimum.
    claimed = dict(zip(given.before.plant.parameters, given.before.plant.values, strict=True))
    assert best.start is not None
    for name, value in best.start.constants.items():
        assert value == pytest.approx(claimed[name], rel=0.1)
    assert best.start.from_segments
    assert len(best.start.states) == len(given.trials)


@pytest.mark.long
def test_a_one_sided_law_is_tried_on_both_sides(stop):
    (right,) = [one for one in stop.tried if label_of(one.effect) == label_of(STOP)]
    for side in (1.0, -1.0):
        parameters = dict(right.effect.parameters) | {"side": side}
        guessed = dataclasses.replace(
            right, effect=dataclasses.replace(right.effect, parameters=parameters)
        )
        (told,) = stop.told([guessed])
        assert told.effect.parameters["side"] == -1.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("instant", "guessed"),
    [(2.0, 11.8), (6.1, 11.8), (9.3, 11.8), (5.0, 5.0)],
)
def test_a_switch_is_looked_for_all_over_the_segments_and_where_a_force_told_it(
    instant, guessed
):
    """At 5 s it is found from none of the instants that are tried anyway."""
    jump = Effect("stiffness_jump", GROUND, {"dk_n_per_m": 500.0, "t_jump_s": instant})
    strength = 500.0 if guessed == instant else 200.0
    guess = dataclasses.replace(jump, parameters={"dk_n_per_m": strength, "t_jump_s": guessed})
    (told,) = lacking(jump).told([candidate(guess, 1.0, cost_without=9.0)])
    assert told.effect.parameters["t_jump_s"] == pytest.approx(instant, abs=0.005)
    assert told.effect.parameters["dk_n_per_m"] == pytest.approx(500.0, rel=5e-3)


@pytest.mark.long
def test_where_the_right_law_is_not_tried_nothing_is_proposed(stop):
    others = [
        one for one in stop.tried if one.effect.kind in ("viscous_damping", "stiffness_loss")
    ]
    assert others
    assert stop.told(others) == ()
    assert stop.told([], []) == ()


@pytest.mark.long
def test_a_hidden_oscillator_is_not_tried_on_segments():
    given = lacking(TONE, level=1.0)
    kinds = {one.effect.kind for one in given.tried}
    assert "extra_dof" in kinds
    riding = [one for one in given.tried if one.effect.kind == "extra_dof"]
    assert given.told(riding, riding) == ()
    assert {one.effect.kind for one in given.told()} == {"harmonic_force"}


@pytest.mark.long
def test_the_stronger_of_two_is_proposed_alone(two):
    best = two.told()[0]
    assert label_of(best.effect) == label_of(STOP)
    assert (
        LIMITS.segment_chi2 * two.before.data < best.cost < MAX_REST_OF_MORE * best.cost_without
    )
    # Of segments it leaves more than noise: it is not all that is missing.
    proposal = Segments(shoot=SHOOT)(two.round())
    assert proposal.candidates
    assert proposal.shot == ()


@pytest.mark.long
def test_out_of_budget_nothing_is_proposed(stop):
    counts = itertools.count()
    late = Monitor(late=lambda: next(counts) > 40)
    assert stop.told(shoot=shooting_fit, monitor=late) == ()
    assert next(counts) > 40
    with metered() as meter:
        assert stop.told(shoot=shooting_fit, monitor=Monitor(late=lambda: True)) == ()
    assert meter.spent == 0


@pytest.mark.long
def test_few_laws_are_fitted_to_few_segments_and_fewer_to_more(stop):
    fits = []

    def counted(plant, parts, *args):
        own = tuple(label_of(effect) for effect in plant.effects)
        fits.append((own, len(parts[0].outputs)))
        return SHOOT(plant, parts, *args)

    stop.told(shoot=counted)
    short, long = sorted({length for _, length in fits})
    first = {label for label, length in fits if length == short}
    then = {label for label, length in fits if length == long}
    assert len(first - {()}) <= MAX_LAWS
    assert len(then - {()}) <= MAX_NEAR_LAWS
    assert then < first
    assert {()} < then


@pytest.mark.long
def test_segments_are_asked_first_where_no_force_explains_what_is_missing(stop):
    data, first = stop.before.data, Segments(only=True, shoot=SHOOT)

    def shortlisted(share):
        return stop.round(
            labels=[dataclasses.replace(stop.tried[0], cost=share * LIMITS.far_off_chi2 * data)]
        )

    assert first(stop.round(labels=[])).candidates == ()
    assert first(shortlisted(0.9)).candidates == ()
    far = shortlisted(1.1)
    proposal = first(far)
    (told,) = proposal.candidates
    assert proposal.only
    assert proposal.begins == label_of(told.effect) == label_of(STOP)
    # Where the shortlist leaves a smaller share of whole records, it is fitted as well: within
    # a segment a clock that runs fast is a sensor that is late.
    better = dataclasses.replace(far.shortlist[0], cost_without=1e9 * far.shortlist[0].cost)
    both = first(dataclasses.replace(far, shortlist=(better,)))
    assert [label_of(one.effect) for one in both.candidates] == [label_of(told.effect)]
    assert not both.only
    # Once asked, they are not asked again, nor where other candidates stand in place already.
    with metered() as meter:
        beside = dataclasses.replace(far, proposals=(both,))
        assert Segments(shoot=shooting_fit)(beside).candidates == ()
        again = dataclasses.replace(far, proposals=(proposal,))
        assert Segments(shoot=shooting_fit)(again).candidates == ()
        clocks = Proposal("sensor clocks", (told,), only=True)
        instead = dataclasses.replace(far, proposals=(clocks,))
        assert Segments(only=True, shoot=shooting_fit)(instead).candidates == ()
        assert first(dataclasses.replace(far, number=1)).candidates == ()
    assert meter.spent == 0


@pytest.mark.long
def test_segments_are_asked_later_where_what_was_fitted_explains_little(stop):
    near = dataclasses.replace(stop.tried[0], cost=0.01 * stop.before.data)

    def after(share):
        law = fitted_candidate(STOP, stop.before, chi2_in_band=share * LIMITS.far_off_chi2)
        return stop.round(labels=[near], fitted=(law,))

    assert Segments(shoot=SHOOT)(after(0.9)).candidates == ()
    proposal = Segments(shoot=SHOOT)(after(1.1))
    (told,) = proposal.candidates
    # It comes as early as the best along the force does.
    assert told.cost == near.cost < proposal.shot[0].cost
    assert [label_of(one.effect) for one in proposal.shot] == [label_of(STOP)]


@pytest.mark.long
def test_a_diagnosis_begins_with_what_the_segments_tell():
    trials = recorded(EVERY, (STOP,), level=8.0, seconds=20.0)
    (told,) = diagnose(Campaign(description=EVERY, trials=trials), kinds=KINDS).effects
    assert label_of(told.effect) == label_of(STOP)
    assert told.effect.parameters["kg_n_per_m"] == pytest.approx(4000.0, rel=0.02)


@pytest.fixture(scope="module")
def overturned():
    """A pendulum that turns over now and then, and a model without gravity."""
    one = dataclasses.replace(
        ONE,
        unit_of_coordinate="rad",
        inputs=(Input(channel="u", kind="force", node="m1", unit="N m"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="rad"),),
    )
    effect = Effect("pendulum_sine", PLACE, {"k": 800.0})
    truth = Plant.of(dataclasses.replace(one, effects=(effect.entry(),)))
    found = []
    for seed in (5, 6):
        rng = np.random.default_rng(seed)
        push = 90.0 * np.convolve(rng.standard_normal(3000), np.hanning(9), "same")[:, None]
        seen = truth.simulate(truth.values, push, 100.0)
        heard = seen + 0.02 * rng.standard_normal(seen.shape)
        found.append(Trial(inputs=push, outputs=heard, rate_hz=100.0))
    assert np.abs(found[1].outputs).max() > 2 * np.pi
    trials = tuple(found)
    return refit_within_tolerances(refit(Plant.of(one, kinds=TURNED), trials), trials), trials


@pytest.mark.long
def test_a_quieter_part_tells_the_law_of_a_motion_that_turns_over(overturned):
    before, trials = overturned
    located = locate(before, trials)
    tried = library_candidates(before, located, TURNED)
    given = round_of(
        before, trials, TURNED, tried=tried, shortlist=tried[:2], localized=located
    )
    proposal = Segments()(given)
    assert proposal.begins == ("pendulum_sine", PLACE)
    assert proposal.shot[0].effect.parameters["k"] == pytest.approx(800.0, rel=2e-3)
    assert len(proposal.shot) == len(proposal.candidates)


@pytest.mark.parametrize("share", [*POWER_SHARES, 1.0])
def test_in_a_quieter_part_a_law_is_found_from_farther_off(overturned, share):
    before, trials = overturned
    plant, _, _ = augmented_start(before, Effect("pendulum_sine", PLACE, {"k": 100.0}), TURNED)
    nominal = np.array([entry.value for entry in plant.entries.values()])
    found, _ = shooting_fit(
        plant, strongest_segments(plant, trials, FEW_SEGMENTS, share), before.noise, nominal
    )
    quiet = share < 1.0
    assert (found.chi2_in_band < 1.2) == quiet
    assert (found.values[-1] == pytest.approx(800.0, rel=2e-3)) == quiet


def test_the_likeliest_are_tried_first_then_laws_that_explain_nothing_then_the_others(
    stop, scripted
):
    names = ("gap_symmetric", "viscous_damping", "stiffness_loss", "cubic_hardening",
             "quadratic_damping")  # fmt: skip
    groups = tuple(
        dataclasses.replace(stop.located.group(place), places=(place,), left=1.0)
        for place in (GROUND, TOP)
    )
    several = dataclasses.replace(
        stop, located=dataclasses.replace(stop.located, groups=groups)
    )
    script = scripted()
    several.told(laws(stop, *names), laws(stop, "quadratic_stiffness", place=TOP), script)
    first = [kind for kind, few, _ in script.asked if kind][: 1 + MIN_LAWS_PER_PLACE]
    assert first == ["quadratic_stiffness", *names[:MIN_LAWS_PER_PLACE]]
    assert script.asked[-1][0] == names[MIN_LAWS_PER_PLACE]
    assert "quadratic_stiffness" in [
        kind for kind, _, _ in script.asked[2 + MIN_LAWS_PER_PLACE :]
    ]


def test_a_law_that_explains_nothing_begins_with_half_the_force_and_others_as_told(
    stop, scripted
):
    names = ("viscous_damping", "stiffness_loss", "gap_symmetric", "quadratic_damping",
             "cubic_hardening", "quadratic_stiffness")  # fmt: skip
    many = [replaced for name in names[:4] for replaced in laws(stop, name) * 2]
    tried = [*many, *laws(stop, "quadratic_stiffness")]
    alone = dataclasses.replace(
        stop,
        located=dataclasses.replace(
            stop.located,
            groups=(
                dataclasses.replace(stop.located.group(GROUND), places=(GROUND,), left=1.0),
            ),
        ),
    )
    script = scripted()
    alone.told(tried, laws(stop, "cubic_hardening", place=TOP), script)
    # One that was tried there, if late, begins where it explained most.
    assert script.begun["quadratic_stiffness", GROUND] == {"k2_n_per_m2": 1.0}
    latents = [stop.located.latent(GROUND, i) for i in range(len(stop.trials))]
    size = np.std(np.concatenate([one.force for one in latents]))
    law, numbers = KINDS["cubic_hardening"], script.begun["cubic_hardening", GROUND]
    made = np.concatenate([force_along(law, numbers, one.motion) for one in latents])
    assert np.std(made) == pytest.approx(START_FORCE_RATIO * size)


@pytest.mark.parametrize("unit", ["m", "rad"])
def test_a_law_that_does_not_apply_to_a_structure_is_not_tried(overturned, unit):
    """A pendulum turns by angles."""
    before, trials = overturned
    located = locate(before, trials)
    described = located.linear.description if unit == "rad" else ONE
    linear = dataclasses.replace(located.linear, description=described)
    located = dataclasses.replace(located, linear=linear)
    few = {name: TURNED[name] for name in ("pendulum_sine", "viscous_damping")}
    script = Scripted(Lacking(before, trials, located, []), {"": (100.0, 100.0)})
    given = round_of(before, trials, few, localized=located)
    Segments(shoot=script)(given)
    assert (("pendulum_sine", PLACE) in script.begun) == (unit == "rad")


@pytest.mark.long
def test_a_law_that_seems_to_pull_where_it_pushes_is_tried_all_the_same(stop):
    """Along a motion that was not the one, it explained nothing."""
    tried = [one for one in stop.tried if label_of(one.effect) != label_of(STOP)]
    proposal = Segments(shoot=SHOOT)(stop.round(tried, tried[:3]))
    assert proposal.begins == label_of(STOP)
    told = proposal.candidates[0].effect.parameters["kg_n_per_m"]
    assert told == pytest.approx(4000.0, rel=0.03)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.25])
def test_a_quieter_part_has_so_much_of_the_power_of_the_loudest(share):
    plant = Plant.of(EVERY)
    rng = np.random.default_rng(1)
    outputs = rng.standard_normal((8000, 3)) * np.linspace(0.1, 3.0, 8000)[:, None]
    trial = Trial(inputs=np.zeros((8000, 1)), outputs=outputs, rate_hz=80.0)
    (part,), (loud,) = (
        strongest_segments(plant, (trial,), 4, share),
        strongest_segments(plant, (trial,), 4),
    )
    assert len(part.outputs) == len(loud.outputs)
    power = np.sum(part.outputs**2) / np.sum(loud.outputs**2)
    assert power == pytest.approx(share, rel=0.02)


def test_the_loudest_part_of_each_record_is_as_long_as_its_pieces():
    plant = Plant.of(EVERY)
    rng = np.random.default_rng(1)
    outputs = rng.standard_normal((4000, 3))
    outputs[2500:2900] *= 10.0
    trial = Trial(inputs=np.zeros((4000, 1)), outputs=outputs, rate_hz=80.0, start_s=7.0)
    (part,) = strongest_segments(plant, (trial,), 2)
    assert 2500 <= round((part.start_s - 7.0) * 80.0) < 2900
    assert len(cut_segments(plant, (part,))[0]) == 2
    (whole,) = strongest_segments(plant, (trial,), 10**4)
    np.testing.assert_array_equal(whole.outputs, outputs)


def test_initial_states_are_those_of_the_first_periods(stop):
    plant = Plant.of(dataclasses.replace(EVERY, effects=(STOP.entry(),)), kinds=KINDS)
    moved = np.array([0.01, 0.005, -0.01, 0.1, -0.2, 0.3])
    trials = []
    for trial in stop.trials:
        seen = plant.simulate(plant.values, trial.inputs, trial.rate_hz, state0=moved)
        trials.append(dataclasses.replace(trial, outputs=seen, use=None))
    for state in initial_states_of_records(plant, trials, stop.before.noise, plant.values):
        np.testing.assert_allclose(state, moved, atol=1e-3)


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux")
@pytest.mark.parametrize("count", [2, 3])
def test_several_processes_fit_what_one_fits_with_the_work_of_one(stop, count):
    with metered() as meter:
        alone = stop.told(shoot=shooting_fit)
    with metered() as shared, shared_among(ForkedWorkers(count)):
        together = stop.told(shoot=shooting_fit)
    assert [repr(one) for one in together] == [repr(one) for one in alone] != []
    assert shared.spent == meter.spent


def test_a_fit_to_segments_that_will_not_come_near_is_not_finished(stop):
    plant = stop.before.plant
    parts = strongest_segments(plant, stop.trials, 4)
    full, _ = shooting_fit(plant, parts, stop.before.noise, plant.values)
    control = FitControl(cost_to_beat=full.cost / 1e3)
    cut, _ = shooting_fit(plant, parts, stop.before.noise, plant.values, control)
    assert cut.cost > full.cost


@dataclasses.dataclass
class Scripted:
    """Stands for fits to pieces: what each law leaves of few of them and of more, or raises."""

    given: Lacking
    leaves: dict[str, tuple[float | Exception, float | Exception]]
    asked: list[tuple[str, bool, float | None]] = dataclasses.field(default_factory=list)
    begun: dict[tuple[str, Place], dict[str, float]] = dataclasses.field(default_factory=dict)

    def __call__(self, plant, parts, noise, values, control):
        kind = plant.effects[-1].kind if plant.effects else ""
        few = len(parts[0].outputs) == len(
            strongest_segments(plant, self.given.trials, FEW_SEGMENTS)[0].outputs
        )
        self.asked.append((kind, few, control.cost_to_beat))
        for effect in plant.effects:
            self.begun.setdefault(label_of(effect), dict(effect.parameters))
        left = self.leaves.get(kind, (99.0, 99.0))[0 if few else 1]
        if isinstance(left, Exception):
            raise left
        fit = dataclasses.replace(
            self.given.before, plant=plant, values=plant.values, cost=left, chi2_in_band=left
        )
        return fit, []

    def kinds(self, *, few):
        return {kind for kind, which, _ in self.asked if which is few and kind}


def laws(given, *names, place=GROUND):
    """Laws at one place, whatever is left there."""
    values = {
        "gap_symmetric": {"kg_n_per_m": 1.0, "gap_m": 1.0},
        "viscous_damping": {"dc_n_s_per_m": 1.0},
        "stiffness_loss": {"dk_n_per_m": 1.0},
        "cubic_hardening": {"k3_n_per_m3": 1.0},
        "quadratic_damping": {"c2_n_s2_per_m2": 1.0},
        "quadratic_stiffness": {"k2_n_per_m2": 1.0},
    }
    return [
        candidate(Effect(name, place, values[name]), 1e9, cost_without=1e9) for name in names
    ]


@pytest.fixture
def scripted(stop):
    def made(**leaves):
        leaves = {"": (100.0, 100.0)} | leaves
        return Scripted(stop, {k.replace("bare", ""): v for k, v in leaves.items()})

    return made


@pytest.mark.parametrize(
    ("few", "more", "told"),
    [(59.0, 44.0, True), (61.0, 1.0, False), (1.0, 46.0, False), (FitAbandoned(), 1.0, False)],
    ids=["there", "no hint", "tells nothing", "late"],
)
def test_a_law_is_proposed_that_explains_most_of_few_segments_and_more_of_more(
    stop, scripted, few, more, told
):
    script = scripted(cubic_hardening=(few, more))
    given = stop.told(laws(stop, "viscous_damping", "cubic_hardening"), [], script)
    assert [one.effect.kind for one in given] == ["cubic_hardening"] * told


@pytest.mark.parametrize("error", [np.linalg.LinAlgError(), FloatingPointError()])
def test_a_law_whose_fit_breaks_down_does_not_stop_the_others(stop, scripted, error):
    two = laws(stop, "viscous_damping", "cubic_hardening")
    script = scripted(viscous_damping=(error, error), cubic_hardening=(10.0, 10.0))
    assert [one.effect.kind for one in stop.told(two, [], script)] == ["cubic_hardening"]
    script = scripted(bare=(error, error), cubic_hardening=(10.0, 10.0))
    assert stop.told(two, [], script) == ()


def test_a_side_on_which_a_law_diverges_does_not_hide_the_other(stop, scripted):
    script = scripted(gap_one_sided=(10.0, 10.0))

    def shot_(plant, *args):
        fit, states = script(plant, *args)
        sides = [one.parameters.get("side") for one in plant.effects]
        return dataclasses.replace(fit, cost=math.nan if 1.0 in sides else fit.cost), states

    (told,) = stop.told([candidate(STOP, 1.0, cost_without=9.0)], [], shot_)
    assert told.effect.parameters["side"] == -1.0


def test_each_law_has_to_come_near_what_those_before_it_leave(stop, scripted):
    """And near what the same leaves on its other side."""
    bare, first = 100.0, 20.0
    script = scripted(gap_one_sided=(first, first), viscous_damping=(15.0, 15.0))
    some = [candidate(STOP, 1.0, cost_without=9.0), *laws(stop, "viscous_damping")]
    stop.told(some, [], script)
    beats = [beat for kind, few, beat in script.asked if kind and few]
    assert beats[:3] == [
        NEAR_RATIO * MAX_REST_OF_FEW * bare,
        NEAR_RATIO * first,
        NEAR_RATIO * first,
    ]


def test_laws_that_come_near_the_best_are_fitted_to_more_segments_and_the_best_proposed(
    stop, scripted
):
    names = ("gap_symmetric", "viscous_damping", "stiffness_loss", "cubic_hardening")
    left = (10.0, 12.0, 14.0, 16.0)
    script = scripted(
        quadratic_damping=(21.0, 1.0),
        **{name: (few, 30.0 - few) for name, few in zip(names, left, strict=True)},
    )
    given = stop.told([], laws(stop, "quadratic_damping", *names), script)
    assert script.kinds(few=False) == set(names[:MAX_NEAR_LAWS])
    assert [one.effect.kind for one in given] == ["stiffness_loss", "viscous_damping"]
    assert [one.cost / one.cost_without for one in given] == pytest.approx([0.16, 0.18])


def test_once_a_law_comes_near_others_have_to_come_about_as_near(stop, scripted):
    script = scripted(viscous_damping=(20.0, 20.0), cubic_hardening=(50.0, 50.0))
    stop.told(laws(stop, "viscous_damping", "cubic_hardening"), [], script)
    beats = {kind: beat for kind, few, beat in script.asked if few}
    assert beats[""] is None
    assert beats["viscous_damping"] == pytest.approx(NEAR_RATIO * MAX_REST_OF_FEW * 100.0)
    assert beats["cubic_hardening"] == pytest.approx(NEAR_RATIO * 20.0)


@pytest.mark.parametrize(
    ("other", "tried"), [(0.99 * PLACE_REST_RATIO, True), (1.01 * PLACE_REST_RATIO, False)]
)
def test_laws_are_tried_where_a_force_leaves_about_as_little_as_at_the_best_place(
    stop, scripted, other, tried
):
    groups = [
        dataclasses.replace(stop.located.group(place), places=(place,), left=left)
        for place, left in ((GROUND, 1.0), (TOP, other))
    ]
    near = dataclasses.replace(
        stop, located=dataclasses.replace(stop.located, groups=tuple(groups))
    )
    names = ("gap_symmetric", "viscous_damping", "stiffness_loss", "cubic_hardening",
             "quadratic_damping")  # fmt: skip
    script = scripted()
    top = laws(stop, "quadratic_stiffness", place=TOP)
    near.told([*laws(stop, *names), *top], [], script)
    # What explains nothing at a place is tried there, too.
    every = {*names, "quadratic_stiffness"}
    assert {kind for kind, place in script.begun if place == GROUND} == every
    assert {kind for kind, place in script.begun if place == TOP} == (every if tried else set())
    script = scripted()
    near.told([], top, script)
    assert label_of(top[0].effect) in script.begun


QUIET, LESS, LOUDEST = POWER_SHARES
LAST = [(MORE_SEGMENTS, 1.0)]


@pytest.mark.parametrize(
    ("plain", "cuts"),
    [
        ({QUIET, LESS}, [(FEW_SEGMENTS, QUIET)]),
        ({LESS}, [(FEW_SEGMENTS, QUIET), (FEW_SEGMENTS, LESS)]),
        (set(), [(FEW_SEGMENTS, QUIET), (FEW_SEGMENTS, LESS), (FEW_SEGMENTS, LOUDEST)]),
    ],
    ids=["quiet", "less quiet", "loudest"],
)
@pytest.mark.parametrize("there", [True, False])
def test_the_quietest_part_is_fitted_of_which_the_model_leaves_much(stop, plain, cuts, there):
    plant = stop.before.plant
    # Records that grow louder, so that each part is another one.
    ramp = np.linspace(0.1, 3.0, len(stop.trials[0].outputs))[:, None]
    louder = tuple(
        dataclasses.replace(trial, outputs=ramp * trial.outputs, use=None)
        for trial in stop.trials
    )
    stop = dataclasses.replace(stop, trials=louder)
    known = {
        tuple(part.start_s for part in strongest_segments(plant, louder, *cut)): cut
        for cut in ((FEW_SEGMENTS, QUIET), (FEW_SEGMENTS, LESS), (FEW_SEGMENTS, LOUDEST), *LAST)
    }
    assert len(known) == 4
    asked = []

    def fitted(plant, parts, noise, values, control):
        cut = known[tuple(part.start_s for part in parts)]
        if not plant.effects:
            asked.append(cut)
        left = 1.1 * MIN_QUIET_CHI2 if cut[1] in plain else 0.9 * MIN_QUIET_CHI2
        if plant.effects and there:
            left = 1.0
        fit = dataclasses.replace(
            stop.before, plant=plant, values=plant.values, cost=left, chi2_in_band=left
        )
        return fit, []

    told = stop.told(laws(stop, "cubic_hardening"), [], fitted)
    assert bool(told) == there
    assert asked == [*cuts, *LAST] if there else asked == cuts

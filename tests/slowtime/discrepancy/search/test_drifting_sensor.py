"""Effects beside a sensor that drifts on no law's course are found by the other sensors."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.hypothesis import Hypothesis, SearchStep
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.discrepancy.search.drifting_sensor import end_with_drift
from slowtime.discrepancy.search.settings import MAX_EFFECTS
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import named_effect
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, TWO, records_of
from tests.slowtime.discrepancy.two_mass_chain import KINDS as FEW

NAMES = ("sensor_drift", "sensor_bias", "sensor_gain")
KINDS = FEW | {name: catalogue()[name] for name in NAMES}
DRIFT = Effect("sensor_drift", Place("sensor", "v_m2"), {"drift_total": 0.3})
OFF = Effect("sensor_bias", DRIFT.place, {"bias": 0.01})


@pytest.fixture(scope="module")
def law():
    """A hypothesis of a spring that hardens, and the records of one."""
    trials = records_of((CUBIC,))
    known = dataclasses.replace(TWO, effects=(CUBIC.entry(),))
    fits = tuple(refit(Plant.of(one, kinds=KINDS), trials) for one in (TWO, known))
    return Hypothesis(fits, trials, effects=(named_effect(CUBIC, KINDS),))


@pytest.fixture(scope="module")
def bare(law):
    return Hypothesis((law.first,), law.trials)


class Others:
    """What is found by the other sensors: one law, changed as a test says."""

    def __init__(self, law, **changed):
        self.law, self.changed = law, changed
        self.asked: list[tuple[Hypothesis, int]] = []

    def __call__(self, rest, how, number):
        self.asked.append((rest, number))
        more = rest.with_effect(self.law.last, self.law.effects[0])
        return dataclasses.replace(more, **self.changed)


def ended(found, others, number=0, monitor=None, before=None):
    how = SearchSettings(KINDS, monitor or Monitor())
    drift = named_effect(DRIFT, KINDS)
    step = SearchStep(found, added=0, drift=drift, base=before or found.last)
    ends = end_with_drift(step, how, number, others)
    assert ends.final
    assert ends.effects[-1] is drift
    assert len(ends.fits) == 1 + len(ends.effects)
    counts = [len(fit.plant.effects) for fit in ends.fits]
    assert counts == list(range(len(counts)))
    return ends


def kinds_of(found):
    return [one.effect.kind for one in found.effects]


def test_effects_found_by_the_other_sensors_are_kept_before_the_drift(law, bare):
    others = Others(law)
    found = ended(bare, others)
    assert kinds_of(found) == ["cubic_hardening", "sensor_drift"]
    assert found.without_sensor
    ((rest, number),) = others.asked
    assert number == 1
    column = [s.channel for s in TWO.sensors].index(DRIFT.place.id)
    for trial in rest.trials:
        assert not trial.used[:, column].any()
        assert np.delete(trial.used, column, axis=1).all()
    # The sensor that was left out has the noise it had before.
    given, noise = bare.last.noise, found.fits[1].noise
    assert [row[column] for row in noise.colours] == [row[column] for row in given.colours]


@pytest.mark.parametrize(
    "changed",
    [
        {"effects": ()},
        {"final": True},
        {"holds": ("first",)},
        {"trials": ()},
    ],
    ids=["nothing", "no law", "a hold", "records cut"],
)
def test_results_that_do_not_go_with_a_drifting_sensor_are_not_kept(law, bare, changed):
    found = ended(bare, Others(law, **changed))
    assert kinds_of(found) == ["sensor_drift"]
    assert not found.without_sensor


def test_no_more_effects_are_looked_for_than_settings_allow(law, bare):
    others = Others(law)
    assert kinds_of(ended(bare, others, number=MAX_EFFECTS - 1)) == ["sensor_drift"]
    assert others.asked == []


def test_a_search_out_of_budget_beside_a_drift_is_marked_exhausted(law, bare):
    others = Others(law)
    late = ended(bare, others, monitor=Monitor(late=lambda: True))
    assert late.exhausted
    assert kinds_of(late) == ["sensor_drift"]
    assert others.asked == []
    assert ended(bare, Others(law, exhausted=True)).exhausted


def test_an_offset_of_the_sensor_gives_way_to_its_drift(law, bare):
    """Its mean was taken for an offset, and hid that a spring is missing."""
    located = object.__new__(Localization)
    found = bare.with_effect(carry_effect(bare.last, OFF, KINDS), named_effect(OFF, KINDS))
    others = Others(law, localized=located)
    told = ended(found, others, number=MAX_EFFECTS - 1)
    assert kinds_of(told) == ["cubic_hardening", "sensor_drift"]
    assert told.localized is located
    ((rest, _),) = others.asked
    assert not rest.first.plant.effects


@pytest.mark.parametrize(
    ("effect", "stays"),
    [
        (OFF, False),
        (dataclasses.replace(OFF, place=Place("sensor", "v_m1")), True),
        (Effect("sensor_gain", OFF.place, {"gain": 1.1}), True),
        (CUBIC, True),
    ],
    ids=["offset", "offset of another", "gain", "law"],
)
def test_an_offset_goes_where_nothing_else_is_missing_either(law, bare, effect, stays):
    first = dataclasses.replace(bare.first, values=1.3 * bare.first.values, chi2_in_band=50.0)
    fit = carry_effect(first, effect, KINDS)
    found = Hypothesis((first, fit), bare.trials, effects=(named_effect(effect, KINDS),))
    told = ended(found, lambda rest, *_: rest, number=1)
    assert kinds_of(told) == [effect.kind] * stays + ["sensor_drift"]
    # Without the offset, constants make up for it: they are held to what was claimed.
    begun = fit if stays else refit_within_tolerances(first, bare.trials)
    assert begun is not first
    count = len(begun.values)
    np.testing.assert_array_equal(told.last.values[:count], begun.values)


def test_an_offset_beside_a_law_stays(law):
    fit = carry_effect(law.last, OFF, KINDS)
    found = law.with_effect(fit, named_effect(OFF, KINDS))
    others = Others(law)
    assert kinds_of(ended(found, others, number=1)) == [
        "cubic_hardening", "sensor_bias", "sensor_drift",
    ]  # fmt: skip
    assert others.asked == []


@pytest.mark.long
@pytest.mark.parametrize("effects", [(), (CUBIC,)], ids=["nothing", "law"])
def test_beside_a_sensor_that_drifts_a_search_names_what_the_others_tell(effects):
    trials = []
    for number, trial in enumerate(records_of(effects)):
        wrong = trial.outputs.copy()
        course = np.sin(np.linspace(0.0, 9.0, len(wrong)) + number)
        wrong[:, 3] += 6.0 * wrong[:, 3].std() * course
        trials.append(dataclasses.replace(trial, outputs=wrong))
    kinds = FEW | {"sensor_drift": KINDS["sensor_drift"]}
    first = refit(Plant.of(TWO, kinds=kinds), tuple(trials))
    found = search(first, tuple(trials), SearchSettings(kinds, Monitor()))
    assert kinds_of(found) == [*(one.kind for one in effects), "sensor_drift"]
    assert found.effects[-1].effect.place == DRIFT.place
    assert found.final
    assert [len(fit.plant.effects) for fit in found.fits] == list(range(len(found.fits)))
    if effects:
        assert found.effects[0].numbers["k3_n_per_m3"].value == pytest.approx(2e4, rel=0.05)

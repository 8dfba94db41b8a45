"""What hums has one line, and is tried wherever something may hum."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates import library_fit as trying
from slowtime.discrepancy.candidates.library_fit import is_tonal, library_candidates
from slowtime.discrepancy.localization import locate
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, DRAG, TWO, records_of

NAMES = ("harmonic_force", "added_mass", "cubic_hardening")
KINDS = {name: kind for name, kind in catalogue().items() if name in NAMES}
HUM = Effect(
    "harmonic_force",
    Place("node", "m2"),
    {"amplitude_n": 3.0, "frequency_hz": 4.1, "phase_rad": 0.4},
)


def located(*effects):
    trials = records_of(effects)
    before = refit(Plant.of(TWO, kinds=KINDS), trials)
    return before, locate(before, trials)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effects", "hums"), [((HUM,), True), ((CUBIC,), False), ((DRAG,), False)]
)
def test_what_hums_has_one_line_and_a_law_has_many(effects, hums):
    assert is_tonal(located(*effects)[1]) is hums


@pytest.mark.long
@pytest.mark.parametrize("hums", [True, False])
def test_a_hum_is_tried_everywhere_and_all_else_where_a_force_explains_it(monkeypatch, hums):
    before, found = located(HUM)
    first, *others = found.groups
    assert first.places[0] == HUM.place
    far = tuple(dataclasses.replace(one, left=50.0 * first.left) for one in others)
    found = dataclasses.replace(found, groups=(first, *far))
    monkeypatch.setattr(trying, "is_tonal", lambda _: hums)
    tried = {
        (c.effect.kind, c.effect.place.id) for c in library_candidates(before, found, KINDS)
    }
    assert ("harmonic_force", "m2") in tried
    assert (("harmonic_force", "m1") in tried) is hums
    assert ("added_mass", "m1") not in tried

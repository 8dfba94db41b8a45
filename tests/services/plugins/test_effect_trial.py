"""A kind of effect that is wrong is found out in a trial, and costs its own process only."""

import pytest

from slowtime.dynamics.effects import catalogue
from slowtime_services.plugins.discovery import PluginError
from slowtime_services.plugins.effect_trial import try_kind
from slowtime_services.plugins.installed_effects import installed_kinds, sound_parts
from tests.services.plugins.own_effects import EFFECTS
from tests.services.plugins.test_plugins import installed as installed


@pytest.fixture
def part(installed, tmp_path):
    """Install one of the effects of `EFFECTS` under a name."""
    (tmp_path / "site/own_effects.py").write_text(EFFECTS)
    return lambda name, target: installed("effects", name, f"own_effects:{target}")


@pytest.mark.parametrize("kind", catalogue().values(), ids=lambda kind: kind.name)
def test_every_kind_of_the_catalogue_passes(kind):
    try_kind(kind)


@pytest.mark.long
@pytest.mark.parametrize("target", ["GOOD", "PRINTS"])
def test_a_part_that_is_sound_tells_its_kinds_whatever_it_prints(part, target):
    part("spring", target)
    (kind,) = installed_kinds("spring")
    assert kind in ("softening_spring", "printing_spring")


@pytest.mark.long
@pytest.mark.parametrize(
    ("target", "told"),
    [
        ("NAN", "nan_spring with .* gave values that are not finite numbers for each sample"),
        (
            "ENDLESS",
            r"(did not answer|is not imported) within 20 s, and was ended",
        ),
        ("RAISES", r"'spring' of bad-parts 1.0 failed: RuntimeError: no such luck"),
        ("STRANGE", r"'spring' of bad-parts 1.0 failed: ValueError: .*nowhere"),
    ],
)
def test_a_part_that_is_wrong_is_named_with_what_it_did(part, target, told):
    part("spring", target)
    with pytest.raises(PluginError, match=told):
        installed_kinds("spring", 20.0 if target == "ENDLESS" else 120.0)


@pytest.mark.long
def test_one_that_is_wrong_is_left_out_and_the_others_stay(part):
    part("bad", "RAISES")
    part("good", "GOOD")
    passed, faults = sound_parts(("bad", "nowhere", "good"))
    assert passed == ("good",)
    assert [fault.endswith(" It was left out.") for fault in faults] == [True, True]
    assert "no such luck" in faults[0]
    assert "No effect 'nowhere' is installed" in faults[1]

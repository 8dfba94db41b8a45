"""The verb `effects` tells all that a model file needs to hold an effect."""

from pathlib import Path

import pytest

from slowtime.dynamics.effects import catalogue

ROOT = Path(__file__).parents[3]


def test_every_effect_is_listed_once_at_its_place(run):
    lines = run("model", "effects").out.splitlines()
    named = [line.split()[0] for line in lines if line.startswith("  ")]
    assert sorted(named) == sorted(catalogue())
    places = [line for line in lines if not line.startswith("  ")]
    assert len(places) == len(set(places)) == len({k.where for k in catalogue().values()})


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_a_description_has_equation_and_all_parameters(run, name):
    kind = catalogue()[name]
    told = run("model", "effects", name).out
    for part in (kind.title, kind.sentence, kind.equation, kind.source, *kind.simpler):
        assert part in told
    for parameter in kind.parameters:
        assert f"{parameter.name}: {parameter.meaning}" in told


def test_an_unknown_name_is_refused_with_those_there_are(refused):
    told = refused("model", "effects", "hysteresys")
    assert "hysteresys" in told
    assert "bouc_wen" in told


def test_the_page_of_effects_is_what_the_verb_writes(run):
    written = run("model", "effects", "--markdown").out
    assert (ROOT / "docs/effects.md").read_text(encoding="utf-8") == written

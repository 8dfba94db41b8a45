"""The table of sets, and what becomes of those whose measurements are not there."""

import pytest

from benchmarks.real_rigs import __main__ as command
from benchmarks.real_rigs.sets import IMPOSED, MODELS, SETS, chosen
from slowtime.dynamics.effects.effect_catalogue import catalogue
from slowtime_services.models import read_description


def test_names_are_unique_and_every_model_file_is_used():
    names = [one.name for one in SETS]
    assert len(set(names)) == len(names)
    used = {one.model for one in SETS}
    assert {path for path in MODELS.glob("*.yaml")} <= used


@pytest.mark.parametrize("one", SETS, ids=lambda one: one.name)
def test_every_set_has_a_model_a_source_and_effects_that_exist(one):
    model = read_description(one.model)
    assert model.sensors
    known = set(catalogue()) | {kind.family for kind in catalogue().values()} | {"unknown"}
    assert one.allowed.union(*one.needed) <= known
    assert one.source
    assert one.known
    if one.imposed:
        assert len(model.nodes) == 1
        assert model.inputs[0].kind == "force"


def test_a_set_that_repeats_another_comes_after_it():
    names = [one.name for one in SETS]
    for number, one in enumerate(SETS):
        if one.same_as is not None:
            assert one.same_as in names[:number]


def test_rigs_of_imposed_motion_are_those_of_negligible_mass():
    for one in SETS:
        light = max(node.mass_kg for node in read_description(one.model).nodes) == 1e-3
        assert light == (one.model.stem in IMPOSED)


def test_sets_are_chosen_by_name_in_the_order_of_the_table():
    assert [one.name for one in chosen(("rub", "emps"))] == ["emps", "rub"]
    assert chosen(()) == SETS
    with pytest.raises(ValueError, match=r"There is no set rubb\. Sets: emps, "):
        chosen(("rubb",))


def test_sets_that_are_not_there_are_skipped_with_the_reason(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SLOWTIME_DATA", str(tmp_path / "none/data"))
    page = tmp_path / "page.md"
    words = ["--out", str(tmp_path / "out"), "--page", str(page)]
    assert command.main(words) == 0
    told = capsys.readouterr().out
    for one in SETS:
        assert f"{one.name}: skipped, " in told
        assert f"`{one.name}` (" in page.read_text()
    assert "does not exist. Set SLOWTIME_DATA" in told


def test_a_wrong_name_is_refused_on_the_command_line(capsys):
    with pytest.raises(SystemExit):
        command.main(["--only", "nowhere"])
    assert "There is no set nowhere" in capsys.readouterr().err

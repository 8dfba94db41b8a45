"""What the tutorials tell to type does what they say."""

import csv
import json
import re

import numpy as np
import pytest

from tests.docs.commands import parse
from tests.docs.tutorials import PAGES, TUTORIALS, can_run, follow, script, typed

NEEDS_OTHERS = {"real_records": "records of others, fetched by the reader"}
BY_NAME = {page.stem: page for page in PAGES if page.stem not in NEEDS_OTHERS}


def of_slowtime() -> list[list[str]]:
    every = [words[1:] for page in PAGES for words in typed(page) if words[0] == "slowtime"]
    return [words for words in every if not any("$(" in word or word == "$" for word in words)]


@pytest.mark.parametrize("arguments", of_slowtime(), ids=" ".join)
def test_every_command_of_a_tutorial_parses(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if arguments != ["--version"]:
        parse(arguments, tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_tutorial_links_to_is_there(page):
    prose = re.sub(r"^ {4}.*$", "", page.read_text(), flags=re.M)
    links = re.findall(r"\]\(([^)]+)\)", prose)
    assert links
    missing = [x for x in links if "://" not in x and not (page.parent / x).exists()]
    assert missing == []


def test_the_list_of_tutorials_is_whole():
    listed = re.findall(r"\]\((\w+)\.md\)", (TUTORIALS / "README.md").read_text())
    assert sorted(listed) == sorted(page.stem for page in PAGES)


def test_commands_are_told_from_what_they_write(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "Say:\n\n    cat > a.py <<'END'\n    slowtime nothing & \"\n    END\n"
        "    slowtime router &\n    (slowtime twin --port 1 || echo 'a & b') > out.txt\n\n"
        "    slowtime --version  # which\n"
    )
    assert [words for words in typed(page) if words[0] != "cat"] == [
        ["slowtime", "router"],
        ["slowtime", "twin", "--port", "1"],
        ["echo", "a & b"],
        ["slowtime", "--version"],
    ]
    assert '    slowtime nothing & "'.strip() in script(page)


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def first_hour(folder, said):
    table = rows(folder / "tower.csv")
    assert len(table) == 40
    assert float(table[-1]["stiffness_change_hi"]) < 0.0
    assert {"ready", "ok"} & set(re.findall(r'"status":"(\w+)"', said))
    live, filed = (json.loads((folder / f).read_text()) for f in ("live.json", "forecast.json"))
    assert live["crossings"][0]["threshold"] == filed["crossings"][0]["threshold"] == -0.03


def sensor_file(folder, said):
    modes = json.loads((folder / "modes.json").read_text())["modes"]
    found = [mode["frequency_hz"]["value"] for mode in modes]
    assert any(abs(f - 4.0) < 0.1 for f in found)
    assert any(abs(f - 11.0) < 0.1 for f in found)
    (second,) = json.loads((folder / "second.json").read_text())["modes"]
    assert second["frequency_hz"]["value"] == pytest.approx(11.0, abs=0.1)
    table = rows(folder / "beam.csv")
    assert len(table) == 10
    told = [(row["stiffness_change_lo"], row["stiffness_change_hi"]) for row in table]
    held = [float(lo) < 0 < float(hi) for lo, hi in told if lo]
    assert len(held) >= 7
    assert sum(held) >= len(held) - 1


def structure(folder, said):
    assert "changed: storey2" in said
    graph = json.loads((folder / "frame.json").read_text())["digitalTwinsGraph"]
    suspected = [twin["$dtId"] for twin in graph["digitalTwins"] if twin.get("suspected")]
    assert suspected == ["lab.frame.element.storey2"]


def alarms(folder, said):
    assert re.search(r"^[\d.]+ alarm Stiffness change below −3 % with", said, re.M)
    assert re.search(r"^[\d.]+ alarm Stiffness change below −2 % with", said, re.M)
    assert re.search(r"^Stiffness change at −10 %: 10 %: by ", said, re.M)
    assert re.search(r"ops is told: This is a test alarm to ops, requested by .*\.", said)
    assert re.search(r"^Seen by Ann$", said, re.M)
    assert "a forgery" not in said


def maintenance_plan(folder, said):
    forecast, repaired = (
        json.loads((folder / name).read_text()) for name in ("forecast.json", "repaired.json")
    )
    before, after = (
        next(one for one in body["crossings"] if one["source"] == "request")["within"]
        for body in (forecast, repaired)
    )
    assert before > 0.5
    assert after < before
    softer, sway = json.loads((folder / "risk.json").read_text())["limit_states"]
    assert softer["valid"] == sway["valid"] is True
    assert 0.0 < sway["now"]["probability"]["value"] < sway["within"]["value"] < 1.0
    assert softer["within"]["value"] == pytest.approx(before, abs=0.05)
    plan = json.loads((folder / "plan.json").read_text())
    assert plan["valid"] is True
    assert len(plan["options"]) > 4
    assert plan["sentence"] in said


def misfit(folder, said):
    report = json.loads((folder / "found/report.json").read_text())
    (effect,) = report["effects"]
    assert (effect["effect"], effect["where"]["id"]) == ("coulomb", "j2")
    friction = effect["parameters"]["friction_n"]
    assert abs(friction["value"] - 0.5) < 4 * friction["sd"]
    promised = BY_NAME["misfit"].read_text()
    for figure in (r"left over: ([\d.]+) %", r"falls from \d+ % to ([\d.]+) %"):
        (found,), (told,) = re.findall(figure, said), re.findall(figure, promised)
        assert float(found) == pytest.approx(float(told), rel=0.1)


def forgotten_connection(folder, said):
    report = json.loads((folder / "found/report.json").read_text())
    assert {effect["where"]["id"] for effect in report["effects"]} == {"f1-f3"}
    (spring,) = [e for e in report["effects"] if e["effect"] == "missing_spring"]
    stiffness = spring["parameters"]["k_n_per_m"]
    assert abs(stiffness["value"] - 900.0) < 4 * stiffness["sd"]
    gap = report["gap"]
    assert gap["augmented"] < 1.15 * gap["noise_floor"]
    promised = BY_NAME["forgotten_connection"].read_text()
    for figure in (r"left over: ([\d.]+) %", r"falls from \d+ % to ([\d.]+) %"):
        (found,), (told,) = re.findall(figure, said), re.findall(figure, promised)
        assert float(found) == pytest.approx(float(told), rel=0.2)


def site_tls(folder, said):
    assert "lab.beam is alive" in said
    assert "A token is needed. Give it" in said
    assert said.rstrip().count("\nrefused\n") == 1
    assert len(rows(folder / "beam.csv")) > 5
    assert not (folder / "again.csv").exists()


def court(folder, said):
    assert "house.mcap: OK" in said
    assert "\nthe same history\n" in said
    (same, of) = re.findall(r"(\d+) of (\d+) features identical", said)[-1]
    assert same == of != "0"
    verdict = json.loads((folder / "verdict.json").read_text())["points"][-1]
    again = rows(folder / "again.csv")[-1]
    assert float(again["stiffness_change"]) == verdict["stiffness_change"]["value"]
    assert float(again["stiffness_change_lo"]) == verdict["stiffness_change"]["lo"]


def own_effect(folder, said):
    """Measured with the branch, named by the command, simulated from what that wrote."""
    report = json.loads((folder / "found/report.json").read_text())
    (effect,) = report["effects"]
    assert effect["effect"] == "maxwell_branch"
    for name, true in (("k_n_per_m", 1.2e5), ("c_n_s_per_m", 1500.0)):
        told = effect["parameters"][name]
        assert abs(told["value"] - true) < 5 * told["sd"] < 0.02 * true
    with np.load(folder / "judge.npz") as judge, np.load(folder / "again.npz") as again:
        left = judge["x"] - again["x"]
        assert np.std(left) < 0.01 * np.std(judge["x"])


def own_proposer(folder, said):
    """The joint that warmed rubs, as strongly as it was made to."""
    found = re.search(r"Dry friction \(coulomb\) at element j2: ([\d.]+) ± ([\d.]+) N", said)
    assert found
    value, sd = map(float, found.groups())
    assert abs(value - 0.5) < 4 * sd < 0.01


def own_parts(folder, said):
    """Listed as loaded, and each used by its name."""
    listed = re.findall(r"^slowtime\.(\w+) .* loaded$", said, re.M)
    assert listed == ["alarms", "effects", "identifiers", "readers", "sources"]
    (mode,) = json.loads((folder / "modes.json").read_text())["modes"]
    assert mode["frequency_hz"]["value"] == pytest.approx(4.0, abs=0.1)
    kept = b"".join(path.read_bytes() for path in (folder / "spool").rglob("*.spool"))
    told = [float(hz) for hz in re.findall(rb'"frequency_hz":{"value":([\d.]+)', kept)]
    assert told == pytest.approx([4.0] * len(told), abs=0.2)
    assert len(told) >= 2
    with np.load(folder / "soft.npz") as soft:
        assert np.abs(soft["x"]).max() > 0.0
    assert said.count("\nline 1\n") == said.count("\nit is there already\n") == 1


def imposed_motion(folder, said):
    """The drag of the damper, the forces that it foretells, and the decay that it makes."""
    report = json.loads((folder / "found/report.json").read_text())
    (effect,) = report["effects"]
    assert (effect["effect"], effect["where"]["id"]) == ("quadratic_damping", "damper")
    drag = effect["parameters"]["c2_n_s2_per_m2"]
    assert drag["value"] == pytest.approx(3000.0, rel=0.1)
    (left,) = re.findall(r"^error: ([\d.]+) %", said, re.M)
    assert float(left) < 6.0
    assert "grows with amplitude" in said
    with np.load(folder / "floor.npz") as floor:
        assert np.isfinite(floor["r"]).all()


def hammer_test(folder, said):
    """The double hit is told, the modes are the model's, and the files are there."""
    assert "6 blows of 7 used" in said
    assert re.search(r"blow at 13\.\d+ s rejected: double hit", said)
    modes = json.loads((folder / "compared.json").read_text())["modes"]
    assert [mode["model"]["mode"] for mode in modes] == [1, 2, 3]
    assert all(abs(mode["model"]["difference"]) < 2e-3 for mode in modes)
    assert all(mode["model"]["mac"] > 0.999 for mode in modes)
    masses = [
        mode["modal_mass"]
        for mode in json.loads((folder / "responses.json").read_text())["modes"]
    ]
    assert all(0 < mass["sd"] < 0.02 * mass["value"] for mass in masses)
    assert (folder / "responses.uff").read_text().count("\n    58\n") == 6
    assert (folder / "modes.uff").read_text().count("\n    55\n") == 3


def finite_elements(folder, said):
    """Columns found softer; then the girder, by the twin."""
    found = json.loads((folder / "updated.json").read_text())
    columns, girder = found["parameters"]
    assert (columns["parameter"], girder["parameter"]) == ("columns", "girder")
    assert abs(columns["change"] + 0.1) < 4 * columns["sd"] < 0.04
    assert abs(girder["change"]) < 4 * girder["sd"] < 0.06
    modes = found["modes"]
    assert len(modes) >= 4
    assert all(
        abs(one["updated_hz"] - one["measured_hz"])
        < abs(one["as_given_hz"] - one["measured_hz"])
        for one in modes
    )
    assert "changed: girder" in said


def whole_day(folder, said):
    """Noticed, named, adopted and undone by the twin alone; the replay is the same."""
    told = json.loads((folder / "house/story.json").read_text())
    assert told["named"]["outcome"] in ("named", "undecided with the truth")
    assert told["gap"]["with_adoption"] < 1.3 * told["gap"]["usual"]
    assert told["faults"]["lost"] == 0
    assert told["hash"]["equal"] is True
    assert re.search(rf"^demo\.house  sha256:{told['hash']['run']} ", said, re.M)
    assert (folder / "house/story.html").exists()


ENDS = {
    end.__name__: end
    for end in (
        first_hour, sensor_file, structure, alarms, misfit, forgotten_connection, site_tls,
        court, own_effect, own_parts, maintenance_plan, own_proposer, imposed_motion,
        hammer_test, finite_elements, whole_day,
    )
}  # fmt: skip


def test_every_tutorial_has_an_end_that_is_judged():
    assert ENDS.keys() == BY_NAME.keys()
    assert len((TUTORIALS / "maxwell_branch.py").read_text().splitlines()) < 60


@pytest.mark.slow
@pytest.mark.system
@pytest.mark.parametrize("name", ENDS)
def test_a_tutorial_followed_to_the_letter_ends_where_it_says(name, tmp_path):
    if reason := can_run():
        pytest.skip(reason)
    said = follow(BY_NAME[name], tmp_path)
    ENDS[name](tmp_path, said)

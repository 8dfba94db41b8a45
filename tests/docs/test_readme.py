"""What README and tour tell a newcomer to type is what the command understands."""

import json
import re
import shlex
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime_cli.__main__ import main
from slowtime_cli.shared.offline_twin import offline_twin
from tests.docs.commands import parse
from twin_server.pipeline import TwinKnowledge
from twin_server.serve import Hub, create_app
from twin_server.settings import ServeSettings

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
TOUR = (ROOT / "docs/tour.md").read_text()
MOST_LINES, MOST_WORDS = 80, 900
"""Of the README: one page."""
BLOCK = re.compile(r"(?:^ {4}\S.*\n)+", re.M)
OFFLINE = (["identify"], ["twin", "evolve"])


def typed() -> list[list[str]]:
    """Words of every line to type, without comment and `&`."""
    lines = "".join(BLOCK.findall(README + TOUR)).splitlines()
    return [words for line in lines if (words := shlex.split(line.strip(" &"), comments=True))]


def of_slowtime() -> list[list[str]]:
    return [words[1:] for words in typed() if Path(words[0]).name == "slowtime"]


def test_the_readme_shows_the_command():
    assert {words[0] for words in of_slowtime()} >= {"identify", "edge", "twin"}


@pytest.mark.parametrize("arguments", of_slowtime(), ids=" ".join)
def test_every_command_of_the_readme_parses(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parse(arguments, tmp_path)


@pytest.mark.gate
def test_the_offline_commands_of_the_readme_run_one_after_the_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    oscillator = Oscillator.from_modal(4.0, 0.02)
    samples = ambient_acceleration(oscillator, 200 * 120, 200.0, rng)
    np.savetxt("record.csv", samples / samples.std(), fmt="%.6f", header="acc [m/s^2]")
    ran = [
        words
        for words in of_slowtime()
        if any(words[: len(one)] == one for one in OFFLINE) and "tower.mcap" not in words
    ]
    assert len(ran) >= 3
    for arguments in ran:
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 0, arguments
    epochs = json.loads((tmp_path / "modes.json").read_text())["epochs"]
    assert [e["modes"][0]["frequency_hz"]["value"] for e in epochs] == pytest.approx(
        [4.0] * len(epochs), abs=0.1
    )


def test_the_readme_is_one_page():
    assert len(README.splitlines()) <= MOST_LINES
    assert len(README.split()) <= MOST_WORDS


@pytest.mark.gate
def test_the_first_commands_print_what_the_readme_shows(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for arguments in of_slowtime()[:2]:
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 0, arguments
    _, told, *_ = [line.split("\t") for line in capsys.readouterr().out.splitlines()[-2:]]
    shown = re.search(r"^\| (\d\.\d+) ± (\d\.\d+) ", README, re.M)
    assert shown
    assert [float(told[0]), float(told[1])] == pytest.approx(
        [float(shown[1]), float(shown[2])], abs=5e-5
    )
    assert "changes_within_record" in told


def test_every_word_of_make_in_the_readme_is_one():
    known = set(re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.M))
    said = set(re.findall(r"`make ([a-z-]+)`", README))
    said |= {words[1] for words in typed() if words[0] == "make"}
    assert {"demo", "test", "check"} <= said <= known


def test_every_link_of_the_readme_leads_somewhere():
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
    of_tour = [link for link in re.findall(r"\]\(([^)#]+)\)", TOUR) if "://" not in link]
    assert [link for link in of_tour if not (ROOT / "docs" / link).exists()] == []


def test_every_address_that_the_readme_asks_is_served(tmp_path):
    with offline_twin(tmp_path / "twin.sqlite") as (pipeline, store):
        app = create_app(TwinKnowledge(pipeline, store), Hub(1, 1), ServeSettings())
    asked = [
        (url.path, parse_qs(url.query))
        for words in typed()
        if words[0] == "curl"
        for url in [urlsplit(words[-1])]
    ]
    assert asked
    for path, query in asked:
        template = re.sub(r"(?<=/twins/)[\w.]+", "{twin_id}", path)
        operation = app.openapi()["paths"][template]["get"]
        known = {parameter["name"] for parameter in operation.get("parameters", [])}
        assert set(query) <= known
    served = {getattr(route, "path", None) for route in app.routes} | {*app.openapi()["paths"]}
    said = set(re.findall(r"`(/[a-z0-9/._-]+)`", README + TOUR))
    assert said
    assert said <= served

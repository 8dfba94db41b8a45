"""Runs of contestants: time, exit status, and what is kept."""

import json

import numpy as np
import pytest

from benchmarks.real_rigs import __main__ as command
from benchmarks.real_rigs import running
from benchmarks.real_rigs.pieces import Piece, Pieces
from benchmarks.real_rigs.running import Contestant, is_done, prepare, run, words_of
from benchmarks.real_rigs.sets import MODELS, RealSet

PIECE = Piece(10.0, {"angle": np.cos(np.arange(100.0))})
MADE = RealSet(
    name="made", title="Made", source="here", model=MODELS / "torsion_disc.yaml",
    load=lambda data: Pieces((PIECE, PIECE), (PIECE,)), split="all", known="nothing", needed=(),
)  # fmt: skip


def contestant(*module):
    return Contestant("one", "One", module, peer=False)


@pytest.fixture
def folder(tmp_path):
    return prepare(MADE, tmp_path, tmp_path / "out")


def test_a_set_is_prepared_as_files_that_the_plain_command_takes(folder):
    words = words_of(contestant("x"), folder)
    assert words == [
        "model.yaml", "learn_1.npz", "learn_2.npz", "--holdout", "judge_1.npz", "--out", "one",
    ]  # fmt: skip
    assert (folder / "model.yaml").read_text() == MADE.model.read_text()
    assert json.loads((folder / "facts.json").read_text())["imposed"] is False


def test_pieces_of_an_earlier_preparation_do_not_stay(folder, tmp_path):
    fewer = RealSet(**{**vars(MADE), "load": lambda data: Pieces((PIECE,), (PIECE,))})
    prepare(fewer, tmp_path, tmp_path / "out")
    assert not (folder / "learn_2.npz").exists()


def test_time_exit_and_last_words_are_kept(folder):
    told = run(contestant("no_such_module"), folder)
    assert told["exit"] == 1
    assert "no_such_module" in told["last_words"]
    assert 0 < told["cpu_seconds"] < 60
    assert json.loads((folder / "one/run.json").read_text()) == told


def test_a_contestant_that_does_not_end_is_stopped(folder):
    sleeper = contestant("timeit", "-n1", "-r1", "import time; time.sleep(600)")
    assert run(sleeper, folder, limit_s=0.5)["exit"] == -9
    assert is_done(sleeper, folder)


def test_what_was_run_is_not_run_again_unless_it_is_asked_for(folder, monkeypatch):
    ran = []
    monkeypatch.setattr(command, "CONTESTANTS", (contestant("x"),))

    def fake(who, where):
        ran.append(who.name)
        (where / who.name).mkdir(exist_ok=True)
        (where / who.name / "run.json").write_text("{}")
        return {"cpu_seconds": 1.0, "load": 0.0, "exit": 0}

    monkeypatch.setattr(running, "run", fake)
    command.run_all(MADE, folder)
    command.run_all(MADE, folder)
    assert ran == ["one"]
    command.run_all(MADE, folder, refresh=True)
    assert ran == ["one", "one"]


def test_other_tools_are_not_run_on_a_set_of_the_same_records(folder, monkeypatch):
    peer = Contestant("other", "Other", ("x",), peer=True)
    monkeypatch.setattr(command, "CONTESTANTS", (peer,))
    monkeypatch.setattr(running, "run", lambda who, where: pytest.fail("was run"))
    command.run_all(RealSet(**{**vars(MADE), "same_as": "emps"}), folder)

"""Diagnoses as processes: one at a time, told of, ended when asked to."""

import re
import sys
import threading
from typing import Any

import pytest

from twin_server.diagnose import Ended, JobId, Jobs
from twin_server.fairness import Holder, OverQuotaError, Processors, acting_for
from twin_server.settings import DiagnoseSettings

TELL = "import json, pathlib, sys, time, os\nhere = pathlib.Path(sys.argv[1])\n"
DONE = TELL + (
    "for name in ('report.json', 'report.html', 'augmented.yaml'):\n"
    "    (here / name).write_text(here.name + ' ' + name)\n"
)
SLEEPS = TELL + (
    "print(json.dumps({'stage': 'sleeping', 'share': 0.4}), flush=True)\n"
    "(here.parent / 'began').touch()\n"
    "sys.stdin.read()\n"
)
DEAF = TELL + 'print(\'{"stage": "deaf", "share": 0}\', flush=True)\ntime.sleep(600)\n'
REFUSES = TELL + "print(json.dumps({'error': 'There is no channel u.'}))\nsys.exit(1)\n"
DIES = "import os\nos.abort()\n"
DIES_GARBLED = "import os\nos.write(2, b'caf\\xe9 is full')\nos.abort()\n"
GARBLED = DONE + "(here / 'report.json').write_bytes(b'caf\\xe9')\n"
RAMBLES = "print('not json')\n" + DONE


def job(number):
    """Identity of a diagnosis."""
    return JobId("lab.beam", number)


class Told(Jobs):
    """A queue that keeps what it tells, and makes folders for what it is given."""

    def __init__(self, command, settings, home, processors=None):
        super().__init__(command, settings, self._keep, processors)
        self.told: dict[int, Ended] = {}
        self.home = home

    def give(self, number):
        folder = self.home / f"job-{number}"
        folder.mkdir()
        self.submit(job(number), folder, self.reserve(f"diagnosis {number}"))
        return folder

    def _keep(self, job, ended):
        self.told[job.number] = ended


@pytest.fixture
def jobs(tmp_path, eventually):
    """Make queues whose processes run a script; `ended` collects what they tell."""
    made = []

    def start(script, **settings):
        path = tmp_path / "work.py"
        path.write_text(script)
        queue = Told([sys.executable, str(path)], DiagnoseSettings(**settings), tmp_path)
        queue.start()
        made.append(queue)
        return queue

    yield start
    for queue in made:
        queue.stop()


def test_what_a_process_leaves_is_its_outcome_and_its_folder_goes(jobs, eventually):
    queue = jobs(DONE)
    folders = [queue.give(number) for number in (7, 8)]
    assert eventually(lambda: len(queue.told) == 2)
    for number in (7, 8):
        assert queue.told[number].state == "done"
        assert queue.told[number].outcome.report == f"job-{number} report.json"
        assert queue.told[number].outcome.page == f"job-{number} report.html".encode()
    assert eventually(lambda: not any(folder.exists() for folder in folders))
    assert queue.progress(job(7)) is None


def test_one_runs_and_tells_how_far_it_has_come_while_others_wait(jobs, eventually, tmp_path):
    queue = jobs(SLEEPS, max_queued=2)
    for number in (1, 2, 3):
        queue.give(number)
        assert eventually(lambda: (tmp_path / "began").exists())
    assert eventually(lambda: queue.progress(job(1)).stage == "sleeping")
    running = queue.progress(job(1))
    assert (running.state, running.share) == ("running", 0.4)
    assert running.seconds > 0.0
    assert queue.progress(job(2))[:2] == ("queued", "waiting, 1 of its site ahead of it")
    assert queue.progress(job(3))[:2] == ("queued", "waiting, 2 of its site ahead of it")
    with pytest.raises(OverQuotaError, match=r"3 diagnoses on this server.*max_queued"):
        queue.reserve("a fourth")
    assert queue.cancel(job(2))
    assert queue.told[2].state == "cancelled"
    queue.reserve("another").release()
    assert not queue.cancel(job(99))


@pytest.mark.parametrize(("script", "grace_s"), [(SLEEPS, 600.0), (DEAF, 0.5)])
def test_one_that_is_cancelled_ends_whether_or_not_it_listens(
    jobs, eventually, monkeypatch, script, grace_s
):
    monkeypatch.setattr("twin_server.diagnose.jobs.GRACE_S", grace_s)
    queue = jobs(script)
    queue.give(1)
    assert eventually(lambda: queue.progress(job(1)).stage in ("sleeping", "deaf"))
    assert queue.cancel(job(1))
    assert eventually(lambda: 1 in queue.told)
    assert queue.told[1].state == "cancelled"


@pytest.mark.parametrize(
    ("script", "settings", "says"),
    [
        (REFUSES, {}, "There is no channel u."),
        (DIES, {}, "ended with status -6 and without a message.*max_memory_bytes"),
        (DIES_GARBLED, {}, "ended with status -6 and without a message"),
        (GARBLED, {}, "without a report"),
        (SLEEPS, {"max_s": 0.3}, "took longer than 0.3 s.*diagnose.max_s"),
        ("pass\n", {}, "without a report"),
    ],
)
def test_one_that_fails_says_why_and_the_next_one_runs(
    jobs, eventually, tmp_path, script, settings, says
):
    queue = jobs(script, **settings)
    queue.give(1)
    assert eventually(lambda: 1 in queue.told)
    assert queue.told[1].state == "failed"
    assert re.search(says, queue.told[1].error)
    (tmp_path / "work.py").write_text(RAMBLES)
    queue.give(2)
    assert eventually(lambda: 2 in queue.told)
    assert queue.told[2].state == "done"


def test_a_fault_of_the_server_fails_one_diagnosis_and_the_next_one_runs(
    jobs, eventually, monkeypatch
):
    queue = jobs(DONE)
    with monkeypatch.context() as faulty:
        faulty.setattr("twin_server.diagnose.jobs.read_outcome", lambda folder: 1 // 0)
        queue.give(1)
        assert eventually(lambda: 1 in queue.told)
    assert queue.told[1].state == "failed"
    assert "failed in the server" in queue.told[1].error
    queue.give(2)
    assert eventually(lambda: 2 in queue.told)
    assert queue.told[2].state == "done"


def test_a_server_that_ends_ends_its_processes_and_says_nothing_of_them(
    jobs, eventually, tmp_path
):
    queue = jobs(SLEEPS)
    folder, waiting = queue.give(1), queue.give(2)
    assert eventually(lambda: (tmp_path / "began").exists())
    queue.stop()
    assert queue.told == {}
    assert not folder.exists()
    assert not waiting.exists()
    assert "diagnose" not in {thread.name for thread in threading.enumerate()}


def test_a_site_that_orders_many_keeps_no_other_one_waiting(jobs, eventually, tmp_path):
    queue = jobs(SLEEPS, max_queued=4)
    with acting_for(Holder("greedy", "t")):
        held = [queue.reserve("a diagnosis") for _ in range(4)]
        for number, holding in enumerate(held, 1):
            (tmp_path / f"job-{number}").mkdir()
            queue.submit(JobId("greedy.beam", number), tmp_path / f"job-{number}", holding)
        with pytest.raises(OverQuotaError, match=r"4 diagnoses of your token"):
            queue.reserve("one more")
    with acting_for(Holder("modest", "t")):
        queue.give(9)
    assert eventually(lambda: queue.progress(job(9)).stage == "sleeping")
    assert queue.progress(JobId("greedy.beam", 1)).state == "running"
    # Of its own site only one runs, and those of others are not counted to it.
    assert queue.progress(JobId("greedy.beam", 3))[:2] == (
        "queued",
        "waiting, 2 of its site ahead of it",
    )
    queue.cancel(job(9))
    assert eventually(lambda: 9 in queue.told)


TICKS = TELL + (
    "for i in range(10_000):\n    (here / 'ticks').write_text(str(i))\n    time.sleep(0.01)\n"
)


def test_one_is_paused_for_a_site_that_has_used_less_and_goes_on_after_it(tmp_path, eventually):
    (tmp_path / "work.py").write_text(TICKS)
    processors = Processors(1)
    processors.usage.add(Holder("greedy", "t"), 1_000.0)
    command = [sys.executable, str(tmp_path / "work.py")]
    queue: Any = Told(command, DiagnoseSettings(), tmp_path, processors)
    queue.start()

    def ticks(number):
        path = tmp_path / f"job-{number}" / "ticks"
        return path.read_text() if path.exists() else ""

    try:
        with acting_for(Holder("greedy", "t")):
            queue.give(1)
        assert eventually(lambda: ticks(1))
        with acting_for(Holder("modest", "t")):
            queue.give(2)
        assert eventually(lambda: ticks(2))
        assert processors.paused() == {"greedy": 1}
        before, ran_s = ticks(1), queue.progress(job(1)).seconds
        now = ticks(2)
        assert eventually(lambda: ticks(2) != now)
        assert ticks(1) == before
        assert queue.progress(job(1)).seconds == pytest.approx(ran_s, abs=0.01)
        assert queue.cancel(job(2))
        assert eventually(lambda: ticks(1) not in (before, ""))
    finally:
        queue.stop()

"""Jobs end, fail, exceed limits, are killed and are stopped; the others go on."""

import os
import signal
import sys
import threading
import time

import pytest

from slowtime_services.engines import (
    Job,
    JobEnd,
    JobLimits,
    LocalEngine,
    engine_for,
    run_job,
    usable_cores,
)

NONE = JobLimits()


@pytest.fixture
def job(tmp_path):
    return lambda name, code: Job(name, (sys.executable, "-c", code), tmp_path)


def outcomes(engine, jobs, limits=NONE, stop=None):
    return {one.name: one for one in engine.run(jobs, limits, stop or threading.Event())}


def test_every_job_is_reported_with_its_end(job):
    found = outcomes(
        LocalEngine(2),
        [
            job("good", "pass"),
            job("bad", "raise SystemExit('no such file')"),
            job("too", "pass"),
        ],
    )
    assert {name: one.status for name, one in found.items()} == {
        "good": "done", "bad": "failed", "too": "done",
    }  # fmt: skip
    assert found["bad"].message == "no such file"
    assert found["bad"].attempts == 1


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="cores are chosen on Linux")
def test_only_cores_that_the_process_may_use_are_counted():
    allowed = os.sched_getaffinity(0)
    assert usable_cores() == len(allowed)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        assert usable_cores() == 1
    finally:
        os.sched_setaffinity(0, allowed)


def test_outcomes_come_as_jobs_end(job):
    jobs = [job("slow", "import time; time.sleep(1)"), job("quick", "pass")]
    names = [one.name for one in LocalEngine(2).run(jobs, NONE, threading.Event())]
    assert names == ["quick", "slow"]


def test_jobs_run_beside_each_other(job, tmp_path):
    """Each waits for the other's file."""
    code = (
        "import pathlib, time\n"
        "pathlib.Path('{0}').touch()\n"
        "while not pathlib.Path('{1}').exists(): time.sleep(0.01)\n"
    )
    jobs = [job("one", code.format("a", "b")), job("other", code.format("b", "a"))]
    found = outcomes(LocalEngine(2), jobs, JobLimits(seconds=30.0))
    assert [one.status for one in found.values()] == ["done", "done"]


def test_a_job_that_takes_too_long_is_ended(job):
    begun = time.monotonic()
    found = run_job(job("endless", "while True: pass"), JobLimits(seconds=0.5))
    assert found.status == "too_slow"
    assert time.monotonic() - begun < 20.0


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux")
def test_a_job_that_allocates_too_much_is_reported(job):
    limits = JobLimits(mebibytes=200)
    assert run_job(job("large", "bytearray(1 << 30)"), limits).status == "too_large"
    assert run_job(job("small", "bytearray(1 << 20)"), limits).status == "done"


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_a_job_that_was_killed_is_run_again(job, tmp_path):
    first_dies = (
        "import os, pathlib, signal\n"
        "mark = pathlib.Path('begun')\n"
        "if not mark.exists():\n"
        "    mark.touch()\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    found = run_job(job("unlucky", first_dies), JobLimits(retries=1))
    assert (found.status, found.attempts) == ("done", 2)
    always = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    found = run_job(job("doomed", always), JobLimits(retries=2))
    assert (found.status, found.attempts) == ("killed", 3)


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_a_stopped_run_ends_its_processes_and_begins_no_others(job, tmp_path):
    stop = threading.Event()
    code = (
        "import os, pathlib, time\n"
        "pathlib.Path('process').write_text(str(os.getpid()))\n"
        "time.sleep(600)\n"
    )
    jobs = [job("endless", code), job("next", "open('next', 'w')")]
    told: list[JobEnd] = []
    run = threading.Thread(target=lambda: told.extend(LocalEngine(1).run(jobs, NONE, stop)))
    run.start()
    while not (mark := tmp_path / "process").exists() or not mark.read_text():
        time.sleep(0.02)
    stop.set()
    run.join(20.0)
    assert not run.is_alive()
    assert told == []
    assert not (tmp_path / "next").exists()
    with pytest.raises(ProcessLookupError):
        os.kill(int(mark.read_text()), 0)


def test_who_takes_no_more_outcomes_leaves_no_process(job):
    jobs = [job("quick", "pass"), job("endless", "import time; time.sleep(600)")]
    stop = threading.Event()
    run = LocalEngine(2).run(jobs, NONE, stop)
    assert next(run).name == "quick"
    begun = time.monotonic()
    run.close()
    assert time.monotonic() - begun < 20.0


@pytest.mark.long
def test_ray_gives_the_same_outcomes(job):
    pytest.importorskip("ray", reason="Ray is an extra: pip install 'slowtime[ray]'")
    jobs = [job("good", "pass"), job("bad", "raise SystemExit('no such file')")]
    ours, theirs = outcomes(engine_for("local", 1), jobs), outcomes(engine_for("ray"), jobs)
    assert {n: (o.status, o.message) for n, o in ours.items()} == {
        n: (o.status, o.message) for n, o in theirs.items()
    }


def test_without_ray_its_install_line_is_told(job, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'slowtime\[ray\]'"):
        next(iter(engine_for("ray").run([job("good", "pass")], NONE, threading.Event())))


def test_ctrl_c_does_not_reach_jobs(job):
    """The caller of a run decides what a signal means; its processes are in a session apart."""
    code = "import os; raise SystemExit(int(os.getpgid(0) != os.getpid()))"
    if os.name == "posix":
        assert run_job(job("apart", code), NONE).status == "done"
        assert signal.getsignal(signal.SIGINT) is not None

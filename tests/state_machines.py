"""Runs Hypothesis state machines: the same short share each time, long ones, planted faults."""

import itertools
import os
import random
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis.stateful import RuleBasedStateMachine, run_state_machine_as_test

LONG_S = float(os.environ.get("SLOWTIME_MODEL_S", "30"))
"""How long a state machine looks for faults where time is given to it [s]."""

_SHARE = settings(
    max_examples=60,
    stateful_step_count=30,
    derandomize=True,
    database=None,
    deadline=None,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
    report_multiple_bugs=False,
)


def run_share(machine: type[RuleBasedStateMachine], examples: int = 60) -> None:
    """Run a machine on the same examples each time."""
    run_state_machine_as_test(machine, settings=settings(_SHARE, max_examples=examples))


def run_long(machine: type[RuleBasedStateMachine], seconds: float = LONG_S) -> int:
    """Run a machine on new examples until the time is over; return how many there were."""
    until_s, count = time.monotonic() + seconds, 0
    for _ in itertools.count():
        if time.monotonic() >= until_s:
            return count
        number = random.SystemRandom().getrandbits(64)
        own = type(machine.__name__, (machine,), {})
        given = settings(
            _SHARE, derandomize=False, max_examples=20, stateful_step_count=60,
            phases=(Phase.generate, Phase.shrink), print_blob=True,
        )  # fmt: skip
        run_state_machine_as_test(seed(number)(own), settings=given)
        count += given.max_examples
    raise AssertionError


def assert_found(machine: type[RuleBasedStateMachine], examples: int = 60) -> None:
    """Assert that the share of a machine fails: a fault was planted before."""
    try:
        run_share(machine, examples)
    except Exception:  # as the fault may show: a wrong result, or an error
        return
    pytest.fail(f"{machine.__name__} does not notice the fault.")


class Steps:
    """Line events of some files while they were watched."""

    def __init__(self) -> None:
        self.count = 0


@contextmanager
def steps_in(*folders: Path) -> Iterator[Steps]:
    """Count the lines that are run in the files of some folders."""
    steps, names = Steps(), tuple(str(folder) for folder in folders)
    before = sys.gettrace()

    def line(frame, event, argument):
        steps.count += event == "line"
        return line

    def call(frame, event, argument):
        return line if frame.f_code.co_filename.startswith(names) else None

    sys.settrace(call)
    try:
        yield steps
    finally:
        sys.settrace(before)

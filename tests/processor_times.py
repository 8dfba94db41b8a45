"""Pytest plugin: lists the tests that are too long for the default suite.

``make test-times`` runs all tests that are not ``slow`` with this plugin, which writes
``tests/long_tests.txt``. `tests/conftest.py` marks the tests listed there as ``long``.
Processor time is measured, as the time on the clock depends on what else the machine does; a
fixture that several tests share counts for the first of them.
"""

import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

LONG_TESTS = Path(__file__).with_name("long_tests.txt")
MAX_DEFAULT_S = 1.0
"""[s] Processor time of a test of the default suite. Source: judgement; 8,000 tests then
take about nine minutes on two cores."""


def processor_s() -> float:
    """Return the processor time of this process and of its ended children [s]."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


class ProcessorTimes:
    """Measures each test, and writes the list at the end of the session."""

    def __init__(self) -> None:
        self.long: list[str] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Measure a test with its fixtures."""
        before = processor_s()
        result = yield
        if processor_s() - before > MAX_DEFAULT_S:
            self.long.append(item.nodeid)
        return result

    def pytest_sessionfinish(self) -> None:
        """Write the identifiers of long tests, sorted, one a line."""
        LONG_TESTS.write_text("".join(f"{one}\n" for one in sorted(self.long)))


def pytest_configure(config: pytest.Config) -> None:
    """Join pytest, where this module is given to it as a plugin."""
    config.pluginmanager.register(ProcessorTimes())


def mark_long_tests(items: list[pytest.Item]) -> None:
    """Mark the listed tests as long, but for those that are a gate.

    Parameters
    ----------
    items
        Collected tests.
    """
    listed = set(LONG_TESTS.read_text().splitlines())
    for item in items:
        if item.nodeid in listed and item.get_closest_marker("gate") is None:
            item.add_marker(pytest.mark.long)

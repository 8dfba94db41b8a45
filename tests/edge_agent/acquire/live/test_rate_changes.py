"""A device that samples at another rate than the nominal one, or changes it."""

import threading

import numpy as np
import pytest

from edge_agent.acquire import LiveSource
from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened
from edge_agent.inputs import LiveInput

from .devices import START_NS

NOMINAL_HZ, PER_MESSAGE = 100.0, 10


class Arrivals:
    """Messages that come at given times, then the end."""

    is_stream, ends = False, True

    def __init__(self, taken_s, rng):
        self._came_s = np.maximum.accumulate(taken_s + rng.exponential(0.02, len(taken_s)))

    def packets(self, stop):
        for number, came_s in enumerate(self._came_s.tolist()):
            first = number * PER_MESSAGE
            lines = "\n".join(f"{n},{n}" for n in range(first, first + PER_MESSAGE))
            yield Packet(lines.encode(), START_NS + round(came_s * 1e9))

    def close(self):
        pass


def blocks_of(taken_s, seed=0):
    """Blocks of messages whose last samples were taken at these times, and what was counted."""
    live = LiveInput.of(f"stdin:?layout=csv&counter=0&channels=x&rate_hz={NOMINAL_HZ}")
    came = Arrivals(np.asarray(taken_s), np.random.default_rng(seed))
    opened = Opened(came, live.layout, NOMINAL_HZ)
    source = LiveSource(live, opened, threading.Event())
    return list(source), source.counts()


def times_s(block, sample):
    """When a sample was taken, as its block says."""
    return (block.start_ns - START_NS) / 1e9 + sample / block.true_rate_hz


@pytest.mark.parametrize("rate_hz", [125.0, 60.0])
def test_a_rate_that_changes_is_told_by_every_block_after_it_and_loses_nothing(rate_hz):
    steps_s = [PER_MESSAGE / NOMINAL_HZ] * 300 + [PER_MESSAGE / rate_hz] * 400
    blocks, counts = blocks_of(np.cumsum(steps_s))
    assert (counts["rate_changes"], counts["samples_lost"]) == (1, 0)
    values = np.concatenate([block.samples[:, 0] for block in blocks])
    np.testing.assert_array_equal(values, np.arange(7_000))
    rates = [block.rate_hz for block in blocks]
    changed = next(at for at, rate in enumerate(rates) if rate != NOMINAL_HZ)
    assert len(set(rates[changed:])) == 1
    assert rates[-1] == pytest.approx(rate_hz, rel=0.01)
    # Three windows of 5 s each, the first of which may hold the change itself.
    assert blocks[changed].samples[0, 0] < 3_000 + 21 * rate_hz
    assert not blocks[changed].follows(blocks[changed - 1])
    last = blocks[-1]
    assert last.clock is not None
    assert abs(last.true_rate_hz / rate_hz - 1) < 4 * last.clock.sd < 1e-3
    assert times_s(last, len(last.samples) - 1) == pytest.approx(sum(steps_s), abs=0.06)


def test_a_device_faster_than_its_nominal_rate_is_told_at_its_own_from_the_first_block():
    steps_s = [PER_MESSAGE / 250.0] * 1_000
    blocks, counts = blocks_of(np.cumsum(steps_s))
    assert (counts["rate_changes"], counts["samples_lost"]) == (1, 0)
    assert len({block.rate_hz for block in blocks}) == 1
    assert blocks[0].rate_hz == pytest.approx(250.0, rel=0.01)
    assert blocks[0].samples[0, 0] == 0
    # Back over 15 s, at a rate that is known to three digits.
    assert times_s(blocks[0], 0) == pytest.approx(0.0, abs=0.2)
    assert sum(len(block.samples) for block in blocks) == 10_000
    # It is held until three windows of 5 s agree, and no longer.
    assert len(blocks[1].samples) < len(blocks[0].samples) < 250 * 16

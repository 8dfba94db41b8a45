"""At its defaults an edge's 95 % intervals hold, from raw samples to the message."""

import numpy as np
import pytest

from edge_agent.pipeline import Edge
from edge_agent.settings import Origin, Processing
from slowtime.signals.block import Block
from tests.slowtime.identification.oscillators import record

STREAMS, WINDOWS = 40, 3
ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="recorded", slow_time_unit="s")


def told(samples, rate_hz):
    """Modes that an edge at its defaults tells of a stream."""
    block = Block(
        samples=samples,
        rate_hz=rate_hz,
        first_index=0,
        start_ns=10**18,
        channels=("acc",),
        units=("m/s^2",),
    )
    edge = Edge.of(Processing(), ORIGIN)
    state, messages = edge.step(edge.start(), block)
    messages += edge.finish(state)[1]
    return [mode for message in messages for mode in message.modes]


@pytest.mark.long
def test_windows_of_plain_streams_hold_the_truth():
    """Streams of one mode: 1-20 Hz, 0.5-5 % damping, 50-200 Hz, 1-20 % noise."""
    scores = []
    for seed in range(STREAMS):
        rng = np.random.default_rng([91, seed])
        f, z = np.exp(rng.uniform(np.log((1.0, 0.005)), np.log((20.0, 0.05))))
        rate = float(rng.choice([rate for rate in (50.0, 100.0, 200.0) if rate > 2.5 * f]))
        seconds = 60.0 * WINDOWS + 1.0
        noise = rng.uniform(0.01, 0.2)
        modes = told(record(rng, f=f, z=z, rate=rate, seconds=seconds, noise=noise), rate)
        assert len(modes) == WINDOWS
        for mode in modes:
            cycles = 2.0 * np.pi * z * f * 60.0  # with the true damping, which nobody knows
            assert ("few_cycles" in mode.flags) == (cycles < 50.0) or 25.0 < cycles < 100.0
            pairs = (mode.frequency_hz, f), (mode.damping_ratio, z)
            scores.append([(one.value - truth) / one.sd for one, truth in pairs])
    held = (np.abs(scores) < 1.96).mean(axis=0)
    # Of 120 intervals of 95 % at least 90 % hold with probability 99 %.
    assert (held >= 0.90).all(), held
    assert np.abs(scores).max() < 4.5

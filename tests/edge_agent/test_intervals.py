"""At its defaults an edge's 95 % intervals hold, from raw samples to the message."""

import numpy as np

from edge_agent.pipeline import Edge
from edge_agent.settings import Origin, Processing
from slowtime.signals.block import Block
from tests.slowtime.identification.oscillators import record

RATE, WINDOWS = 50.0, 8
F, Z = 4.0, 0.02


def test_windows_of_a_plain_stream_hold_the_truth():
    rng = np.random.default_rng(1)
    samples = record(rng, f=F, z=Z, rate=RATE, seconds=60.0 * WINDOWS + 1, noise=0.01)
    block = Block(
        samples=samples,
        rate_hz=RATE,
        first_index=0,
        start_ns=10**18,
        channels=("acc",),
        units=("m/s^2",),
    )
    origin = Origin(
        site="lab", asset="beam", boot="b1", time_base="recorded", slow_time_unit="s"
    )
    edge = Edge.of(Processing(), origin)
    state, messages = edge.step(edge.start(), block)
    messages += edge.finish(state)[1]
    modes = [mode for message in messages for mode in message.modes]
    assert len(modes) == WINDOWS
    assert all("few_cycles" in mode.flags for mode in modes)  # 2 pi zeta f T = 30
    f = np.array([(m.frequency_hz.value - F) / m.frequency_hz.sd for m in modes])
    z = np.array([(m.damping_ratio.value - Z) / m.damping_ratio.sd for m in modes])
    # Of 8 intervals of 95 % fewer than 6 hold with probability 0.6 %.
    assert np.sum(np.abs(f) < 1.96) >= 6
    assert np.sum(np.abs(z) < 1.96) >= 6

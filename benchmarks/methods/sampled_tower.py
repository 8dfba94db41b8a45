"""Features of a monitored tower that an edge agent identifies from simulated samples.

The samples are the motion of the lowest modes of the full model under white forces of equal
strength on each, at all channels, with noise; `MultiModeReader` identifies and tracks them
window by window, as an agent does.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from edge_agent.extract.multiple_modes import MultiModeReader
from edge_agent.extract.reader import Memory, Window
from edge_agent.settings import ExtractSettings
from slowtime_schemas.messages import Features, Quality

from .monitored_tower import DAMPING_RATIO, START_NS, ChannelModes, TowerTwin

NOISE = 0.01
"""Of each channel, over its own motion [1]."""
RATE_RATIO = 2.6
"""Samples per second over the highest frequency [1]: no mode beyond half the rate."""
SETTLED = 8.0
"""Time constants of the slowest mode before the first sample [1]."""


@dataclasses.dataclass(slots=True, eq=False)
class SampledTower:
    """A tower whose features are identified from samples.

    Parameters
    ----------
    tower
        The full model and its twin.
    memory
        Of the agent: the modes it tracks.
    sequence
        Number of the next window.
    """

    tower: TowerTwin
    memory: Memory = dataclasses.field(default_factory=Memory)
    sequence: int = 0

    def epoch(self, true: ChannelModes, rng: np.random.Generator) -> Features:
        """Simulate a window, identify its modes, and make the message of an agent.

        Parameters
        ----------
        true
            Modes of the full model at the channels.
        rng
            Of forces and noise.

        Returns
        -------
        Features of one window.
        """
        rate_hz = RATE_RATIO * float(true.frequency_hz.max())
        rows = accelerations(true, self.tower.window_s, rate_hz, rng)
        reader = MultiModeReader(ExtractSettings(method="modes", most=len(true.frequency_hz)))
        channels, position = self.tower.full.channels, float(self.sequence)
        window = Window(rows, rate_hz, channels, position)
        self.memory, read = reader.step(self.memory, window)
        t_ns = START_NS + self.sequence * round(self.tower.window_s * 1e9)
        self.sequence += 1
        return Features(
            site="lab", asset="tower", boot="b1", sequence=self.sequence - 1, t_ns=t_ns,
            start_ns=t_ns, slow_time=position, time_base="simulated", method="ssi",
            channels=channels, modes=read.modes, quality=Quality(samples=len(rows)), truth=None,
        )  # fmt: skip


def accelerations(
    true: ChannelModes, seconds: float, rate_hz: float, rng: np.random.Generator
) -> Float[np.ndarray, "time channel"]:
    """Simulate modes under white forces of equal strength, with noise in each channel.

    Parameters
    ----------
    true
        Modes at the channels.
    seconds, rate_hz
        Length and sampling rate of the record.
    rng
        Of forces and noise.

    Returns
    -------
    Samples, in a unit of their own.
    """
    turn = 2.0 * np.pi * true.frequency_hz
    pole = turn * (-DAMPING_RATIO + 1j * np.sqrt(1.0 - DAMPING_RATIO**2))
    count = round(seconds * rate_hz)
    before = int(SETTLED * rate_hz / (DAMPING_RATIO * float(turn.min())))
    motion = np.zeros((count, len(true.shapes)))
    for own, shape in zip(pole, true.shapes.T, strict=True):
        force = rng.standard_normal(before + count)
        state = lfilter([1.0], [1.0, -np.exp(own / rate_hz)], force)[before:]
        motion += np.outer((own**2 / (1j * own.imag) * state).real, shape)
    return np.asarray(motion + NOISE * motion.std(axis=0) * rng.standard_normal(motion.shape))

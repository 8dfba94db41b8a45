"""Messages of a device whose clock is wrong, over a network that delays them."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

BEGAN_NS = 1_700_000_000 * 10**9


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Messages:
    """A device and the way to the host; times in seconds, rates relative."""

    seconds: float = 300.0
    rate_hz: float = 200.0
    per_message: int = 10
    correction: float = 0.01
    jitter: str = "exponential"
    jitter_s: float = 0.02
    burst: int = 8
    stalls: int = 2
    loss: float = 1e-3
    step_s: float = 0.0
    jump: float = 0.0
    """Of the correction, half way."""
    drift: float = 0.0
    """Of the correction, over the whole."""


@dataclasses.dataclass(frozen=True, slots=True)
class Came:
    """What came, and the true time of each message's last sample."""

    index: Int[np.ndarray, " message"]
    arrival_ns: Int[np.ndarray, " message"]
    true_ns: Int[np.ndarray, " message"]


def messages(rng: np.random.Generator, given: Messages) -> Came:
    """Let them come."""
    count = int(given.seconds * given.rate_hz / given.per_message)
    index = np.arange(1, count + 1) * given.per_message
    x = index / given.rate_hz
    half = given.seconds / 2
    taken = x / (1 + given.correction) - given.drift * x**2 / (2 * given.seconds)
    taken = taken - np.maximum(0.0, x - half) * given.jump
    last = np.minimum((np.arange(count) // given.burst + 1) * given.burst - 1, count - 1)
    ready = taken[last]
    bursts = latency(rng, given, count // given.burst + 1)
    late = np.repeat(bursts, given.burst)[:count] + np.abs(rng.normal(0.0, 2e-4, count))
    for begin in rng.uniform(0, given.seconds, given.stalls):
        end = begin + rng.uniform(1.0, 4.0)
        held = (ready >= begin) & (ready < end)
        late[held] = np.maximum(late[held], end - ready[held] + rng.exponential(0.02))
    arrived = np.maximum.accumulate(ready + late)
    if given.step_s:
        arrived = arrived + given.step_s * (x > rng.uniform(0.2, 0.8) * given.seconds)
    kept = rng.random(count) >= given.loss
    return Came(
        index[kept],
        BEGAN_NS + np.round(arrived[kept] * 1e9).astype(np.int64),
        BEGAN_NS + np.round(taken[kept] * 1e9).astype(np.int64),
    )


def latency(
    rng: np.random.Generator, given: Messages, count: int
) -> Float[np.ndarray, " message"]:
    """Latency of each burst, of standard deviation about `jitter_s`."""
    scale = given.jitter_s
    if given.jitter == "exponential":
        return rng.exponential(scale, count)
    if given.jitter == "uniform":
        return rng.uniform(0.0, 2 * scale, count)
    if given.jitter == "gamma":
        return rng.gamma(3.0, scale / np.sqrt(3.0), count)
    quick = rng.normal(0.25 * scale, 0.05 * scale, count)
    slow = rng.normal(2.25 * scale, 0.25 * scale, count)
    return np.maximum(0.0, np.where(rng.random(count) < 0.7, quick, slow))

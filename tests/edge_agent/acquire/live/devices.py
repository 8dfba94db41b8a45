"""Devices that lose, repeat, reorder, pause and begin anew, with the truth beside them."""

import dataclasses

import numpy as np

START_NS = 1_800_000_000_000_000_000


@dataclasses.dataclass
class Sent:
    """What a device has sent, in order of arrival, and what has been lost on the way."""

    messages: list[tuple[int, int, int, np.ndarray]]
    """Arrival [ns], raw counter, stamp [us], rows."""
    lost: int = 0
    duplicated: int = 0
    restarts: int = 0


def device(
    rng,
    *,
    rate_hz=100.0,
    samples=20_000,
    per_message=1,
    bits=64,
    loss=0.001,
    bursts=0,
    burst=8,
    restart_at=None,
    off_s=3.0,
    jitter_s=0.02,
    error=0.0,
    duplicates=0.0,
    reorder=0.0,
    pauses=(),
):
    """Messages of a device whose value is the number of the sample."""
    messages, counter, boot_ns, off_ns, sent = [], 0, 0, 0, Sent([])
    count = samples // per_message
    gone = set(np.flatnonzero(rng.random(count) < loss).tolist())
    for begin in rng.integers(count // 10, count - 50, bursts).tolist():
        gone |= set(range(begin, begin + burst))
    # What is lost before the first or after the last that came, nobody can know of.
    gone -= {0, count - 1}
    restart = None if restart_at is None else round(restart_at * count)
    if restart is not None:
        gone -= {restart - 1, restart}
        sent.restarts = 1
    for n in range(count):
        if n == restart:
            counter, off_ns = 0, round(off_s * 1e9)
            boot_ns = n * per_message
        first = n * per_message
        taken_ns = (
            START_NS + off_ns + round((first + per_message - 1) * 1e9 / rate_hz / (1 + error))
        )
        stamp_us = round((first - boot_ns) * 1e6 / rate_hz / (1 + error))
        arrival = taken_ns + round(rng.exponential(jitter_s) * 1e9)
        for begin, seconds in pauses:
            if begin <= n < begin + seconds * rate_hz / per_message:
                arrival = max(
                    arrival, START_NS + round((begin * per_message / rate_hz + seconds) * 1e9)
                )
        rows = np.arange(first, first + per_message, dtype=float)[:, None] * np.ones(2)
        if n in gone:
            sent.lost += per_message
        else:
            messages.append((arrival, counter % 2**bits, stamp_us, rows))
            if rng.random() < duplicates:
                messages.append((arrival + 1000, counter % 2**bits, stamp_us, rows))
                sent.duplicated += per_message
        counter += per_message
    # A connection keeps the order of what is sent.
    arrivals = np.maximum.accumulate([m[0] for m in messages])
    messages = [(int(a), *m[1:]) for a, m in zip(arrivals, messages, strict=True)]
    for n in np.flatnonzero(rng.random(len(messages) - 1) < reorder).tolist():
        one, other = messages[n], messages[n + 1]
        messages[n], messages[n + 1] = other, (other[0], *one[1:])
    sent.messages = messages
    return sent

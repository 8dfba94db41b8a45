"""The verb `publish`: sends the readings of a simulated acceleration board."""

import itertools
import time

import numpy as np

from slowtime_services.board import Board, sender_to
from slowtime_services.shutdown import ended_by_signals


def publish(
    url: str,
    rate_hz: float,
    frequency_hz: float,
    samples: int,
    clock_error: float,
    loss: float,
    seconds: float | None,
    seed: int,
    connect: str,
) -> int:
    """Simulate an acceleration board on a simulated structure."""
    rng = np.random.default_rng(seed)
    board = Board(rate_hz=rate_hz, frequency_hz=frequency_hz)
    most = None if seconds is None else max(1, round(seconds * rate_hz / samples))
    every_s = samples / rate_hz / (1 + clock_error)
    with ended_by_signals() as stop:
        sender = sender_to(url, rate_hz, connect)
        began_s = time.monotonic()
        try:
            for n, readings in enumerate(
                itertools.islice(board.readings(samples, np.random.default_rng(seed)), most)
            ):
                if stop.wait(max(0.0, began_s + (n + 1) * every_s - time.monotonic())):
                    break
                if rng.random() >= loss:
                    sender.send(readings)
        finally:
            sender.close()
    return 0

"""A source: a device that is asked for a block, played here by a swinging beam.

``beacon://beam?f_hz=4`` names it; the layout of its lines stands in the same URL.
"""

import math
import random
import time
from collections.abc import Iterator
from urllib.parse import parse_qs, urlsplit

RATE_HZ, BLOCK = 100.0, 50


def read(url: str) -> Iterator[bytes]:
    """Yield a packet for each sample: its counter and one acceleration, as a line of text."""
    told = parse_qs(urlsplit(url).query)
    f_hz = float(told.get("f_hz", ["4"])[0])
    noise = random.Random(1)
    omega, zeta, dt = 2 * math.pi * f_hz, 0.01, 1 / RATE_HZ
    place, speed, began = 0.0, 0.0, time.monotonic()
    for number in range(10**9):
        pull = -(omega**2) * place - 2 * zeta * omega * speed + noise.gauss(0.0, 10.0)
        speed += dt * pull
        place += dt * speed
        yield f"{number},{pull:.6f}".encode()
        if number % BLOCK == BLOCK - 1:
            time.sleep(max(0.0, began + number * dt - time.monotonic()))

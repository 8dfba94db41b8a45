"""The table of files: which are made, with which seeds."""

import random
from collections.abc import Iterator

from .made import CLOCKS, FACTS, Case, table, wrapped


def cases(seed: int = 1, rounds: int = 1) -> Iterator[Case]:
    """All kinds of clocks and headings, with delimiters, sides and losses drawn by `seed`."""
    rng = random.Random(seed)
    for turn in range(rounds):
        for clock in CLOCKS:
            for loss in ("", "gap") if turn % 2 == 0 else ("", "NA"):
                if loss and clock in ("whole seconds", "hhmmss"):
                    loss = ""
                name = f"{turn}: {clock}, {loss or 'whole'}"
                yield table(rng, clock=clock, facts=None, name=name, loss=loss)
        for facts in FACTS:
            for loss in ("", "NA"):
                name = f"{turn}: {facts}, {loss or 'whole'}"
                side = "" if loss else None
                yield table(rng, clock=None, facts=facts, name=name, loss=loss, side=side)
        for clock in ("seconds", "time_us", "iso"):
            for facts in ("rate", "count", "german"):
                yield table(rng, clock=clock, facts=facts, name=f"{turn}: {clock} and {facts}")
            yield table(
                rng, clock=clock, facts=None, name=f"{turn}: {clock}, 2 of 60", loss="regular"
            )
        for kind in ("peer", "peer, old", "duration", "count", "csmip"):
            for width in (4, 5, 8, 10):
                yield wrapped(rng, kind, f"{turn}: {kind}, {width} a line", width)

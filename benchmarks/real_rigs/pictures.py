"""Pictures of what was held out: measured and simulated, and what is left."""

from pathlib import Path

import numpy as np

from .pieces import Array
from .running import BLACK_BOX, SINDY, SLOWTIME
from .scores import REFITTED, ScoredSet

MEASURED = "#5b6770"
COLOURS = {
    REFITTED: "#c99a2e",
    SINDY.title: "#7b2fa0",
    BLACK_BOX.title: "#2e7d4f",
    SLOWTIME.title: "#0b6fb8",
}
MOST_DRAWN = 1600
"""[samples] Of a record: about those of the picture's width. Source: a choice."""
LEAST_LEFT, MOST_LEFT = 0.02, 0.6
"""[share of the motion] That the lower axis spans, from and to. Source: a choice."""
INCHES, DPI = (8.0, 3.6), 80
"""[inch], [1/inch] Size of a picture; 20 to 50 kB. Source: a choice."""


def draw(outcome: ScoredSet, path: Path) -> None:
    """Draw the first record held out, the channel that moves most, and what is left of it."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    first = outcome.record == outcome.record[0]
    channel = int(np.argmax(outcome.measured[first].std(axis=0)))
    measured, times = outcome.measured[first, channel], outcome.times_s[first]
    shown = window(measured)
    times = times - times[0]
    figure, (above, below) = plt.subplots(
        2, 1, figsize=INCHES, sharex=True, height_ratios=(3, 2)
    )
    above.plot(times[shown], measured[shown], color=MEASURED, lw=2.4, label="measured")
    size = np.abs(measured[shown] - measured[shown].mean()).max()
    largest = LEAST_LEFT * size
    for name, colour in COLOURS.items():
        row = outcome.row(name)
        if row is None or row.run is None or len(row.run) != len(outcome.record):
            continue
        run = np.clip(row.run[first, channel], -1e3 * size, 1e3 * size)
        above.plot(times[shown], run[shown], color=colour, lw=0.9, label=name)
        left = (measured - run)[shown]
        below.plot(times[shown], left, color=colour, lw=0.8)
        if name != REFITTED:
            largest = max(largest, float(np.abs(left).max()))
    middle = measured[shown].mean()
    above.set_ylim(middle - 1.4 * size, middle + 1.4 * size)
    largest = min(1.1 * largest, MOST_LEFT * size)
    below.set_ylim(-largest, largest)
    above.set_ylabel(outcome.channels[channel])
    below.set_ylabel("left")
    below.set_xlabel("time [s]")
    above.legend(loc="upper right", fontsize=7, ncols=5, frameon=False)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    # No date inside: the same figures give the same file.
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
    plt.close(figure)


def window(values: Array) -> slice:
    """Return the samples that are drawn: all, or those about the largest."""
    if len(values) <= MOST_DRAWN:
        return slice(None)
    largest = int(np.argmax(np.abs(values - values.mean())))
    first = int(np.clip(largest - MOST_DRAWN // 2, 0, len(values) - MOST_DRAWN))
    return slice(first, first + MOST_DRAWN)

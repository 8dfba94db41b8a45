r"""A force and a law at one place, record by record, in; frequencies at which it turns, out.

A law that turns by a clock of its own, :math:`F = g(e, v) \cos(2 \pi f t + \varphi)`, has a
line at f in the product of F and g, whatever moves. The records of a campaign are far apart,
and a phase holds over all of them only for a frequency that is known to a part of one over the
campaign: first each record may have a phase of its own, then all have one.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.dynamics.effects.library.parameter_grids import lines_hz

Series = Float[np.ndarray, " _"]
Turned = tuple[Complex[np.ndarray, " _"], Float[np.ndarray, " _"]]

LINES, PHASES = 4, 2
"""Lines of each record that are looked at, and frequencies that are given for each."""
BLOCKS, FINE, CLOSER = 64, 8, 2
"""Parts of a record over which a turning force is summed; steps per one over a length, and how
often one looks closer by as much."""
MOST_STEPS = 4000


def modulation_frequencies_hz(
    forces: Sequence[Series],
    laws: Sequence[Series],
    times: Sequence[Series],
    heard: Sequence[float] = (),
) -> list[float]:
    """Frequencies by which a force may be its law turning, those that explain most first.

    Parameters
    ----------
    forces, laws
        The force, and what it would be if it did not turn.
    times
        Of the campaign [s].
    heard
        Lines that are looked at besides [Hz]: what is loud at the sensors may be little beside
        a force that they hardly hear.

    Examples
    --------
    >>> t = np.arange(4000) / 100
    >>> found = modulation_frequencies_hz([np.cos(2 * np.pi * 1.234 * t)], [np.ones(4000)], [t])
    >>> round(found[0], 3)
    1.234
    """
    products = [f * g for f, g in zip(forces, laws, strict=True)]
    power = [float(np.sum(g**2)) for g in laws]
    lengths = [float(t[-1] - t[0]) for t in times]
    if min(lengths) <= 0 or min(power) <= 0:
        return []
    width = 1.0 / min(lengths)
    lines: list[float] = []
    loudest = [lines_hz(p, t, LINES) for p, t in zip(products, times, strict=True)]
    for near in (heard, *loudest):
        for line in near:
            lines += [line] if all(abs(line - other) > width for other in lines) else []
    found = [one for line in lines for one in _about(line, products, power, times, lengths)]
    return [hertz for _, hertz in sorted(found, reverse=True) if hertz > 0]


def _about(
    line: float,
    products: Sequence[Series],
    power: Sequence[float],
    times: Sequence[Series],
    lengths: Sequence[float],
) -> list[tuple[float, float]]:
    """Give what is explained, and the frequency, at the best few about a line."""
    span = max(float(t[-1]) for t in times) - min(float(t[0]) for t in times)
    parts = [_turned(p, t, line) for p, t in zip(products, times, strict=True)]
    wide, fine = 1.0 / min(lengths), 1.0 / (FINE * max(lengths))
    steps = np.arange(-wide, wide + fine, fine)
    alone = sum(
        np.abs(_summed(part, steps)) ** 2 / one for part, one in zip(parts, power, strict=True)
    )
    middle = float(steps[int(np.argmax(alone))])
    count = min(2 * int(np.ceil(FINE * fine * 3 * span)) + 1, MOST_STEPS)
    steps = middle + np.linspace(-3 * fine, 3 * fine, max(count, 9))
    joint = _joint(parts, steps)
    inner = np.flatnonzero((joint >= np.roll(joint, 1)) & (joint >= np.roll(joint, -1)))
    found = []
    for best in inner[np.argsort(-joint[inner])[:PHASES]]:
        step, width = float(steps[best]), float(steps[1] - steps[0])
        for _ in range(CLOSER):
            near = step + width * np.linspace(-1, 1, 2 * FINE + 1)
            step, width = float(near[int(np.argmax(_joint(parts, near)))]), width / FINE
        explained = float(_joint(parts, np.array([step]))[0]) / sum(power)
        found.append((explained, line + step))
    return found


def _joint(
    parts: Sequence[Turned], steps: Float[np.ndarray, " step"]
) -> Float[np.ndarray, " step"]:
    """Square of the sum over all records with one phase."""
    return np.asarray(np.abs(sum(_summed(part, steps) for part in parts)) ** 2)


def _turned(product: Series, times: Series, line: float) -> Turned:
    """Sum over parts of a record, turned back by a line; tell when each part was."""
    edges = np.unique(np.linspace(0, len(times), BLOCKS + 1).astype(int))[:-1]
    turned = product * np.exp(-2j * np.pi * line * times)
    counts = np.diff(np.append(edges, len(times)))
    return np.add.reduceat(turned, edges), np.add.reduceat(times, edges) / counts


def _summed(part: Turned, steps: Float[np.ndarray, " step"]) -> Complex[np.ndarray, " step"]:
    sums, when = part
    return np.asarray(np.exp(-2j * np.pi * np.outer(steps, when)) @ sums)

r"""Frequencies by which a force is a law modulated by a sine.

A law that is modulated independently of the motion,
:math:`F = g(e, v) \cos(2 \pi f t + \varphi)`, has a
line at f in the product of F and g. The records of a campaign are far apart, so that one phase
holds for all of them only if f is known to a fraction of one over the campaign. First each
record has a phase of its own, then all have one.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.dynamics.effects.library.parameter_grids import lines_hz

Series = Float[np.ndarray, " _"]
Demodulated = tuple[Complex[np.ndarray, " _"], Float[np.ndarray, " _"]]

MAX_LINES = 4
"""[lines] Of each record that are looked at. Source: docs/what_decides.md: half and double
change no answer."""
MAX_FREQUENCIES = 2
"""[1] That are proposed for each line. Source: docs/what_decides.md: half and double change no
answer."""
BLOCKS = 64
"""[1] Parts of a record over which a demodulated force is summed. Source: speed; frequencies
within 1/length of a line turn by less than a tenth in one part."""
STEPS_PER_LINE = 8
"""[1] Steps of the frequency over one spacing of lines. Source: docs/what_decides.md: half and
double change no answer."""
REFINEMENTS = 2
"""[1] Times the step is refined by as much. Source: docs/what_decides.md: half and double
change no answer."""
MAX_STEPS = 4000
"""[1] Frequencies of one scan at most. Source: bounds memory."""


def modulation_frequencies_hz(
    forces: Sequence[Series],
    laws: Sequence[Series],
    times: Sequence[Series],
    heard: Sequence[float] = (),
) -> list[float]:
    """Frequencies [Hz] by which a force may be a modulated law, the best first.

    Parameters
    ----------
    heard
        Further lines to look at [Hz]: a line that is strong at the sensors may be weak in a
        force that they hardly sense.

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
    loudest = [lines_hz(p, t, MAX_LINES) for p, t in zip(products, times, strict=True)]
    for near in (heard, *loudest):
        for line in near:
            lines += [line] if all(abs(line - other) > width for other in lines) else []
    found = [
        one
        for line in lines
        for one in _refine_about_line(line, products, power, times, lengths)
    ]
    return [hertz for _, hertz in sorted(found, reverse=True) if hertz > 0]


def _refine_about_line(
    line: float,
    products: Sequence[Series],
    power: Sequence[float],
    times: Sequence[Series],
    lengths: Sequence[float],
) -> list[tuple[float, float]]:
    """Share explained, and frequency, of the best few about a line."""
    span = max(float(t[-1]) for t in times) - min(float(t[0]) for t in times)
    parts = [_demodulated(p, t, line) for p, t in zip(products, times, strict=True)]
    wide, fine = 1.0 / min(lengths), 1.0 / (STEPS_PER_LINE * max(lengths))
    steps = np.arange(-wide, wide + fine, fine)
    alone = sum(
        np.abs(_dtft(part, steps)) ** 2 / one for part, one in zip(parts, power, strict=True)
    )
    middle = float(steps[int(np.argmax(alone))])
    count = min(2 * int(np.ceil(STEPS_PER_LINE * fine * 3 * span)) + 1, MAX_STEPS)
    steps = middle + np.linspace(-3 * fine, 3 * fine, max(count, 9))
    joint = _joint_power(parts, steps)
    inner = np.flatnonzero((joint >= np.roll(joint, 1)) & (joint >= np.roll(joint, -1)))
    found = []
    for best in inner[np.argsort(-joint[inner])[:MAX_FREQUENCIES]]:
        step, width = float(steps[best]), float(steps[1] - steps[0])
        for _ in range(REFINEMENTS):
            near = step + width * np.linspace(-1, 1, 2 * STEPS_PER_LINE + 1)
            step, width = (
                float(near[int(np.argmax(_joint_power(parts, near)))]),
                width / STEPS_PER_LINE,
            )
        explained = float(_joint_power(parts, np.array([step]))[0]) / sum(power)
        found.append((explained, line + step))
    return found


def _joint_power(
    parts: Sequence[Demodulated], steps: Float[np.ndarray, " step"]
) -> Float[np.ndarray, " step"]:
    """Squared modulus of the sum over all records, with one phase."""
    return np.asarray(np.abs(sum(_dtft(part, steps) for part in parts)) ** 2)


def _demodulated(product: Series, times: Series, line: float) -> Demodulated:
    """Demodulate a record by a line, summed over blocks; give sums and mean times."""
    edges = np.unique(np.linspace(0, len(times), BLOCKS + 1).astype(int))[:-1]
    turned = product * np.exp(-2j * np.pi * line * times)
    counts = np.diff(np.append(edges, len(times)))
    return np.add.reduceat(turned, edges), np.add.reduceat(times, edges) / counts


def _dtft(part: Demodulated, steps: Float[np.ndarray, " step"]) -> Complex[np.ndarray, " step"]:
    sums, when = part
    return np.asarray(np.exp(-2j * np.pi * np.outer(steps, when)) @ sums)

r"""Blocks of an endless stream in, modes as they are known so far out; bounded memory and work.

Every band of :mod:`..bands` is moved to zero frequency by overlapping frames of the stream and
sampled as slowly as it is wide. Products of the slow series are summed over stretches: of equal
length from the beginning on, two becoming one whenever there are too many (nothing is
forgotten), or fading with age. From these sums the subspace models of a band are solved anew
when it is due. Neither memory nor work per second depends on how long the stream has run.

What was lost on the way costs the frames that it falls into, no more: a stretch after a gap
adds its products to those of the stretches before.

Modes flagged `crowded` have more close neighbours than are fitted together: over many hours
their errors outgrow their standard deviations. A machine whose speed wanders is told as a mode
of little damping; one that keeps its speed, as what it is.

Examples
--------
Two sensors that hear one mode of 2 Hz, taken in by the second:

>>> import numpy as np, scipy.signal as sps
>>> pole = np.exp((-0.02 * 4 * np.pi + 4j * np.pi) / 20.0)
>>> force = np.random.default_rng(1).standard_normal(20_000)
>>> sway = sps.lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], force)
>>> samples = np.stack([sway, -0.5 * sway], axis=1)
>>> recursive = RecursiveModes(rate_hz=20.0, band_hz=(1.5, 3.0), every_s=500.0)
>>> state = recursive.start()
>>> for at in range(0, len(samples), 20):
...     state, modes = recursive.step(state, samples[at : at + 20])
>>> [(round(mode.frequency_hz.value, 1), mode.shape.real.round(2)) for mode in modes]
[(2.0, array([ 0.89, -0.45]))]
"""

from .identifier import RecursiveModes, RecursiveState

__all__ = [
    "RecursiveModes",
    "RecursiveState",
]

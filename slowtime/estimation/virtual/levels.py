r"""How large latent forces and noises are, from the spectra of the channels.

With :math:`V_f = \sum_l s_l G_{l,f}` the spectral density that the model gives the channels and
:math:`\hat S_f` what a window shows, the Whittle likelihood :math:`-\sum_f n_f [\ln\det V_f +
\operatorname{tr} V_f^{-1} \hat S_f]` grows with each step

.. math:: s_l \leftarrow s_l \sqrt{\frac{\sum_f n_f \operatorname{tr}(G_{l,f} V_f^{-1} \hat S_f
          V_f^{-1})}{\sum_f n_f \operatorname{tr}(G_{l,f} V_f^{-1})}}

which keeps every level positive.

References
----------
.. [1] H. Zhou, L. Hu, J. Zhou, K. Lange, "MM algorithms for variance components models",
   J. Comput. Graph. Stat. 28 (2019) 350-361.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

RELATIVE_WIDTH = 0.01
"""Frequencies that are averaged, relative to their middle [1]: half the width of a resonance of
1 % damping."""
HIGHEST = 0.45
"""Upper edge of the frequencies that are fitted, as a share of the sampling rate [1]."""
FLOOR = 1e-12
"""Of a level of force, relative to the largest [1]."""
QUIETEST = 1e-8
"""Variance of a channel's noise, relative to that of the samples [1]: a resolution of 13 bits.
What is less makes the filters' equations singular."""
SILENT = 1e-20
"""Least variance of noise [m^2/s^4], where all channels are dead."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Frequencies of a window of given length, gathered into groups.

    Parameters
    ----------
    bins
        Number of the first transform bin of each group, and one past the last of all.
    frequency_hz
        Of the bins, from the first group on.
    """

    bins: np.ndarray
    frequency_hz: Float[np.ndarray, " bin"]

    @classmethod
    def of(cls, count: int, rate_hz: float, lowest_hz: float) -> "Groups":
        """Gather the frequencies of a window of `count` samples."""
        spacing = rate_hz / count
        first = max(2, int(np.ceil(lowest_hz / spacing)))
        last = int(HIGHEST * count)
        edges = [first]
        while edges[-1] < last:
            edges.append(max(edges[-1] + 1, int(edges[-1] * (1 + RELATIVE_WIDTH))))
        return cls(np.array(edges), spacing * np.arange(first, edges[-1]))

    @property
    def sizes(self) -> Float[np.ndarray, " group"]:
        """Bins of each group."""
        return np.diff(self.bins).astype(float)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Average values of the bins over each group."""
        sums = np.add.reduceat(values, self.bins[:-1] - self.bins[0], axis=0)
        return np.asarray(sums / self.sizes.reshape(-1, *[1] * (values.ndim - 1)))

    def spectra(
        self, samples: Float[np.ndarray, "time channel"], rate_hz: float
    ) -> Complex[np.ndarray, "group channel channel"]:
        """One-sided cross spectral densities of a window, tapered (Hann)."""
        count = len(samples)
        taper = np.hanning(count + 1)[:count, None]
        whole = np.fft.rfft((samples - samples.mean(axis=0)) * taper, axis=0)
        some = whole[self.bins[0] : self.bins[-1]]
        some = some * np.sqrt(2 / (rate_hz * float((taper**2).sum())))
        return self.mean(np.einsum("fi,fj->fij", some, some.conj()))


def shares(
    response: Complex[np.ndarray, "bin channel force"], groups: Groups
) -> Complex[np.ndarray, "force group channel channel"]:
    """One-sided densities that each latent force of level 1 gives the channels."""
    forces = response.shape[-1]
    return np.stack(
        [
            groups.mean(2 * np.einsum("fi,fj->fij", h, h.conj()))
            for h in (response[..., k] for k in range(forces))
        ]
    )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Fitted variances.

    Parameters
    ----------
    forces
        Variance of each latent force.
    noise
        Variance of each channel's noise.
    misfit
        Mean of the squared residual of the spectra over what the model gives [1]: 1 where the
        model can explain them.
    """

    forces: Float[np.ndarray, " force"]
    noise: Float[np.ndarray, " channel"]
    misfit: float


def fit_levels(
    spectra: Complex[np.ndarray, "group channel channel"],
    given: Complex[np.ndarray, "force group channel channel"],
    sizes: Float[np.ndarray, " group"],
    noise_sd: Float[np.ndarray, " channel"],
    rate_hz: float,
    *,
    iterations: int,
    start: Levels | None = None,
) -> Levels:
    """Fit levels of forces, and of noises that nobody knows.

    Parameters
    ----------
    noise_sd
        Of each channel; NaN to fit it.
    start
        Levels of the window before.
    """
    channels = spectra.shape[-1]
    per_noise = np.zeros((channels, 1, channels, channels), complex)
    per_noise[np.arange(channels), 0, np.arange(channels), np.arange(channels)] = 2 / rate_hz
    power = np.einsum("fii->fi", spectra).real
    parts = np.concatenate([given, np.broadcast_to(per_noise, (channels, *given.shape[1:]))])
    if start is None:
        own = np.einsum("lfii->lfi", given).real
        forces = float(power.mean()) / np.maximum(own.mean(axis=(1, 2)), 1e-300) / len(given)
        quiet = np.quantile(power, 0.1, axis=0) * rate_hz / 2
        levels = np.concatenate([forces, np.maximum(quiet, 1e-300)])
    else:
        levels = np.concatenate([start.forces, start.noise])
    known = np.concatenate([np.zeros(len(given), bool), np.isfinite(noise_sd)])
    levels[known] = noise_sd[np.isfinite(noise_sd)] ** 2
    variance = float((sizes @ power).max() / sizes.sum()) * rate_hz / 2
    floors = np.full(len(levels), max(QUIETEST * variance, SILENT))
    floors[: len(given)] = 0.0
    levels = np.maximum(levels, floors)
    flat = parts.reshape(len(parts), -1)
    weights = sizes[:, None, None]
    for _ in range(iterations):
        density = (levels @ flat).reshape(spectra.shape)
        inverse = np.linalg.inv(density)
        up = (weights * (inverse @ spectra @ inverse)).transpose(0, 2, 1).reshape(-1)
        down = (weights * inverse).transpose(0, 2, 1).reshape(-1)
        step = np.sqrt(np.maximum((flat @ up).real, 0) / np.maximum((flat @ down).real, 1e-300))
        levels = np.where(known, levels, levels * step)
        forces = levels[: len(given)]
        levels[: len(given)] = np.maximum(forces, FLOOR * forces.max())
        levels = np.maximum(levels, floors)
    density = (levels @ flat).reshape(spectra.shape)
    ratio = np.einsum("fij,fji->f", np.linalg.inv(density), spectra).real
    misfit = float((sizes * ratio).sum() / (sizes.sum() * channels))
    return Levels(levels[: len(given)], levels[len(given) :], misfit)

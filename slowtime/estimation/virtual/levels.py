r"""How large latent forces and noises are, from the spectra of the channels.

With :math:`V_f = \sum_k a_k H_{kf} \Sigma H_{kf}^H + R` the spectral density that the model
gives the channels, where :math:`\Sigma` is the covariance of the latent forces and :math:`a_k`
the shares of the slow and of the fast ones, and :math:`\hat S_f` what a window shows, the
Whittle likelihood :math:`-\sum_f n_f [\ln\det V_f + \operatorname{tr} V_f^{-1} \hat S_f]`
does not fall with the step

.. math:: \Sigma \leftarrow A^{-1/2} (A^{1/2} \Sigma B \Sigma A^{1/2})^{1/2} A^{-1/2}, \quad
          A = \sum_{kf} n_f a_k H^H V_f^{-1} H, \quad
          B = \sum_{kf} n_f a_k H^H V_f^{-1} \hat S_f V_f^{-1} H

(real parts), which keeps the covariance positive; shares and variances of noise take the same
step, as scalars.

References
----------
.. [1] H. Zhou, L. Hu, J. Zhou, K. Lange, "MM algorithms for variance components models",
   J. Comput. Graph. Stat. 28 (2019) 350-361, sections 3 and 5.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

RELATIVE_WIDTH = 0.01
"""Frequencies that are averaged, relative to their middle [1]: half the width of a resonance of
1 % damping."""
HIGHEST = 0.4
"""Upper edge of the frequencies that are fitted, as a share of the sampling rate [1]."""
ABOVE_MODES = 1.5
"""Upper edge of the frequencies that are fitted, over the highest mode that is kept [1]: what
is above says nothing of displacements, and would outweigh what does."""
FLOOR = 1e-12
"""Of a share, relative to the larger one [1]."""
UNSEEN = 1e-9
"""Information on a combination of forces that counts as none, relative to one force [1]."""
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
    def of(
        cls, count: int, rate_hz: float, lowest_hz: float, highest_mode_hz: float
    ) -> "Groups":
        """Group the frequencies of a window of `count` samples.

        Parameters
        ----------
        count
            Number of samples.
        rate_hz
            Sampling rate [Hz].
        lowest_hz
            Lower edge of the first group [Hz].
        highest_mode_hz
            Natural frequency of the highest mode that is kept [Hz].

        Returns
        -------
        The groups.
        """
        spacing = rate_hz / count
        first = max(2, int(np.ceil(lowest_hz / spacing)))
        last = int(min(HIGHEST * rate_hz, ABOVE_MODES * highest_mode_hz) / spacing)
        edges = [first]
        while edges[-1] < last:
            edges.append(max(edges[-1] + 1, int(edges[-1] * (1 + RELATIVE_WIDTH))))
        return cls(np.array(edges), spacing * np.arange(first, edges[-1]))

    @property
    def sizes(self) -> Float[np.ndarray, " group"]:
        """Bins of each group."""
        return np.diff(self.bins).astype(float)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Average values of the bins over each group.

        Parameters
        ----------
        values
            Values, first axis by bin.

        Returns
        -------
        Means, first axis by group.
        """
        sums = np.add.reduceat(values, self.bins[:-1] - self.bins[0], axis=0)
        return np.asarray(sums / self.sizes.reshape(-1, *[1] * (values.ndim - 1)))

    def spectra(
        self, samples: Float[np.ndarray, "time channel"], rate_hz: float
    ) -> Complex[np.ndarray, "group channel channel"]:
        """One-sided cross spectral densities of a window, tapered (Hann).

        Parameters
        ----------
        samples
            Samples of all channels.
        rate_hz
            Sampling rate [Hz].

        Returns
        -------
        Densities averaged over each group [unit of the samples, squared, per Hz].
        """
        count = len(samples)
        taper = np.hanning(count + 1)[:count, None]
        whole = np.fft.rfft((samples - samples.mean(axis=0)) * taper, axis=0)
        some = whole[self.bins[0] : self.bins[-1]]
        some = some * np.sqrt(2 / (rate_hz * float((taper**2).sum())))
        return self.mean(np.einsum("fi,fj->fij", some, some.conj()))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Fitted covariances.

    Parameters
    ----------
    shape
        Covariance of the latent forces, up to `share`.
    share
        What the slow ones and the fast ones are multiplied by: one spectrum for all modes,
        since each mode tells of it where it resonates.
    noise
        Variance of each channel's noise.
    misfit
        Mean of the squared residual of the spectra over what the model gives [1]: 1 where the
        model can explain them.
    """

    shape: Float[np.ndarray, "force force"]
    share: Float[np.ndarray, " 2"]
    noise: Float[np.ndarray, " channel"]
    misfit: float

    @property
    def forces(self) -> Float[np.ndarray, "2 force force"]:
        """Covariance of the slow latent forces, and of the fast ones."""
        return np.asarray(self.share[:, None, None] * self.shape)


def responses(
    response: Complex[np.ndarray, "bin channel both"], groups: Groups
) -> Complex[np.ndarray, "2 group channel force"]:
    r"""Response to the slow and to the fast latent forces, averaged over each group.

    Parameters
    ----------
    response
        Response of the channels to each latent force, slow and fast in turn.
    groups
        Groups of frequencies.

    Returns
    -------
    Responses, times :math:`\sqrt 2` because densities are one-sided.
    """
    middle = groups.mean(response) * np.sqrt(2)  # densities are one-sided
    return np.stack([middle[..., 0::2], middle[..., 1::2]])


def fit_levels(
    spectra: Complex[np.ndarray, "group channel channel"],
    given: Complex[np.ndarray, "2 group channel force"],
    sizes: Float[np.ndarray, " group"],
    noise_sd: Float[np.ndarray, " channel"],
    rate_hz: float,
    *,
    iterations: int,
    start: Levels | None = None,
) -> Levels:
    """Fit covariances of forces, and variances of unknown noises.

    Parameters
    ----------
    spectra
        One-sided cross spectral densities of the channels, by group.
    given
        As of `responses`.
    sizes
        Number of bins of each group.
    noise_sd
        Of each channel; NaN to fit it.
    iterations
        Number of steps.
    start
        Levels of the window before.
    """
    channels, count = spectra.shape[-1], given.shape[-1]
    power = np.einsum("fii->fi", spectra).real
    variance = float((sizes @ power).max() / sizes.sum()) * rate_hz / 2
    least = max(QUIETEST * variance, SILENT)
    if start is None:
        own = (np.abs(given[1]) ** 2).mean(axis=(0, 1))
        shape = np.diag(float(power.mean()) / np.maximum(own, 1e-300) / count)
        share = np.array([1.0, 1.0])
        noise = np.quantile(power, 0.1, axis=0) * rate_hz / 2
    else:
        shape, share, noise = start.shape, start.share, start.noise
    known = np.isfinite(noise_sd)
    noise = np.maximum(np.where(known, np.nan_to_num(noise_sd) ** 2, noise), least)
    adjoint = given.conj().transpose(0, 1, 3, 2)
    weights = sizes[:, None, None]
    for turn in range(iterations + 1):
        each = given @ shape @ adjoint
        density = np.tensordot(share, each, 1)
        density = density + np.diag(noise * 2 / rate_hz)
        inverse = np.linalg.inv(density)
        seen = inverse @ spectra
        if turn == iterations:
            break
        up = weights * (seen @ inverse)
        down = weights * inverse
        # First the two shares of the shape, then, with new spectra, the shape itself.
        if turn % 2:
            more, less = (np.einsum("fij,kfji->k", w, each).real for w in (up, down))
            share = share * np.sqrt(np.maximum(more, 0.0) / np.maximum(less, 1e-300))
            share = np.maximum(share, FLOOR * share.max())
        else:
            more, less = (
                np.tensordot(share, (adjoint @ w @ given).sum(axis=1).real, 1)
                for w in (up, down)
            )
            shape = _step(shape, more, less)
        ratio = np.einsum("fii->i", up).real / np.einsum("fii->i", down).real
        fitted = noise * np.sqrt(np.maximum(ratio, 0.0))
        noise = np.maximum(np.where(known, noise, fitted), least)
    misfit = float(sizes @ np.einsum("fii->f", seen).real / (sizes.sum() * channels))
    return Levels(shape, share, noise, misfit)


def _step(
    old: Float[np.ndarray, "force force"],
    up: Float[np.ndarray, "force force"],
    down: Float[np.ndarray, "force force"],
) -> Float[np.ndarray, "force force"]:
    """Take one step of the covariance; forces that nothing shows are as large as the others."""
    shown = np.diag(down) > UNSEEN * np.diag(down).max()
    if not shown.all() and shown.any():
        some = np.ix_(shown, shown)
        part = _step(old[some], up[some], down[some])
        new = np.diag(np.where(shown, 0.0, np.diag(part).mean()))
        new[some] = part
        return new
    # In units in which all forces are seen alike, so that small ones are not lost.
    scale = np.sqrt(np.maximum(np.diag(down), 1e-300))
    both = np.outer(scale, scale)
    up, old = up / both, old * both
    root = _root(down / both + UNSEEN * np.eye(len(down)))
    back = np.linalg.inv(root)
    new = back @ _root(root @ old @ up @ old @ root) @ back
    return np.asarray((new + new.T) / 2 / both)


def _root(matrix: Float[np.ndarray, "force force"]) -> Float[np.ndarray, "force force"]:
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)

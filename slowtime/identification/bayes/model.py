r"""Spectral matrix that modes and noise predict for the Fourier coefficients of a band.

In a band that m modes rule, the coefficients of the n channels are

.. math:: F_k \sim \mathcal{CN}(0, E_k), \qquad
          E_k = \Psi \, (G \circ D_k) \, \Psi^T + \mathrm{diag}(\nu \, (f_k / f_0)^q),

with real shapes :math:`\Psi` (n × m) scaled by the strength of their modes, the coherence
:math:`G = L L^H` of the modal forces (L lower triangular), and :math:`D_k` the expected
cross-periodograms of unit modes. The noise of each channel has a density of its own, and an
exponent q of its own over the band, of middle :math:`f_0`.

Modes outside the band come first and are guests: their poles, shapes and mutual coherence are
known from their own bands, but not their coherence with the modes of the band. One force
that drives all modes makes their tails interfere with the resonance, which shifts its peak.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from .band import Band
from .resonances import cross_periodograms, crossed

MOVE = 1e-4
"""Steps of the central differences in ln f (times the damping ratio) and in ln zeta."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandModes:
    """Modes of one band, and before them as many `guests`.

    `log_noise` is at the middle of the band; `noise_exponent` is that of its density.
    `shapes` carry the strength; `mixing` is L but for the length of its rows, which are scaled
    to 1 (a free length would be one with the strength): complex, lower triangular, of real
    diagonal.
    """

    log_frequency: Float[np.ndarray, " mode"]
    log_damping: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "channel mode"]
    mixing: Complex[np.ndarray, "mode mode"]
    log_noise: Float[np.ndarray, " channel"]
    noise_exponent: Float[np.ndarray, " channel"]
    guests: int = 0
    coherent: bool = True

    @property
    def number(self) -> int:
        """Of modes that are not guests."""
        return len(self.log_frequency) - self.guests

    @property
    def unit_mixing(self) -> Complex[np.ndarray, "mode mode"]:
        """L."""
        return np.asarray(self.mixing / np.linalg.norm(self.mixing, axis=1, keepdims=True))

    @property
    def coherence(self) -> Complex[np.ndarray, "mode mode"]:
        """G, Hermitian, of unit diagonal."""
        return np.asarray(self.unit_mixing @ self.unit_mixing.conj().T)

    @property
    def free_mixing(self) -> list[tuple[int, int, complex]]:
        """Row, column and unit of the parts of L that are looked for, if any are."""
        if not self.coherent:
            return []
        below = [
            (row, column)
            for row in range(max(self.guests, 1), len(self.log_frequency))
            for column in range(row + 1)
        ]
        real = [(row, column, 1.0 + 0j) for row, column in below]
        return real + [(row, column, 1j) for row, column in below if row > column]


def parameter_vector(modes: BandModes) -> Float[np.ndarray, " parameter"]:
    """Parameters: ln f, ln zeta, parts of L, shapes by mode, ln noise, its exponents."""
    own = slice(modes.guests, None)
    parts = [modes.mixing[row, column] / unit for row, column, unit in modes.free_mixing]
    return np.concatenate(
        [
            modes.log_frequency[own],
            modes.log_damping[own],
            np.real(parts),
            modes.shapes[:, own].T.ravel(),
            modes.log_noise,
            modes.noise_exponent,
        ]
    )


def modes_from_vector(vector: Float[np.ndarray, " parameter"], like: BandModes) -> BandModes:
    """Inverse of `parameter_vector`; what is not in the vector stays as in `like`."""
    number, channels = like.number, len(like.log_noise)
    free = like.free_mixing
    sizes = [number, number, len(free), number * channels, channels]
    f, z, parts, shapes, noise, exponent = np.split(vector, np.cumsum(sizes))
    frequency, damping = like.log_frequency.copy(), like.log_damping.copy()
    frequency[like.guests :], damping[like.guests :] = f, z
    mixing, all_shapes = like.mixing.copy(), like.shapes.copy()
    mixing[sorted({row for row, _, _ in free})] = 0.0
    for (row, column, unit), part in zip(free, parts, strict=True):
        mixing[row, column] += unit * part
    all_shapes[:, like.guests :] = shapes.reshape(number, channels).T
    return dataclasses.replace(
        like,
        log_frequency=frequency,
        log_damping=damping,
        shapes=all_shapes,
        mixing=mixing,
        log_noise=noise,
        noise_exponent=exponent,
    )


def add_guests(start: BandModes, found: BandModes) -> BandModes:
    """Add outside modes to the initial values, from a fit without them.

    Guests have independent forces.
    """
    before = start.guests
    return dataclasses.replace(
        start,
        log_frequency=np.concatenate([start.log_frequency[:before], found.log_frequency]),
        log_damping=np.concatenate([start.log_damping[:before], found.log_damping]),
        shapes=np.concatenate([start.shapes[:, :before], found.shapes], axis=1),
        mixing=np.eye(len(start.mixing), dtype=complex),
        log_noise=found.log_noise,
        noise_exponent=found.noise_exponent,
    )


def noise_density(
    band: Band, modes: BandModes
) -> tuple[Float[np.ndarray, "frequency channel"], Float[np.ndarray, " frequency"]]:
    """Density of each channel's noise, and what its logarithm changes by with the exponent.

    Beside it, ln of frequency over the middle of the band.
    """
    away = np.log(band.frequency_hz / band.middle_hz)
    return np.exp(modes.log_noise + away[:, None] * modes.noise_exponent), away


def spectral_slopes(
    band: Band, modes: BandModes
) -> tuple[
    Complex[np.ndarray, "frequency mode mode"],
    list[Complex[np.ndarray, "frequency parameter mode"]],
]:
    r"""Spectral matrices :math:`H_k = G \circ D_k`, and their slopes but by the shapes.

    A parameter of mode i moves no more than row i of H, by y, and its column by the conjugate;
    those y are given for each mode of the band: by ln f, ln zeta, then its row of L.
    """
    spectra = cross_periodograms(band, modes.log_frequency, modes.log_damping)
    unit, coherence = modes.unit_mixing, modes.coherence
    length = np.linalg.norm(modes.mixing, axis=1)
    by_poles = _pole_slopes(band, modes)
    slopes = []
    for i in range(modes.guests, len(length)):
        rows = []
        for row, column, step in modes.free_mixing:
            if row == i:
                change = -unit[i] * (unit[i, column].conj() * step).real
                change[column] += step
                rows.append(change @ unit.conj().T / length[i])
        own = [by_poles[:, :, i - modes.guests] * coherence[i]]
        if rows:
            own.append(np.stack(rows) * spectra[:, i, None, :])
        slopes.append(np.concatenate(own, axis=1))
    return spectra * coherence, slopes


def slope_order(modes: BandModes) -> np.ndarray:
    """Give the indices in the parameter vector of the derivatives of `spectral_slopes`."""
    free = modes.free_mixing
    return np.array(
        [
            place
            for i in range(modes.number)
            for place in (
                [i, modes.number + i]
                + [2 * modes.number + k for k, f in enumerate(free) if f[0] == modes.guests + i]
            )
        ]
    )


def _pole_slopes(band: Band, modes: BandModes) -> Complex[np.ndarray, "frequency 2 own mode"]:
    """Central differences of rows of `cross_periodograms`, the other modes held, by poles."""
    poles = np.stack([modes.log_frequency, modes.log_damping])
    own = poles[:, modes.guests :]
    move = MOVE * np.stack([np.exp(own[1]), np.ones(modes.number)])
    slopes = []
    for which in (0, 1):
        change = np.zeros_like(own)
        change[which] = move[which]
        difference = crossed(band, own + change, poles) - crossed(band, own - change, poles)
        slopes.append(difference / (2 * move[which][:, None]))
    return np.stack(slopes, axis=1)

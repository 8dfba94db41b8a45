r"""Modes and noise in, the spectral matrix that Fourier coefficients scatter about, out.

In a band that m modes rule, the coefficients of the n channels are

.. math:: F_k \sim \mathcal{CN}(0, E_k), \qquad
          E_k = \Psi \, (G \circ D_k) \, \Psi^T + \mathrm{diag}(\nu),

with real shapes :math:`\Psi` (n × m) scaled by the strength of their modes, the coherence
:math:`G = L L^H` of the modal forces (L lower triangular), and :math:`D_k` the expected
cross-periodograms of unit modes.

Modes outside the band come first and are guests: their poles, shapes and mutual coherence are
known from their own bands, but not their coherence with the modes of the band. One force
that drives all modes makes their tails interfere with the resonance, which shifts its peak.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

GROUPED = 12.0
"""Bins are taken together over this part of the way to the nearest mode."""

MOVE = 1e-4
"""Central differences in ln f (times the damping) and ln zeta."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Band:
    """What a band of a record of `duration_s` seconds holds, neighbouring bins taken together.

    Of `number` bins about each frequency `scatter` is the sum of :math:`F F^H`. `derivatives`
    is 2 for accelerations, 1 velocities, 0 displacements. The `background` is a known part of
    the spectral matrix: the tails of modes outside.
    """

    frequency_hz: Float[np.ndarray, " frequency"]
    scatter: Complex[np.ndarray, "frequency channel channel"]
    number: Float[np.ndarray, " frequency"]
    duration_s: float
    derivatives: int = 2
    background: Complex[np.ndarray, "frequency channel channel"] | None = None


def band_from(
    frequency_hz: Float[np.ndarray, " bin"],
    coefficients: Complex[np.ndarray, "bin channel"],
    duration_s: float,
    derivatives: int,
    centres_hz: Float[np.ndarray, " mode"],
) -> Band:
    """Take bins together over a part of the way to the nearest mode, as `whittle.grouped`.

    A resonance falls off like the square of that distance, so that nothing is lost.
    """
    away = np.abs(frequency_hz[:, None] - centres_hz).min(axis=1) * duration_s
    group = np.floor(np.cumsum(1.0 / np.maximum(1.0, away / GROUPED)) + 1e-9).astype(int)
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    number = np.diff(starts, append=len(away)).astype(float)
    each = coefficients[:, :, None] * coefficients[:, None, :].conj()
    return Band(
        frequency_hz=np.add.reduceat(frequency_hz, starts) / number,
        scatter=np.add.reduceat(each, starts),
        number=number,
        duration_s=duration_s,
        derivatives=derivatives,
    )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """Modes of one band, and before them as many `guests`.

    `shapes` carry the strength; `mixing` is L but for the length of its rows, which are scaled
    to 1 (a free length would be one with the strength): complex, lower triangular, of real
    diagonal.
    """

    log_frequency: Float[np.ndarray, " mode"]
    log_damping: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "channel mode"]
    mixing: Complex[np.ndarray, "mode mode"]
    log_noise: Float[np.ndarray, " channel"]
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


def vector_of(modes: Modes) -> Float[np.ndarray, " parameter"]:
    """Stack what is looked for: ln f, ln zeta, parts of L, shapes by mode, ln noise."""
    own = slice(modes.guests, None)
    parts = [modes.mixing[row, column] / unit for row, column, unit in modes.free_mixing]
    return np.concatenate(
        [
            modes.log_frequency[own],
            modes.log_damping[own],
            np.real(parts),
            modes.shapes[:, own].T.ravel(),
            modes.log_noise,
        ]
    )


def modes_of(vector: Float[np.ndarray, " parameter"], like: Modes) -> Modes:
    """Inverse of `vector_of`; what is not in the vector stays as in `like`."""
    number, channels = like.number, len(like.log_noise)
    free = like.free_mixing
    sizes = [number, number, len(free), number * channels]
    f, z, parts, shapes, noise = np.split(vector, np.cumsum(sizes))
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
    )


def knowing(start: Modes, found: Modes) -> Modes:
    """Start with guests, its forces without anything in common, at a fit without them."""
    before = start.guests
    return dataclasses.replace(
        start,
        log_frequency=np.concatenate([start.log_frequency[:before], found.log_frequency]),
        log_damping=np.concatenate([start.log_damping[:before], found.log_damping]),
        shapes=np.concatenate([start.shapes[:, :before], found.shapes], axis=1),
        mixing=np.eye(len(start.mixing), dtype=complex),
        log_noise=found.log_noise,
    )


def cross_periodograms(
    band: Band,
    log_frequency: Float[np.ndarray, " mode"],
    log_damping: Float[np.ndarray, " mode"],
) -> Complex[np.ndarray, "frequency mode mode"]:
    """Predict the cross-periodograms :math:`D_k` of modes among themselves; see `crossed`."""
    poles = np.stack([log_frequency, log_damping])
    return crossed(band, poles, poles)


def crossed(
    band: Band, some: Float[np.ndarray, "2 mode"], others: Float[np.ndarray, "2 other"]
) -> Complex[np.ndarray, "frequency mode other"]:
    r"""Predict the cross-periodograms of modes of unit peak under one white force.

    Of modes by ln f and ln zeta with the transfer functions :math:`h_i(s) = 2 \zeta_i \,
    (s / \omega_i)^d \, \omega_i^2 / (s^2 + 2 \zeta_i \omega_i s + \omega_i^2)` the spectra are
    :math:`h_i(s) h_j(-s)`, :math:`s = i \omega`. A record of length T puts a triangle on the
    correlations, which adds, for the pole :math:`s_i` of the residue :math:`\rho_{ij}` of the
    spectrum,

    .. math:: -\rho_{ij} \frac{1 - e^{(s_i - i \omega) T}}{T (i \omega - s_i)^2}

    and the like for :math:`s_j`: leakage, which else biases the damping of modes that are
    hardly wider than the record resolves (as in `expected_resonance`).
    """
    one, other = _resonances(band, some), _resonances(band, others)
    spectra = one.transfer[:, :, None] * other.transfer[:, None, :].conj()
    leaked = one.leak[:, :, None] * _residue(one, other, band.derivatives)
    mirrored = other.leak[:, :, None] * _residue(other, one, band.derivatives)
    return np.asarray(spectra + leaked + np.swapaxes(mirrored, 1, 2).conj())


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Resonances:
    omega: np.ndarray
    damping: np.ndarray
    pole: np.ndarray
    residue: np.ndarray
    transfer: np.ndarray
    leak: np.ndarray


def _resonances(band: Band, poles: np.ndarray) -> _Resonances:
    omega, damping = 2 * np.pi * np.exp(poles[0]), np.exp(poles[1])
    s = 2j * np.pi * band.frequency_hz[:, None]
    damped = omega * np.sqrt(1 - damping**2)
    pole = -damping * omega + 1j * damped
    # At every bin exp(-s T) is 1.
    leak = -(1 - np.exp(pole * band.duration_s)) / (band.duration_s * (s - pole) ** 2)
    return _Resonances(
        omega,
        damping,
        pole,
        2 * damping * (pole / omega) ** band.derivatives * omega**2 / (2j * damped),
        _transfer(s, omega, damping, band.derivatives),
        leak,
    )


def _residue(one: _Resonances, other: _Resonances, derivatives: int) -> np.ndarray:
    """Of the cross-spectra (rows one, columns other) at the poles of the one."""
    mirrored = _transfer(-one.pole[:, None], other.omega, other.damping, derivatives)
    return np.asarray(one.residue[:, None] * mirrored)


def _transfer(
    s: np.ndarray, omega: np.ndarray, damping: np.ndarray, derivatives: int
) -> np.ndarray:
    """Of each mode (columns) at each s (rows), about 1 at its peak."""
    numerator = 2 * damping * (s / omega) ** derivatives * omega**2
    return np.asarray(numerator / (s**2 + 2 * damping * omega * s + omega**2))


def spectral_slopes(
    band: Band, modes: Modes
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


def slope_order(modes: Modes) -> np.ndarray:
    """Places in the vector of what `spectral_slopes` gives, one mode after the other."""
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


def _pole_slopes(band: Band, modes: Modes) -> Complex[np.ndarray, "frequency 2 own mode"]:
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

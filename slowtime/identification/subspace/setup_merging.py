r"""Merging of several set-ups before identification (PreGER).

Each set-up s has the correlations of its reference sensors and of its moved sensors with the
references. Block Hankel matrices of those of the references, side by side, have one
observability matrix,

.. math:: (H_{ref}^{(1)} \; H_{ref}^{(2)} \dots) = \Gamma_{ref} \, (Z_1 \; Z_2 \dots) ,

in which :math:`Z_s` carries how strongly the structure was excited. The moved sensors of each
set-up are put on the same scale by :math:`C_{mov}^{(s)} = H_{mov}^{(s)} Z_s^+`, so that one
model has the poles of all set-ups and the whole of each shape. It serves where the excitation
differs from set-up to set-up but the structure does not; where frequencies differ, merging
after identification (`slowtime.identification.mode_shapes.merging`, PoSER) is right.

References
----------
.. [1] M. Döhler, E. Reynders, F. Magalhães, L. Mevel, G. De Roeck, A. Cunha, "Pre- and
   post-identification merging for multi-setup OMA with covariance-driven SSI", IMAC 28 (2010).
.. [2] L. Mevel, M. Basseville, A. Benveniste, M. Goursat, "Merging sensor data from multiple
   measurement set-ups for non-stationary subspace-based modal analysis", J. Sound and
   Vibration 249 (2002).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.scaling import normalise_with_errors
from slowtime.identification.modes import Mode

from .correlations import Correlations, block_hankel, correlation_matrices
from .poles import Poles
from .stabilisation import StablePole, find_stable_poles

MOST_SD = 1.0
"""[half-bandwidths] Largest standard deviation of the frequency and of the half-bandwidth."""

DRAWS = 16
"""Draws of the errors of the correlations of a set-up; each is solved anew."""

ENDLESS_S = 1e9
"""[s] Duration stated for these poles, whose draws count in full."""

NEAREST = 0.5
"""[half-bandwidths] How far a pole may move under one draw to be taken for the same."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetUpRecord:
    """Samples of one set-up."""

    samples: Float[np.ndarray, "time channel"]
    channels: tuple[str, ...]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreMerged:
    """Modes of all set-ups together, over all channels, and their stabilisation poles."""

    modes: tuple[Mode, ...]
    channels: tuple[str, ...]
    poles: Poles


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    references: tuple[str, ...]
    channels: tuple[str, ...]
    of_setup: tuple[np.ndarray, ...]


def merge_before(
    setups: Sequence[SetUpRecord],
    rate_hz: float,
    references: Sequence[str],
    *,
    block_rows: int,
    orders: Sequence[int],
    band_hz: tuple[float, float],
) -> PreMerged:
    """Identify the modes of a structure from all set-ups at once.

    Raises `ValueError` where a set-up lacks a reference, or there are too few channels.
    """
    layout = _layout(setups, references)
    correlations = _correlations(setups, layout, rate_hz, 2 * block_rows)
    means = [each.mean for each in correlations]
    solved = _solve(means, layout, block_rows, orders, rate_hz)
    changes = []
    for which, each in enumerate(correlations):
        for draw in each.draws[:DRAWS]:
            moved = [*means]
            moved[which] = each.mean + draw / np.sqrt(min(DRAWS, len(each.draws)))
            changes.append(_solve(moved, layout, block_rows, orders, rate_hz))
    poles = _poles(orders, solved, changes)
    stable = find_stable_poles(poles, low_hz=band_hz[0], high_hz=band_hz[1])
    modes = tuple(_mode(one, poles) for one in stable if _is_sharp(one))
    return PreMerged(modes=modes, channels=layout.channels, poles=poles)


def _layout(setups: Sequence[SetUpRecord], references: Sequence[str]) -> _Layout:
    names = [name for setup in setups for name in setup.channels]
    for number, setup in enumerate(setups):
        missing = [name for name in references if name not in setup.channels]
        if missing or not references:
            raise ValueError(
                f"Set-up {number + 1} has the channels {setup.channels} and lacks the "
                f"references {missing or tuple(references)}. Give at least one channel that "
                "all of them have."
            )
    channels = tuple(dict.fromkeys([*references, *names]))
    return _Layout(
        tuple(references),
        channels,
        tuple(np.array([channels.index(name) for name in s.channels]) for s in setups),
    )


def _correlations(
    setups: Sequence[SetUpRecord], layout: _Layout, rate_hz: float, lags: int
) -> list[Correlations]:
    found = []
    for setup in setups:
        at = [setup.channels.index(name) for name in layout.references]
        samples = setup.samples - setup.samples.mean(axis=0)
        found.append(
            correlation_matrices(
                samples, samples[:, at], lags=lags, rate_hz=rate_hz, draws=DRAWS
            )
        )
    return found


_Solved = tuple[Complex[np.ndarray, " _"], Complex[np.ndarray, "channel _"]]
"""Poles of one order, and their shapes; orders differ in how many they have."""


def _solve(
    means: Sequence[np.ndarray],
    layout: _Layout,
    rows: int,
    orders: Sequence[int],
    rate_hz: float,
) -> list[_Solved]:
    """Poles of positive frequency and whole shapes by models of all orders."""
    count = len(layout.references)
    hankels = []
    for mean, places in zip(means, layout.of_setup, strict=True):
        at = [int(np.flatnonzero(places == k)[0]) for k in range(count)]
        # Set-ups count by their length, not by how strongly the structure was excited.
        level = np.sqrt(np.trace(mean[0][at].real))
        own, whole = block_hankel(mean[1:, at], rows, rows), block_hankel(mean[1:], 1, rows)
        hankels.append((own / level, whole / level))
    joined = np.concatenate([own for own, _ in hankels], axis=1)
    u, s, _ = scipy.linalg.svd(joined, full_matrices=False)
    found = []
    for n in orders:
        gamma = u[:, :n] * np.sqrt(s[:n])
        eigenvalue, right = np.linalg.eig(np.linalg.pinv(gamma[:-count]) @ gamma[count:])
        keep = np.flatnonzero((eigenvalue.imag > 0) & (np.abs(eigenvalue) > 1e-3))
        onto = u[:, :n].T / np.sqrt(s[:n])[:, None]
        shape = np.zeros((len(layout.channels), len(keep)), dtype=complex)
        seen = np.zeros(len(layout.channels))
        for (own, whole), places in zip(hankels, layout.of_setup, strict=True):
            shape[places] += whole @ np.linalg.pinv(onto @ own) @ right[:, keep]
            seen[places] += 1
        shape /= seen[:, None]
        shape /= np.linalg.norm(shape, axis=0)
        found.append((np.log(eigenvalue[keep]) * rate_hz, shape))
    return found


def _poles(
    orders: Sequence[int],
    solved: list[_Solved],
    changes: list[list[_Solved]],
) -> Poles:
    """Poles of all orders, with the deviation that each draw makes."""
    draws: list[np.ndarray] = []
    shape_draws: list[np.ndarray] = []
    for k, (pole, shape) in enumerate(solved):
        moved = np.zeros((len(changes), len(pole)), dtype=complex)
        turned = np.zeros((len(changes), *shape.shape), dtype=complex)
        for row, change in enumerate(changes):
            other, its_shape = change[k]
            if len(other) == 0:
                moved[row] = np.abs(pole.real)
                continue
            away = np.abs(pole[:, None] - other) / np.abs(pole.real)[:, None]
            near = np.argmin(away, axis=1)
            same = away[np.arange(len(pole)), near] < NEAREST
            moved[row] = np.where(same, other[near] - pole, np.abs(pole.real))
            beside = its_shape[:, near]
            factor = np.sum(beside.conj() * shape, axis=0)
            factor = factor / np.maximum(np.sum(np.abs(beside) ** 2, axis=0), 1e-300)
            turned[row] = beside * factor - shape
        draws.append(moved)
        shape_draws.append(turned)
    # Deviations add up over set-ups; the mean over draws is taken from here on.
    size = np.sqrt(len(changes))
    return Poles(
        order=np.concatenate(
            [np.full(len(p), n) for n, (p, _) in zip(orders, solved, strict=True)]
        ),
        pole=np.concatenate([p for p, _ in solved]),
        shape=np.concatenate([shape for _, shape in solved], axis=1),
        draws=size * np.concatenate(draws, axis=1),
        shape_draws=size * np.concatenate(shape_draws, axis=2),
        duration_s=ENDLESS_S,
    )


def _is_sharp(one: StablePole) -> bool:
    """Whether frequency and damping are known to better than the width of the resonance."""
    width = MOST_SD * one.damping_ratio
    return one.frequency_sd_hz < width * one.frequency_hz and one.damping_sd < width


def _mode(one: StablePole, poles: Poles) -> Mode:
    _, _, correlation = poles.standard_deviations()
    sd = poles.shape_sd()[:, one.index]
    shape, shape_sd = normalise_with_errors(one.shape, np.diag(sd**2).astype(complex))
    return Mode(
        frequency_hz=Measured(one.frequency_hz, one.frequency_sd_hz),
        damping_ratio=Measured(one.damping_ratio, one.damping_sd),
        correlation=float(np.clip(correlation[one.index], -1, 1)),
        shape=shape,
        shape_sd=shape_sd,
        quality=min(one.share, 1.0),
    )

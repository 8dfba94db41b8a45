r"""Merging of the modes of several sensor set-ups of one structure.

Sensors that are moved about see a part of a shape each, up to a factor of its own. Reference
sensors, which stay, tie the parts together: with the shape :math:`\psi` and a factor c for each
set-up,

.. math:: \hat\phi_{sj} = c_s \psi_j + \epsilon_{sj} ,

solved for all :math:`\psi_j` and :math:`c_s` by least squares, each component weighted by its
variance. Frequencies and damping ratios are weighted means; where set-ups disagree (for the
structure was warmer, or carried the sensors elsewhere) their errors grow, and a flag says so.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.estimates import Measured
from slowtime.identification.modes import Mode

from .agreement import Agreement, agreement_of, weighted_mean
from .criteria import mac
from .scaling import normalise_with_errors, scale_shapes, shape_covariance

NEAR = 0.03
"""Largest relative difference of the frequencies of one mode in two set-ups [1]."""

ALIKE = 0.8
"""Least MAC over two or more reference channels, beyond the errors of the shapes [1]."""

DOUBTS = 3.0
"""Standard deviations of a shape that count as its error."""

LEAST_SD = 1e-4
"""Least standard deviation of a component of a unit shape [1]."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetUp:
    """Modes of one record, and the names of the channels that their shapes have.

    A name is a place and a direction on the structure: the same in two set-ups only if both
    heard the same.
    """

    modes: Sequence[Mode]
    channels: tuple[str, ...]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MergedMode:
    """One mode of the structure.

    Parameters
    ----------
    mode
        Over `channels`. Flags: `frequencies_disagree`, `dampings_disagree`,
        `shapes_disagree` between set-ups, and those of its parts.
    channels
        Those of the set-ups that have the mode, in order of appearance, references first.
    frequency, damping, shape
        Whether they agree.
    """

    mode: Mode
    channels: tuple[str, ...]
    setups: tuple[int, ...]
    frequency: Agreement
    damping: Agreement
    shape: Agreement


Member = tuple[int, Mode]


def merge(
    setups: Sequence[SetUp], references: Sequence[str] | None = None
) -> tuple[MergedMode, ...]:
    """Modes of a structure over all channels of its set-ups.

    Parameters
    ----------
    setups
        Lines of machines among their modes are left out.
    references
        Names of channels that all set-ups have; by default all such.

    Examples
    --------
    >>> def seen(hz, shape):
    ...     raw = np.array(shape) / np.linalg.norm(shape) + 0j
    ...     return Mode(frequency_hz=Measured(hz, 0.01), damping_ratio=Measured(0.01, 0.001),
    ...                 correlation=0.0, shape=raw, shape_sd=np.full(len(raw), 0.01))
    >>> low = SetUp(modes=[seen(2.00, [1.0, 0.5])], channels=("top", "first"))
    >>> high = SetUp(modes=[seen(2.01, [1.0, 0.8])], channels=("top", "second"))
    >>> whole, = merge([low, high])
    >>> whole.channels, whole.mode.shape.real.round(2), whole.frequency.holds
    (('top', 'first', 'second'), array([0.73, 0.36, 0.58]), True)
    """
    ties = _references(setups, references)
    chains = _chains(setups, ties)
    names = [name for setup in setups for name in setup.channels]
    order = tuple(dict.fromkeys([*ties, *names]))
    merged = [_merged(chain, setups, order) for chain in chains]
    return tuple(sorted(merged, key=lambda each: each.mode.frequency_hz.value))


def _references(setups: Sequence[SetUp], references: Sequence[str] | None) -> tuple[str, ...]:
    if not setups:
        raise ValueError("No set-up was given. Give one for each record.")
    for setup in setups:
        wrong = [m for m in setup.modes if len(m.shape) != len(setup.channels)]
        if wrong or len(set(setup.channels)) < len(setup.channels):
            raise ValueError(
                f"A set-up of channels {setup.channels} was given, with shapes of "
                f"{sorted({len(m.shape) for m in setup.modes})} components. Give each channel "
                "a name of its own, and one for each component."
            )
    common = [c for c in setups[0].channels if all(c in s.channels for s in setups)]
    chosen = common if references is None else list(references)
    if not chosen or any(name not in common for name in chosen):
        raise ValueError(
            f"References {tuple(chosen)} were given; all set-ups have {tuple(common)}. Give at "
            "least one channel that all of them have, under the same name."
        )
    return tuple(chosen)


def _chains(setups: Sequence[SetUp], ties: tuple[str, ...]) -> list[list[Member]]:
    """Which mode of each set-up is which of the others: best pairs, set-up by set-up."""
    chains: list[list[Member]] = []
    for number, setup in enumerate(setups):
        modes = [mode for mode in setup.modes if mode.kind == "structural"]
        costs = np.array(
            [
                [_apart(chain, (number, mode), setups, ties) for mode in modes]
                for chain in chains
            ]
        ).reshape(len(chains), len(modes))
        from scipy.optimize import linear_sum_assignment

        rows, columns = linear_sum_assignment(np.minimum(costs, 1e3))
        paired = {
            int(c): int(r) for r, c in zip(rows, columns, strict=True) if costs[r, c] < 1e3
        }
        for column, mode in enumerate(modes):
            if column in paired:
                chains[paired[column]].append((number, mode))
            else:
                chains.append([(number, mode)])
    return chains


def _apart(
    chain: list[Member], member: Member, setups: Sequence[SetUp], ties: tuple[str, ...]
) -> float:
    """Distance of a mode from the nearest of a chain; infinite if it cannot be the same."""
    return min(_distance(one, member, setups, ties) for one in chain)


def _distance(
    one: Member, other: Member, setups: Sequence[SetUp], ties: tuple[str, ...]
) -> float:
    away = abs(np.log(one[1].frequency_hz.value / other[1].frequency_hz.value)) / NEAR
    if away > 1:
        return np.inf
    shapes, unsure = [], 0.0
    for number, mode in (one, other):
        at = [setups[number].channels.index(name) for name in ties]
        part = mode.shape[at]
        size = np.linalg.norm(part)
        if size == 0:
            return np.inf
        shapes.append(part)
        unsure += float(np.sum(mode.shape_sd[at] ** 2) / size**2)
    unlike = 1 - mac(*shapes)
    if unlike > (1 - ALIKE) + DOUBTS**2 * unsure:
        return np.inf
    return float(away + unlike)


def _merged(chain: list[Member], setups: Sequence[SetUp], order: tuple[str, ...]) -> MergedMode:
    modes = [mode for _, mode in chain]
    frequency, of_f, share_f = weighted_mean([mode.frequency_hz for mode in modes])
    damping, of_z, correlation = _damping(modes, frequency, share_f)
    heard = {name for number, _ in chain for name in setups[number].channels}
    channels = tuple(name for name in order if name in heard)
    shape, sd, of_shape = _shape(chain, setups, channels)
    agreements = {"frequencies": of_f, "dampings": of_z, "shapes": of_shape}
    flags = [flag for mode in modes for flag in mode.flags]
    flags += [f"{what}_disagree" for what, each in agreements.items() if not each.holds]
    return MergedMode(
        mode=Mode(
            frequency_hz=frequency,
            damping_ratio=damping,
            correlation=correlation,
            shape=shape,
            shape_sd=sd,
            quality=float(np.mean([mode.quality for mode in modes])),
            flags=tuple(dict.fromkeys(flags)),
        ),
        channels=channels,
        setups=tuple(number for number, _ in chain),
        frequency=of_f,
        damping=of_z,
        shape=of_shape,
    )


def _damping(
    modes: list[Mode], frequency: Measured, share_f: np.ndarray
) -> tuple[Measured, Agreement, float]:
    """Mean of the damping ratios that are known, and its correlation with the frequency."""
    known = [k for k, mode in enumerate(modes) if np.isfinite(mode.damping_ratio.sd)]
    if not known:
        return Measured(np.nan, np.nan), agreement_of(0.0, 0), float("nan")
    damping, agreement, share = weighted_mean([modes[k].damping_ratio for k in known])
    common = sum(
        weight
        * share_f[k]
        * modes[k].correlation
        * modes[k].frequency_hz.sd
        * modes[k].damping_ratio.sd
        for k, weight in zip(known, share, strict=True)
    )
    return damping, agreement, float(np.clip(common / (frequency.sd * damping.sd), -1, 1))


def _shape(
    chain: list[Member], setups: Sequence[SetUp], channels: tuple[str, ...]
) -> tuple[Complex[np.ndarray, " channel"], Float[np.ndarray, " channel"], Agreement]:
    """Least squares for the shape and the factors, in turn; then its errors."""
    seen = np.zeros((len(chain), len(channels)), dtype=complex)
    weight = np.zeros((len(chain), len(channels)))
    for row, (number, mode) in enumerate(chain):
        at = [channels.index(name) for name in setups[number].channels]
        seen[row, at] = mode.shape
        alive = (mode.shape != 0) | (mode.shape_sd > 0)
        weight[row, at] = alive / np.maximum(mode.shape_sd, LEAST_SD) ** 2
    factors, shape = scale_shapes(seen, weight)
    left = float(np.sum(weight * np.abs(seen - np.outer(factors, shape)) ** 2))
    heard = weight.sum(axis=0) > 0
    unknown = int(heard.sum()) + len(chain) - 1
    agreement = agreement_of(2 * left, 2 * (int(np.count_nonzero(weight)) - unknown))
    covariance = shape_covariance(factors, shape, weight, heard)
    if not agreement.holds:
        covariance = covariance * (2 * left / agreement.freedom)
    return (*normalise_with_errors(shape, covariance), agreement)

"""Stable poles over model orders: clustering of a stabilisation diagram.

A pole is followed from the highest order downwards for as long as the next order holds one that
its own standard deviations allow for; nothing is tuned to a structure, and no tolerance is in
percent. What stays is a candidate: the spectra have the last word on whether it is a mode.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float, Int

from slowtime.identification.mode_shapes.criteria import mac_matrix

from .poles import MOST_DAMPING as MOST_DAMPING
from .poles import PoleLimits, Poles

MOST_SD = 3.0
"""Largest standard deviation of a frequency [half-bandwidths]."""

REACH = 2.0
"""Largest distance of poles of neighbouring orders [standard deviations]."""

ALIKE = 0.8
"""Least MAC of poles of neighbouring orders [1]."""

GAP = 3
"""Largest number of orders at which a pole may be missing."""

SHORTEST = 7
"""Least number of orders of a stable pole."""

DENSEST = 0.6
"""Least share of the orders between the lowest and highest at which the pole is found [1]."""

HALF_ROUNDING = 1e-6
"""Least relative standard deviation in the comparison [1], for noiseless records."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class StablePole:
    """One pole that stayed, with how many orders showed it.

    Parameters
    ----------
    pole
        s [rad/s].
    orders
        How many showed it.
    share
        Of the orders from its lowest to the highest of all [1].
    members, index
        Indices of the poles, and of the one that stands for them.
    """

    pole: complex
    shape: Complex[np.ndarray, " channel"]
    frequency_sd_hz: float
    damping_sd: float
    orders: int
    share: float
    members: Int[np.ndarray, " member"]
    index: int

    @property
    def frequency_hz(self) -> float:
        """Undamped natural frequency [Hz]."""
        return abs(self.pole) / (2 * np.pi)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio [1]; it may be negative where a line has none."""
        return -self.pole.real / abs(self.pole)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Stabilisation:
    """What a stabilisation diagram shows, one entry per pole of every band and order.

    `mode` is the index of the identified mode that the pole belongs to, or -1.
    """

    order: Int[np.ndarray, " pole"]
    frequency_hz: Float[np.ndarray, " pole"]
    frequency_sd_hz: Float[np.ndarray, " pole"]
    damping_ratio: Float[np.ndarray, " pole"]
    damping_sd: Float[np.ndarray, " pole"]
    mode: Int[np.ndarray, " pole"]

    def of_modes(self, kept: Sequence[int]) -> "Stabilisation":
        """Diagram after a selection of modes.

        Its `mode` counts the modes kept, in their order; poles of the others belong to none.
        """
        places = np.full(int(self.mode.max(initial=-1)) + 2, -1)
        for place, former in enumerate(kept):
            if former < len(places) - 1:
                places[former] = place
        return dataclasses.replace(self, mode=places[self.mode])

    def within(self, band_hz: tuple[float, float]) -> "Stabilisation":
        """Diagram without the poles outside a band."""
        use = (self.frequency_hz >= band_hz[0]) & (self.frequency_hz <= band_hz[1])
        parts = {f.name: getattr(self, f.name)[use] for f in dataclasses.fields(self)}
        return Stabilisation(**parts)


def find_stable_poles(poles: Poles, *, low_hz: float, high_hz: float) -> list[StablePole]:
    """Poles that are stable over model orders."""
    frequency, damping = poles.frequency_hz, poles.damping_ratio
    sd_f, sd_z, _ = poles.standard_deviations()
    fit = PoleLimits(low_hz, high_hz).inside(poles.pole)
    width = np.maximum(damping * frequency, 0.5 / poles.duration_s)
    fit = fit[sd_f[fit] < MOST_SD * width[fit]]
    spread = np.stack([sd_f / frequency, sd_z]) + HALF_ROUNDING
    place = np.stack([np.log(frequency), damping])
    top = int(poles.order.max(initial=0))
    found = []
    for members in _chains(poles, fit, place, spread):
        orders = poles.order[members]
        share = len(members) / (top - orders.min() + 1)
        if len(members) < SHORTEST or share < DENSEST:
            continue
        middle = members[np.argsort(frequency[members])[len(members) // 2]]
        found.append(
            StablePole(
                complex(poles.pole[middle]),
                poles.shape[:, middle],
                float(sd_f[middle]),
                float(sd_z[middle]),
                len(members),
                float(share),
                members,
                int(middle),
            )
        )
    return _without_doubles(sorted(found, key=lambda c: c.frequency_hz))


def _chains(
    poles: Poles, fit: np.ndarray, place: np.ndarray, spread: np.ndarray
) -> list[np.ndarray]:
    """Follow poles from the highest order down, nearest pairs first."""
    chains: list[list[int]] = []
    for order in sorted(set(poles.order[fit].tolist()), reverse=True):
        here = fit[poles.order[fit] == order]
        alive = [k for k, c in enumerate(chains) if poles.order[c[-1]] - order <= GAP]
        pairs = []
        if alive:
            ends = np.array([chains[k][-1] for k in alive])
            sd = np.maximum(spread[:, ends][:, :, None], spread[:, here][:, None, :])
            away = np.abs(place[:, ends][:, :, None] - place[:, here][:, None, :]) / sd
            cost = away.max(axis=0) / REACH
            cost[mac_matrix(poles.shape[:, ends], poles.shape[:, here]) < ALIKE] = np.inf
            pairs = [
                (cost[i, j], alive[i], int(here[j]))
                for i, j in zip(*np.nonzero(cost < 1.0), strict=True)
            ]
        continued: set[int] = set()
        taken: set[int] = set()
        for _, chain, pole in sorted(pairs):
            if chain not in continued and pole not in taken:
                chains[chain].append(pole)
                continued.add(chain)
                taken.add(pole)
        chains.extend([int(pole)] for pole in here if int(pole) not in taken)
    return [np.array(chain) for chain in chains]


def _without_doubles(found: list[StablePole]) -> list[StablePole]:
    """Of two candidates within half a half-bandwidth and of one shape the longer-lived."""
    kept: list[StablePole] = []
    for one in sorted(found, key=lambda c: -c.orders):
        width = abs(one.pole.real)
        near = [c for c in kept if abs(c.pole - one.pole) < 0.5 * max(width, abs(c.pole.real))]
        if any(mac_matrix(one.shape[:, None], c.shape[:, None])[0, 0] > ALIKE for c in near):
            continue
        kept.append(one)
    return sorted(kept, key=lambda c: c.frequency_hz)

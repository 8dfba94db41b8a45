"""Shapes that a force surface may be made to have: odd or even, and monotone.

Each removes coefficients or bounds them, so that short or noisy records determine the rest
better. A shape that the records contradict is refused, never imposed.
"""

import dataclasses
from collections.abc import Mapping, Sequence

from slowtime.dynamics.effects.library.measured_force import COARSE, FINE, MIXED, SPEED

ODD = -1
"""[1] Parity of a surface, its force at (-e, -v) over that at (e, v). Source: definition."""
NEITHER = 0
"""[1] Parity of a surface without symmetry. Source: convention."""
EVEN = 1
"""[1] Parity of a surface that is the same on both sides. Source: definition."""
WORDS = ("auto", "free", "odd", "even", "monotone")
"""What a user may ask for."""
_SPLINES = {"g": FINE + 3, "h": SPEED + 3, "mu": COARSE + 3, "ga": COARSE + 3}
_FACTORS = {"g": EVEN, "h": EVEN, "mu": ODD, "ga": ODD}
"""Parity of the factor that a spline stands before."""
_PLAIN = {
    "x_n": ODD, "y_n": ODD, "q_n": ODD, "qy_n": EVEN, "w_n": ODD, "r_n": ODD, "xw_n": EVEN,
    "xr_n": EVEN, "xl1_n": ODD, "xl2_n": ODD,
    "xl3_n": ODD, "yl_n": ODD,
}  # fmt: skip
"""Parity of the terms that are no splines."""


@dataclasses.dataclass(frozen=True, slots=True)
class SurfaceDemand:
    """Shape that a user demands of a force surface.

    Parameters
    ----------
    parity
        `ODD`, `EVEN` or `NEITHER`; None where the records are to decide.
    monotone
        Whether the force may only rise, or only fall, with elongation and with rate.
    """

    parity: int | None = None
    monotone: bool = False

    @property
    def is_any(self) -> bool:
        """Whether nothing is demanded of the shape."""
        return self.parity in (None, NEITHER) and not self.monotone

    @classmethod
    def of(cls, words: Sequence[str]) -> "SurfaceDemand":
        """Read a demand from some of `WORDS`; none means auto.

        Raises `ValueError` for other words, or words that contradict each other.
        """
        asked = set(words)
        strange = sorted(asked - set(WORDS))
        if strange:
            raise ValueError(
                f"No shape of a surface is called {strange[0]!r}. Allowed: {', '.join(WORDS)}."
            )
        if len(asked & {"auto", "free", "odd", "even"}) > 1 or {"even", "monotone"} <= asked:
            raise ValueError(
                f"{', '.join(sorted(asked))} contradict each other. Give one of auto, free, "
                "odd and even; monotone goes with any of them but even."
            )
        parities = {"free": NEITHER, "odd": ODD, "even": EVEN}
        parity = next((parities[word] for word in asked if word in parities), None)
        return cls(parity, "monotone" in asked)


AUTO, ANY_SHAPE = SurfaceDemand(), SurfaceDemand(NEITHER)
"""Odd or even where the records favour it, and any shape."""


@dataclasses.dataclass(frozen=True, slots=True)
class SurfaceShape:
    """Shape of a surface.

    Parameters
    ----------
    monotone_e, monotone_v
        1 where the force never falls with elongation or with rate, -1 where it never rises, 0
        where it may do both.
    """

    parity: int = NEITHER
    monotone_e: int = 0
    monotone_v: int = 0

    @property
    def parameters(self) -> dict[str, float]:
        """Options of the effect that are not as they are by default."""
        own = dataclasses.asdict(self)
        return {name: float(value) for name, value in own.items() if value}

    @property
    def words(self) -> str:
        """Say the shape for people; empty where there is none."""
        told = {ODD: ["odd"], NEITHER: [], EVEN: ["even"]}[self.parity]
        if self.monotone_e or self.monotone_v:
            told.append("monotone")
        return " and ".join(told)


FREE = SurfaceShape()
"""Any shape."""


def scales_of(scales: Mapping[str, float], shape: SurfaceShape) -> dict[str, float]:
    """Give the scales of a surface of a shape: the range of an odd or even one is symmetric."""
    if shape.parity == NEITHER:
        return dict(scales) | shape.parameters
    reach = max(abs(scales["low_m"]), abs(scales["high_m"]))
    return dict(scales) | {"centre_m": 0.0, "low_m": -reach, "high_m": reach} | shape.parameters


def groups_of(
    groups: Mapping[str, tuple[str, ...]], parity: int, *, monotone: bool
) -> dict[str, tuple[str, ...]]:
    """Keep the coefficients that a surface of a shape needs; others are zero or said twice."""
    # Damping that depends on nothing is in the group of the rate already.
    kept = {
        group: tuple(
            name
            for name in names
            if _is_needed(name, parity)
            and not (monotone and (name in MIXED or name == "ga1_n"))
        )
        for group, names in groups.items()
    }
    return {group: names for group, names in kept.items() if names}


def _is_needed(name: str, parity: int) -> bool:
    if parity == NEITHER:
        return True
    if name in _PLAIN:
        return _PLAIN[name] == parity
    letters = name.removesuffix("_n").rstrip("0123456789")
    number = int(name.removesuffix("_n").removeprefix(letters))
    spline = parity * _FACTORS[letters]
    if number == 1:
        return spline == EVEN
    # The mirror image of C_k is 1 - C_(count + 2 - k): one of each pair is enough.
    mirror = _SPLINES[letters] + 2 - number
    return number < mirror or (number == mirror and spline == ODD)

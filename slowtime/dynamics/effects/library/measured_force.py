r"""Force surfaces estimated from records, for forces that no law of the catalogue explains.

With the position :math:`x = e/e_1` and the speed :math:`y = v/v_1` over the largest that were
measured, a direction :math:`s = \tanh(v/v_s)` and a side
:math:`q = \tanh(e/e_q)`, the force is

.. math::
   F = a_x x + a_y y + g(e) + h(v) + \mu(e) s + \gamma(e) y + a_q q + a_{qy} q y
       + (a_w + a_{xw} x) w + (a_r + a_{xr} x) r
       + (a_{l1} l + a_{l2} l^2 + a_{l3} l^3) x + a_{yl} l y ,

where :math:`g, h, \mu, \gamma` are cubic B-splines with equal intervals of the warped position
:math:`W((e - e_c)/e_d)` or speed :math:`W(v/v_d)`, with
:math:`W(z) = \operatorname{sgn}(z)\,(\sqrt{1 + 2|z|} - 1)`, so that knots are dense where the
motion dwells. Beyond the measured range :math:`g` and :math:`h` continue as straight lines,
while :math:`\mu` and :math:`\gamma` keep their values. The state :math:`w` is a memory of the
path, :math:`\dot w = (v - |v| w)/l` (Dahl), and :math:`r` one of the past motion in time,
:math:`\dot r = (y - r)/\tau` or :math:`\dot r = (s - r)/\tau`. Stiffness and damping may
change with a level :math:`l` that is slow beside the motion: the recent vibration (heat, say,
or amplitude), :math:`l = m/(m + \bar m)` with :math:`\dot m = (y^2 - m)/\tau_l` and the mean
:math:`\bar m` of :math:`y^2`; the largest elongation so far, :math:`l = m` with
:math:`\dot m = \max(|x| - m, 0)/\tau_l` [2]_; or the age, :math:`l = 1 - e^{-t/\tau_l}`.
All stay between 0 and 1 within the measured range, so that runs of the model stay bounded.

A surface may be odd or even: with the parity :math:`\pi = -1` or :math:`1`, the force is
:math:`\tfrac12 (F(e, v, w, r) + \pi F(-e, -v, -w, -r))`. It may rise or fall throughout with
the elongation, or with the rate: the coefficients of each then have one sign, which makes the
B-splines monotone [1]_, and those of terms that depend on both e and v are zero.

References
----------
.. [1] J. O. Ramsay, "Monotone regression splines in action", Stat. Sci. 3 (1988).
.. [2] L. Mullins, "Softening of rubber by deformation", Rubber Chem. Technol. 42 (1969).
"""

import math
from collections.abc import Mapping
from typing import Any

from slowtime.dynamics.effects.compilation import compiled
from slowtime.dynamics.effects.kind import Kind, Law, Parameter

FINE, COARSE, SPEED = 10, 5, 8
"""[intervals] Of the splines g; mu and gamma; h. Source: judgement; no
study is recorded."""


@compiled
def spline(share: float, intervals: int, differences: Any, first: int) -> float:
    """Evaluate a cubic B-spline with equal intervals, given differences of its coefficients.

    Independent priors of the differences make a smooth curve, which stays level where no
    record determines it (P-splines).

    The differences begin with the first coefficient, at index `first`; there are three
    coefficients more than intervals.

    References
    ----------
    .. [1] C. de Boor, "A Practical Guide to Splines", Springer (2001), ch. IX.
    .. [2] P. H. C. Eilers and B. D. Marx, "Flexible smoothing with B-splines and penalties",
       Stat. Sci. 11 (1996).
    """
    at = share * intervals
    cell = min(max(int(at), 0), intervals - 1)
    u = at - cell
    r = 1.0 - u
    level = 0.0
    for k in range(cell + 1):
        level += differences[first + k]
    i = first + cell
    one = differences[i + 1]
    two = one + differences[i + 2]
    three = two + differences[i + 3]
    bent = (3.0 * u * u * u - 6.0 * u * u + 4.0) * one
    bent += (3.0 * r * r * r - 6.0 * r * r + 4.0) * two
    bent += u * u * u * three
    return float(level + bent / 6.0)


@compiled
def warped(value: float, low: float, high: float, centre: float, dense: float) -> float:
    """Give the share of the warped range that lies below a value [1].

    Knots are densest at `centre`, and stay so over the distance `dense`.
    """
    least, here, most = (
        (low - centre) / dense,
        (value - centre) / dense,
        (high - centre) / dense,
    )
    below = math.copysign(math.sqrt(1.0 + 2.0 * abs(least)) - 1.0, least)
    until = math.copysign(math.sqrt(1.0 + 2.0 * abs(here)) - 1.0, here)
    whole = math.copysign(math.sqrt(1.0 + 2.0 * abs(most)) - 1.0, most)
    return float((until - below) / max(whole - below, 1e-300))


@compiled
def curve(
    value: float, low: float, high: float, centre: float, dense: float, p: Any, first: int
) -> float:
    """Evaluate a spline over the warped range, continued as a straight line beyond it.

    Its coefficients begin at index `first` of `p`: of `FINE` intervals for the elongation, of
    `SPEED` for its rate.
    """
    intervals = 10 if first == 10 else 8
    held = min(max(value, low), high)
    at_edge = spline(warped(held, low, high, centre, dense), intervals, p, first)
    if held == value or high <= low:
        return float(at_edge)
    # The slope beyond an edge is the mean slope over the outer fifth of the half range.
    back = math.copysign(0.2 * (high - low) / 2.0, value - held)
    inside = spline(warped(held - back, low, high, centre, dense), intervals, p, first)
    return float(at_edge + (at_edge - inside) / back * (value - held))


@compiled
def static(e: float, v: float, p: Any) -> float:
    """Give the part of the surface without memory [N]."""
    x, y = e / max(abs(p[4]), abs(p[5])), v / p[7]
    s, q = math.tanh(v / p[0]), math.tanh(e / p[1])
    at = warped(min(max(e, p[4]), p[5]), p[4], p[5], p[2], p[3])
    return float(
        p[9] * x
        + p[23] * y
        + curve(e, p[4], p[5], p[2], p[3], p, 10)
        + curve(v, -p[7], p[7], 0.0, p[6], p, 24)
        + spline(at, 5, p, 35) * s
        + spline(at, 5, p, 43) * y
        + (p[51] + p[52] * y) * q
    )


@compiled
def mirrored(here: float, there: float, parity: float) -> float:
    """Give the odd (parity -1) or the even (1) part of a force, or (0) the force."""
    return float(here if parity == 0.0 else (here + parity * there) / 2.0)


def surface(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of the surface without memory [N]."""
    there = 0.0 if p[53] == 0.0 else static(-e, -v, p)
    return float(mirrored(static(e, v, p), there, p[53]))


@compiled
def remembered(e: float, v: float, w: float, r: float, level: float, p: Any) -> float:
    """Give the part of the surface that depends on past motion or on age [N].

    It depends on memories of the path and of the time, `w` and `r`, and on the slow level [1].
    """
    x = min(max(e, p[4]), p[5]) / max(abs(p[4]), abs(p[5]))
    changed = (p[66] + (p[67] + p[68] * level) * level) * x + p[69] * v / p[7]
    return float((p[62] + p[63] * x) * w + (p[64] + p[65] * x) * r + changed * level)


def surface_with_memory(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of the surface with memory [N]."""
    level = level_of(t, z[2], p)
    here = static(e, v, p) + remembered(e, v, z[0], z[1], level, p)
    if p[53] == 0.0:
        return float(here)
    there = static(-e, -v, p) + remembered(-e, -v, -z[0], -z[1], level, p)
    return float(mirrored(here, there, p[53]))


def path_memory(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the memory that fades over a path [1/s]."""
    return float((v - abs(v) * z[0]) / p[56])


def time_memory(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the memory that fades over a time [1/s]."""
    drive = math.tanh(v / p[0]) if p[58] > 0.5 else v / p[7]
    return float((drive - z[1]) / p[57])


@compiled
def level_of(t: float, m: float, p: Any) -> float:
    """Give the slow level [1].

    `m` is the mean of the recent y^2, or the largest |x| so far [1].
    """
    if p[60] > 1.5:
        return 1.0 - math.exp(-max(t, 0.0) / p[59])
    return min(m, 1.0) if p[60] > 0.5 else max(m, 0.0) / (max(m, 0.0) + p[61])


def level_memory(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the level of the recent vibration, or of the largest elongation [1/s]."""
    if p[60] > 0.5:
        return float(max(abs(e) / max(abs(p[4]), abs(p[5])) - z[2], 0.0) / p[59])
    return float(((v / p[7]) ** 2 - z[2]) / p[59])


TERMS = (
    ("position", (("x_n", "x"), *((f"g{i + 1}_n", f"C{i + 1}(e)") for i in range(FINE + 3)))),
    ("speed", (("y_n", "y"), *((f"h{i + 1}_n", f"C{i + 1}(v)") for i in range(SPEED + 3)))),
    ("friction", tuple((f"mu{i + 1}_n", f"s C{i + 1}(e)") for i in range(COARSE + 3))),
    ("damping", tuple((f"ga{i + 1}_n", f"y C{i + 1}(e)") for i in range(COARSE + 3))),
    ("side", (("q_n", "q"), ("qy_n", "q y"))),
)
"""Groups of coefficients [N]: name of the group, names of its coefficients, and the term that
each stands before; Ck is the sum of the B-splines from the k-th on."""
MEMORY_TERMS = (
    ("path", (("w_n", "w"), ("xw_n", "x w"))),
    ("time", (("r_n", "r"), ("xr_n", "x r"))),
    ("level", (("xl1_n", "x l"), ("xl2_n", "x l^2"), ("xl3_n", "x l^3"), ("yl_n", "y l"))),
)
"""The same of memory."""


def _scale(name: str, unit: str, meaning: str) -> Parameter:
    return Parameter(name=name, unit=unit, meaning=meaning, low=0.0, nonzero=True, fitted=False)


def _chosen(name: str, unit: str, meaning: str) -> Parameter:
    return Parameter(name=name, unit=unit, meaning=meaning, fitted=False)


def _coefficients(groups: tuple[Any, ...]) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            name=name, unit="N", meaning=f"coefficient of {term}", default=0.0,
            spread="spread_n", direction=DIRECTIONS.get(name, ""),
        )
        for _, group in groups
        for name, term in group
    )  # fmt: skip


def _option(name: str, meaning: str) -> Parameter:
    return Parameter(
        name=name, unit="", meaning=meaning, choices=(-1.0, 0.0, 1.0), default=0.0, fitted=False
    )


DIRECTIONS: Mapping[str, str] = {
    **dict.fromkeys(("x_n", "q_n", *(f"g{i + 2}_n" for i in range(FINE + 2))), "monotone_e"),
    **dict.fromkeys(
        ("y_n", "mu1_n", "ga1_n", *(f"h{i + 2}_n" for i in range(SPEED + 2))), "monotone_v"
    ),
}
"""Parameter that says which sign a coefficient must have, by the name of the coefficient."""
MIXED = (
    *(f"{name}{i + 2}_n" for name in ("mu", "ga") for i in range(COARSE + 2)),
    "qy_n", "xw_n", "xr_n", "xl1_n", "xl2_n", "xl3_n", "yl_n",
)  # fmt: skip
"""Coefficients of terms that depend on the elongation and on the motion besides: zero in a
monotone surface, as their slope changes sign with the rate or the memory."""
OPTIONS = (
    _option("parity", "symmetry of the surface: -1 odd, 1 even, 0 neither"),
    _option("monotone_e", "slope over the elongation: 1 never falls, -1 never rises, 0 either"),
    _option("monotone_v", "slope over the rate: 1 never falls, -1 never rises, 0 either"),
)
"""Shape that a surface is made to have."""


SCALES = (
    _scale("vs_m_per_s", "m/s", "speed scale vs of the direction s"),
    _scale("eq_m", "m", "elongation scale eq of the side q"),
    _chosen("centre_m", "m", "elongation about which spline knots are dense"),
    _scale("dense_m", "m", "distance from centre_m within which knots are dense"),
    _chosen("low_m", "m", "least elongation that was measured"),
    _chosen("high_m", "m", "largest elongation that was measured"),
    _scale("dense_m_per_s", "m/s", "rate within which knots are dense"),
    _scale("high_m_per_s", "m/s", "largest rate that was measured"),
    _scale("spread_n", "N", "standard deviation of the prior of a coefficient"),
)
"""Numbers of a surface that are chosen, not fitted."""
MEMORY_SCALES = (
    _scale("path_m", "m", "path over which the memory w fades"),
    _scale("lag_s", "s", "time over which the memory r fades"),
    Parameter(
        name="lag_of", unit="", meaning="what r remembers: 0 the speed y, 1 the direction s",
        choices=(0.0, 1.0), fitted=False,
    ),
    Parameter(
        name="level_s", unit="s", meaning="time over which the level l follows", low=0.0,
        nonzero=True, default=1.0, fitted=False,
    ),
    Parameter(
        name="level_of", unit="", default=0.0, choices=(0.0, 1.0, 2.0), fitted=False,
        meaning="what l is: 0 the recent vibration m/(m + level_mean), 1 the largest |x| so "
        "far, 2 the age, 1 - exp(-t/level_s)",
    ),
    Parameter(
        name="level_mean", unit="", meaning="mean of y^2", low=0.0, nonzero=True, default=1.0,
        fitted=False,
    ),
)  # fmt: skip
"""The same of memory."""
_STATIC = (*SCALES, *_coefficients(TERMS), *OPTIONS)
_SOURCE = "restoring-force surfaces: Masri and Caughey 1979; B-splines: de Boor 2001"
_SUM = "sum of coefficients times x, C(e), y, C(v), s C(e), y C(e), q and q y"
_SYMBOLS = (
    "x and y are e and v over their largest measured sizes, s = tanh(v/vs), q = tanh(e/eq), "
    "Ck the sum of the cubic B-splines from the k-th on; the odd or even part of it, and "
    "coefficients of one sign, where `parity`, `monotone_e` or `monotone_v` say so"
)


def contradiction(parameters: Mapping[str, float]) -> str | None:
    """Explain which coefficient a surface of the chosen shape cannot have; None for none."""
    chosen = [n for n in ("monotone_e", "monotone_v") if parameters.get(n, 0.0)]
    if not chosen:
        return None
    option = chosen[0]
    if parameters.get("parity", 0.0) > 0:
        return (
            f"`parity` is 1 and `{option}` is {parameters[option]:g}, but an even surface "
            f"rises to one side and falls to the other. Give parity -1 or 0, or {option} 0."
        )
    for name, value in parameters.items():
        way = parameters.get(DIRECTIONS.get(name, ""), 0.0)
        if value * way < 0:
            least = "at least" if way > 0 else "at most"
            return (
                f"`{name}` is {value:g} and `{DIRECTIONS[name]}` is {way:g}; allowed: {least} "
                f"0. Give {DIRECTIONS[name]} 0 for a surface that both rises and falls."
            )
        if name in MIXED and value:
            return (
                f"`{name}` is {value:g} and `{option}` is {parameters[option]:g}; allowed: 0, "
                f"as its term depends on elongation and motion together. Give {option} 0 to "
                "keep the term."
            )
    return None


KINDS = (
    Kind(
        name="measured_force",
        title="Measured force surface",
        family="measured force",
        where="element",
        parameters=_STATIC,
        equation=f"{_SUM}; {_SYMBOLS}",
        source=_SOURCE,
        sentence="The force as estimated from the records, where no law of the catalogue fits.",
        action=Law(force=surface),
        is_surface=True,
        contradiction=contradiction,
    ),
    Kind(
        name="measured_force_with_memory",
        title="Measured force surface with memory",
        family="measured force",
        where="element",
        parameters=(*_STATIC, *MEMORY_SCALES, *_coefficients(MEMORY_TERMS)),
        equation=f"{_SUM}, w, x w, r, x r, x l, x l², x l³ and y l; {_SYMBOLS}; "
        "ẇ = (v − |v| w)/path, ṙ = (y − r)/lag or (s − r)/lag; l = m/(m + mean) with "
        "ṁ = (y² − m)/level, l = m with ṁ = max(|x| − m, 0)/level, or l = 1 − exp(−t/level)",
        source=f"{_SOURCE}; memory: Dahl 1968, Maxwell 1867, Mullins 1969",
        sentence="The force as estimated from the records, which depends on past motion, where "
        "no law of the catalogue fits.",
        action=Law(force=surface_with_memory, rates=(path_memory, time_memory, level_memory)),
        is_surface=True,
        contradiction=contradiction,
    ),
)

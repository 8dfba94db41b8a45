"""Operators of hysteresis and friction that the texts of laws call, on plain numbers."""

import math

ROUNDED = 0.02
"""[share of its reach] Over which an operator goes from one branch to the other. Source: a
decision: no integrator can follow a rate that jumps where its own state meets a bound."""


def clip(x: float, reach: float) -> float:
    """Return x, held to plus or minus `reach`."""
    return min(max(x, -reach), reach)


def _ramp(x: float) -> float:
    """Rise from 0 to 1 as x does."""
    return min(max(x, 0.0), 1.0)


def stop_rate(v: float, h: float, reach: float) -> float:
    """Rate of a stop operator: of a spring in series with a slider that yields at `reach`."""
    ahead = h if v > 0.0 else -h
    return v * (1.0 - _ramp((ahead / reach - 1.0) / ROUNDED + 1.0))


def play_rate(e: float, v: float, h: float, reach: float) -> float:
    """Rate of a play operator: of a body that is pushed once the play to that side is used."""
    ahead = e - h if v > 0.0 else h - e
    return v * _ramp((ahead / reach - 1.0) / ROUNDED + 1.0)


def peak_rate(e: float, v: float, h: float, size: float) -> float:
    """Rate of the largest elongation to either side so far."""
    return abs(v) * _ramp((abs(e) - h) / (ROUNDED * size)) if e * v > 0.0 else 0.0


def rate_and_state(v: float, h: float, p: tuple[float, float, float, float, float]) -> float:
    """Friction over the normal force of Dieterich and Ruina, regularised about zero speed.

    Parameters
    ----------
    v
        Speed of sliding [m/s].
    h
        Logarithm of the state times the reference speed over the path of renewal.
    p
        Coefficient at the reference speed, direct effect a, evolution effect b [1], reference
        speed [m/s], path of renewal [m].

    References
    ----------
    .. [1] J. R. Rice, N. Lapusta, K. Ranjith, "Rate and state dependent friction and the
       stability of sliding between elastically deformable solids", JMPS 49 (2001), eq. 15.
    """
    mu, a, b, v0, _ = p
    return a * math.asinh(v / (2.0 * v0) * math.exp((mu + b * h) / a))


def renewal_rate(v: float, h: float, p: tuple[float, float, float, float, float]) -> float:
    """Rate of the logarithm of that state: it ages at rest and is renewed by sliding."""
    *_, v0, path = p
    return v0 / path * math.exp(-h) - abs(v) / path


OPERATORS = {
    one.__name__: one
    for one in (clip, stop_rate, play_rate, peak_rate, rate_and_state, renewal_rate)
}

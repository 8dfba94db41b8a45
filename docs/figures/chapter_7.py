"""Draw figure 7.1: Gaussian-process twins by stiffness, by mass, and by both.

``python -m docs.figures.chapter_7`` writes ``figure_7_1.png`` and, beside it, a CSV with the
very numbers that it shows.
"""

from collections.abc import Sequence

import numpy as np

from docs.figures import sheet
from docs.figures.sheet import Array, Figure, Line
from slowtime.dynamics.evolution_functions import mass_change, stiffness_change
from slowtime.evolution import mass_from_frequency, stiffness_and_mass, stiffness_from_frequency
from slowtime.evolution.forecasting import forecast
from slowtime.evolution.stiffness_mass.forward_model import (
    damped_frequency_ratio,
    damping_ratio,
    natural_frequency_ratio,
)

DAMPING, ERROR_SD = 0.05, 0.01
BOTH_SD, DAMPING_SD = 0.001, 0.02
"""Relative errors of frequency and damping where both are read."""

TIME = np.arange(0.0, 1001.0, 10.0)
KNOWN = TIME <= 750.0
DENSE = np.arange(0.0, 1001.0, 2.0)


def foretold(value: Array, sd: Array) -> tuple[Array, Array, Array]:
    """Mean and band of what is to come, learnt from the first three quarters."""
    past = TIME[KNOWN], value[KNOWN], sd[KNOWN]
    found = forecast.predict(forecast.fit(*past), *past, TIME[~KNOWN])
    return found.mean, found.lo, found.hi


def panel(which: str, truth: Array, value: Array, sd: Array) -> list[Line]:
    """Truth, readings with their intervals, and the forecast."""
    mean, lo, hi = foretold(value, sd)
    half = 1.96 * sd[KNOWN]
    read = value[KNOWN]
    return [
        Line(which, "actual system", DENSE, truth, colour=sheet.SOFT),
        Line(
            which,
            "twin, each reading",
            TIME[KNOWN],
            read,
            read - half,
            read + half,
            points=True,
        ),
        Line(which, "forecast, 95 %", TIME[~KNOWN], mean, lo, hi, sheet.OTHER),
    ]


def lines() -> list[Line]:
    """Three twins, each taught by the first three quarters of its history."""
    rng = np.random.default_rng(7)
    none = np.zeros_like(TIME)
    error = ERROR_SD * rng.standard_normal((2, len(TIME)))
    k = damped_frequency_ratio(stiffness_change(TIME), none, damping_ratio_0=DAMPING)
    m = damped_frequency_ratio(none, mass_change(TIME), damping_ratio_0=DAMPING)
    by_k = stiffness_from_frequency(k + error[0], ERROR_SD, damping_ratio_0=DAMPING)
    by_m = mass_from_frequency(m + error[1], ERROR_SD, damping_ratio_0=DAMPING)
    both = stiffness_change(TIME), mass_change(TIME)
    ratio = natural_frequency_ratio(*both) * (1 + BOTH_SD * rng.standard_normal(len(TIME)))
    zeta = damping_ratio(*both, damping_ratio_0=DAMPING)
    zeta = zeta * (1 + DAMPING_SD * rng.standard_normal(len(TIME)))
    joint = stiffness_and_mass(
        ratio, np.full_like(TIME, BOTH_SD), zeta, np.full_like(TIME, DAMPING_SD),
        damping_ratio_0=DAMPING, damping_coefficient_sd=0.0,
    )  # fmt: skip
    return [
        *panel("a", stiffness_change(DENSE), by_k.value, by_k.sd),
        *panel("b", mass_change(DENSE), by_m.value, by_m.sd),
        *panel("c", stiffness_change(DENSE), joint.stiffness.value, joint.stiffness.sd),
    ]


def caption(drawn: Sequence[Line]) -> str:
    """Say what is shown, with the errors of this very draw."""
    errors = [
        sheet.rmse(drawn, which, name, "actual system")
        for which in "abc"
        for name in ("twin, each reading", "forecast, 95 %")
    ]
    return (
        "Figure 7.1. Gaussian-process twins, taught by the readings up to 750 T0: (a) "
        "stiffness, (b) mass, each from frequency alone, (c) stiffness where both change, from "
        "frequency and damping, damping coefficient constant. Waves, trend and rough process "
        "are weighed by evidence. Root mean square error of readings and forecast: "
        + "; ".join(f"{errors[2 * i]:.4f}, {errors[2 * i + 1]:.4f}" for i in range(3))
        + "."
    )


FIGURES = {
    "figure_7_1": Figure(
        lines,
        {
            "a": ("(a) stiffness", "slow time  ts/T0", "change of stiffness Δk"),
            "b": ("(b) mass", "slow time  ts/T0", "change of mass Δm"),
            "c": ("(c) stiffness beside mass", "slow time  ts/T0", "change of stiffness Δk"),
        },
        caption,
    )
}

if __name__ == "__main__":
    sheet.main(FIGURES)

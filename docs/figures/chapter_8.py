"""Draw figure 8.1: two slow time scales in one series, taken apart.

``python -m docs.figures.chapter_8`` writes ``figure_8_1.png`` and, beside it, a CSV with the
very numbers that it shows.
"""

from collections.abc import Sequence

import numpy as np

from docs.figures import sheet
from docs.figures.sheet import Figure, Line
from slowtime.dynamics.evolution_functions import mass_change, stiffness_change
from slowtime.evolution.time_scales import separation

ERROR_SD = 0.025
TIME = np.linspace(0.0, 1000.0, 201)
DENSE = np.arange(0.0, 1001.0, 1.0)
SHOWN = TIME <= 300.0


def lines() -> list[Line]:
    """Superpose eq. 5.12 and 5.13, and show what two models make of the readings."""
    rng = np.random.default_rng(8)
    value = stiffness_change(TIME) + mass_change(TIME)
    value = value + ERROR_SD * rng.standard_normal(len(TIME))
    choice = separation.choose(TIME, value, np.full(len(TIME), ERROR_SD))
    both, mixed = choice.additive, choice.mixture
    early = DENSE <= 300.0
    truth = (stiffness_change(DENSE) + mass_change(DENSE))[early]
    close = 1.96 * both.sd[SHOWN], 1.96 * mixed.sd[SHOWN]
    level = np.mean(both.long - stiffness_change(TIME))
    half = 1.96 * both.long_sd
    long = both.long - level
    return [
        Line("a", "actual", DENSE[early], truth, colour=sheet.SOFT),
        Line("a", "readings", TIME[SHOWN], value[SHOWN], colour=sheet.TRUTH, points=True),
        Line(
            "a", "additive, 95 %", TIME[SHOWN], both.mean[SHOWN],
            both.mean[SHOWN] - close[0], both.mean[SHOWN] + close[0],
        ),
        Line("b", "actual", DENSE, stiffness_change(DENSE), colour=sheet.SOFT),
        Line("b", "long scale, 95 %", TIME, long, long - half, long + half),
        Line("c", "actual", DENSE[early], truth, colour=sheet.SOFT),
        Line(
            "c", "mixture, 95 %", TIME[SHOWN], mixed.mean[SHOWN],
            mixed.mean[SHOWN] - close[1], mixed.mean[SHOWN] + close[1], sheet.OTHER,
        ),
    ]  # fmt: skip


def caption(drawn: Sequence[Line]) -> str:
    """Say what is shown, with the errors of this very draw."""
    a, b, c, d = (
        sheet.rmse(drawn, *asked, "actual")
        for asked in (
            ("a", "readings"), ("a", "additive, 95 %"), ("c", "mixture, 95 %"),
            ("b", "long scale, 95 %"),
        )
    )  # fmt: skip
    return (
        "Figure 8.1. A stiffness that fades (eq. 5.12) and a mass that comes and goes (eq. "
        "5.13), superposed, read every 5 T0 with an error of sd 0.025. (a) The additive "
        "process, first part of the record; (b) its long scale, up to a constant; (c) "
        "a mixture of two experts. Root mean square error where shown: readings "
        f"{a:.4f}, additive {b:.4f}, mixture {c:.4f}; long scale {d:.4f}."
    )


FIGURES = {
    "figure_8_1": Figure(
        lines,
        {
            "a": ("(a) both scales", "slow time  ts/T0", "Δk + Δm"),
            "b": ("(b) the long scale", "slow time  ts/T0", "Δk"),
            "c": ("(c) mixture of experts", "slow time  ts/T0", "Δk + Δm"),
        },
        caption,
    )
}

if __name__ == "__main__":
    sheet.main(FIGURES)

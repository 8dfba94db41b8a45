"""Figure of a measured force surface, by matplotlib."""

from typing import Any

import numpy as np

from slowtime.discrepancy.diagnosis import ForceCut, MeasuredForce
from slowtime_services.diagnose.force_charts import BAND_SDS, FORCE, LAW, OUTSIDE, SAMPLE

from .optional import optional
from .plotting import Axes


def draw_force(measured: MeasuredForce, coordinate: str) -> list[Axes]:
    """Draw a surface over elongation and over rate, and where the records measured it.

    Parameters
    ----------
    measured
        The surface.
    coordinate
        Unit of the elongation.

    Returns
    -------
    The matplotlib axes: over elongation, over its rate, and of the samples.
    """
    pyplot = optional("matplotlib.pyplot")
    figure, panels = pyplot.subplot_mosaic(
        [["e", "v"], ["map", "map"]], figsize=(9.0, 7.5), layout="constrained"
    )
    unit = "N m" if coordinate == "rad" else "N"
    names = {"e": f"elongation [{coordinate}]", "v": f"its rate [{coordinate}/s]"}
    _draw_cut(panels["e"], measured.over_e, (measured.low, measured.high), measured.law)
    _draw_cut(panels["v"], measured.over_v, (-measured.most, measured.most), measured.law)
    for key in ("e", "v"):
        panels[key].set(xlabel=names[key], ylabel=f"force [{unit}]")
    held = measured.over_e.held, measured.over_v.held
    panels["e"].set_title(f"at rate {held[0]:.3g} {coordinate}/s", fontsize="medium")
    panels["v"].set_title(f"at elongation {held[1]:.3g} {coordinate}", fontsize="medium")
    figure.legend(
        *panels["e"].get_legend_handles_labels(), loc="outside lower center", ncols=2,
        fontsize="small",
    )  # fmt: skip
    size = float(np.nanmax(np.abs(measured.grid_force), initial=0.0)) or 1.0
    shown = panels["map"].pcolormesh(
        measured.grid_e, measured.grid_v, np.ma.masked_invalid(measured.grid_force),
        cmap="RdBu", vmin=-size, vmax=size,
    )  # fmt: skip
    panels["map"].plot(measured.e, measured.v, ".", color=SAMPLE, markersize=1, alpha=0.4)
    panels["map"].set(
        xlabel=names["e"], ylabel=names["v"],
        title="where the signals measured it (dots: samples; empty: never there)",
    )  # fmt: skip
    figure.colorbar(shown, ax=panels["map"], label=f"force [{unit}]")
    figure.suptitle(
        f"Force surface at {measured.place}, 95 % band, {measured.shape or 'any shape'}"
    )
    return [panels[key] for key in ("e", "v", "map")]


def _draw_cut(axes: Any, cut: ForceCut, ends: tuple[float, float], law: str) -> None:
    """Draw one cut: band, force, law, and the measured range shaded."""
    axes.axvspan(*ends, color=SAMPLE, alpha=0.13, linewidth=0, label="measured range")
    low, high = cut.force - BAND_SDS * cut.sd, cut.force + BAND_SDS * cut.sd
    axes.fill_between(cut.at, low, high, color=FORCE, alpha=0.25, label="95 % band")
    axes.plot(cut.at, cut.force, color=FORCE, linewidth=2, label="measured force surface")
    if cut.law is not None:
        axes.plot(cut.at, cut.law, "--", color=LAW, label=f"most like: {law}")
    for end, side in zip(ends, ("right", "left"), strict=True):
        axes.annotate(
            OUTSIDE, (end, 0.02), (-3 if side == "right" else 3, 0), ha=side, va="bottom",
            xycoords=("data", "axes fraction"), textcoords="offset points", rotation=90,
            fontsize="x-small", color=SAMPLE, annotation_clip=False,
        )  # fmt: skip
    axes.margins(x=0)

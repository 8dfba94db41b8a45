"""Charts of a measured force surface: cuts with bands, and where the records measured it."""

from typing import Any

import numpy as np

from slowtime.discrepancy.diagnosis import ForceCut, MeasuredForce
from slowtime_services.reports import Chart

from .labels import placed, rounded

BAND_SDS = 1.96
"""[standard deviations] Half width of the band that is drawn. Source: 95 % of a normal
distribution."""
FORCE, LAW, SAMPLE, INSIDE = "#0b6fb8", "#b3541e", "#5b6770", "rgba(91, 103, 112, 0.13)"
OUTSIDE = "outside the measured range"
Plain = dict[str, Any]


def force_charts(measured: MeasuredForce, coordinate: str) -> list[Chart]:
    """Draw a surface over elongation and over rate, and over both with the records' motion."""
    return [_cuts(measured, coordinate), _coverage(measured, coordinate)]


def describe_measured_force(measured: MeasuredForce, coordinate: str) -> str:
    """Say what the chart of the cuts shows.

    Parameters
    ----------
    measured
        The surface.
    coordinate
        Unit of the elongation.
    """
    place = placed(measured.place.kind, measured.place.id)
    text = (
        f"Force surface fitted at {place}, with its 95 % band: over the elongation at rate "
        f"{measured.over_e.held:.3g} {coordinate}/s, and over the rate at elongation "
        f"{measured.over_v.held:.3g} {coordinate}. Shaded: the measured range. Beyond it the "
        "surface is extrapolated linearly, which no record supports, and the band opens."
    )
    if measured.shape:
        text += f" The surface is {measured.shape}."
    if measured.remembers:
        text += " The part of the force that depends on past motion is left out here."
    if not measured.law:
        return text + " No law of the catalogue resembles it."
    drawn = "Dashed: " if _draws_law(measured) else "Not drawn, as it depends on past motion: "
    text += (
        f" {drawn}{measured.law}, the law that it most resembles ({100 * measured.share:.0f} % "
        "of its force, beside a spring and a damper"
    )
    return text + (f"; not above {measured.limits})." if measured.limits else ").")


def _draws_law(measured: MeasuredForce) -> bool:
    return measured.over_e.law is not None


def _cuts(measured: MeasuredForce, coordinate: str) -> Chart:
    unit = "N m" if coordinate == "rad" else "N"
    traces, shapes, notes = [], [], []
    panels = (
        ("", measured.over_e, measured.low, measured.high),
        ("2", measured.over_v, -measured.most, measured.most),
    )
    for axis, cut, low, high in panels:
        where: Plain = {"xaxis": f"x{axis}", "yaxis": f"y{axis}", "showlegend": not axis}
        traces += [where | one for one in _band(cut, measured.law)]
        shapes.append(
            {
                "type": "rect", "xref": f"x{axis}", "yref": f"y{axis} domain",
                "x0": low, "x1": high, "y0": 0, "y1": 1, "layer": "below",
                "fillcolor": INSIDE, "line": {"width": 0},
            }
        )  # fmt: skip
        for end, side in ((low, "right"), (high, "left")):
            notes.append(
                {
                    "xref": f"x{axis}", "yref": f"y{axis} domain", "x": end, "y": 0.03,
                    "yanchor": "bottom", "xanchor": side, "text": OUTSIDE, "textangle": -90,
                    "showarrow": False, "font": {"size": 11, "color": SAMPLE},
                }
            )  # fmt: skip
    layout = {
        "shapes": shapes,
        "annotations": notes,
        "xaxis": {"title": {"text": f"elongation [{coordinate}]"}, "domain": [0, 0.46]},
        "yaxis": {"title": {"text": f"force [{unit}]"}},
        "xaxis2": {
            "title": {"text": f"its rate [{coordinate}/s]"}, "domain": [0.54, 1],
            "anchor": "y2",
        },
        "yaxis2": {"anchor": "x2"},
    }  # fmt: skip
    return Chart(traces, layout, describe_measured_force(measured, coordinate))


def _band(cut: ForceCut, law: str) -> list[Plain]:
    """Band, force and law of one cut."""
    low, high = cut.force - BAND_SDS * cut.sd, cut.force + BAND_SDS * cut.sd
    edge: Plain = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    unlisted = edge | {"showlegend": False}
    lines: list[Plain] = [
        {"x": rounded(cut.at), "y": rounded(low), "name": "lower edge"} | unlisted,
        {
            "x": rounded(cut.at), "y": rounded(high), "name": "95 % band", "fill": "tonexty",
            "fillcolor": "rgba(11, 111, 184, 0.22)",
        } | edge,
        {
            "x": rounded(cut.at), "y": rounded(cut.force), "name": "measured force surface",
            "mode": "lines", "line": {"color": FORCE, "width": 2.5},
        },
    ]  # fmt: skip
    if cut.law is not None:
        lines.append({
            "x": rounded(cut.at), "y": rounded(cut.law), "name": law, "mode": "lines",
            "line": {"color": LAW, "width": 2, "dash": "dash"},
        })  # fmt: skip
    return lines


def _coverage(measured: MeasuredForce, coordinate: str) -> Chart:
    """Draw the force over the plane of motion, with the samples of the records."""
    unit = "N m" if coordinate == "rad" else "N"
    size = float(np.nanmax(np.abs(measured.grid_force), initial=0.0)) or 1.0
    traces: list[Plain] = [
        {
            "type": "heatmap", "x": rounded(measured.grid_e), "y": rounded(measured.grid_v),
            "z": [rounded(row) for row in measured.grid_force], "zmin": -size, "zmax": size,
            "colorscale": "RdBu", "name": "force",
            "colorbar": {"title": {"text": f"force [{unit}]"}},
        },
        {
            "x": rounded(measured.e), "y": rounded(measured.v), "mode": "markers",
            "name": "samples of the records", "hoverinfo": "skip",
            "marker": {"color": SAMPLE, "size": 2.5, "opacity": 0.5},
        },
    ]  # fmt: skip
    room_e, room_v = 0.175 * (measured.high - measured.low), 1.35 * measured.most
    layout = {
        "xaxis": {
            "title": {"text": f"elongation [{coordinate}]"},
            "range": [measured.low - room_e, measured.high + room_e],
        },
        "yaxis": {
            "title": {"text": f"its rate [{coordinate}/s]"}, "range": [-room_v, room_v],
        },
        "shapes": [
            {
                "type": "rect", "x0": measured.low, "x1": measured.high, "y0": -measured.most,
                "y1": measured.most, "line": {"color": SAMPLE, "dash": "dot", "width": 1},
            }
        ],
        "annotations": [
            {
                "x": measured.high, "y": measured.most, "xanchor": "right", "yanchor": "bottom",
                "text": OUTSIDE, "showarrow": False, "font": {"size": 11, "color": SAMPLE},
            }
        ],
    }  # fmt: skip
    return Chart(
        traces,
        layout,
        "Force of the surface where the records measured it, over elongation and rate; dots "
        "are samples of the records. Empty: no record comes there. Dotted: the measured range.",
    )

"""A layout for Foxglove and Lichtblick: which fields of a recording are plotted where.

Import it there beside the recording (Layouts → Import from file). Each asset has a tab's worth
of panels: what the edge measured, what the twin made of it with its 95 % interval, whether that
is valid, and the events.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from slowtime_schemas.streams import (
    EVENT,
    FEATURES,
    HEALTH,
    RAW,
    STATE,
    Stream,
    current_key,
    parse_key,
)

Node = dict[str, Any]

INTERVAL = (".value", ".lo", ".hi")
PLOTS: tuple[tuple[str, tuple[tuple[Stream, str, str], ...]], ...] = (
    (
        "Natural frequency [Hz]",
        (
            (FEATURES, ".modes[0].frequency_hz.value", "measured"),
            *((STATE, f".frequency_hz{part}", f"twin{part}") for part in INTERVAL),
        ),
    ),
    (
        "Change of stiffness [1]",
        tuple((STATE, f".stiffness_change{part}", part[1:]) for part in INTERVAL),
    ),
    (
        "Change of mass [1]",
        tuple((STATE, f".mass_change{part}", part[1:]) for part in INTERVAL),
    ),
    (
        "Damping ratio [1]",
        (
            (FEATURES, ".modes[0].damping_ratio.value", "measured"),
            *((STATE, f".damping_ratio{part}", f"twin{part}") for part in INTERVAL),
        ),
    ),
    (
        "Edge agent",
        (
            (HEALTH, ".last_sequence", "last sequence"),
            (HEALTH, ".dropped", "dropped"),
        ),
    ),
)


def layout_of(topics: Collection[str]) -> Node:
    """Lay out a recording that holds `topics`, of keys of either version.

    Raises
    ------
    ValueError
        Where there is nothing in it that could be plotted.
    """
    panels: dict[str, Node] = {}
    known = {current_key(topic): topic for topic in topics}
    tabs = [
        {"title": f"{site}.{asset}", "layout": _of_asset(site, asset, known, panels)}
        for site, asset in sorted({parse_key(topic)[1:] for topic in topics})
        if any(_plots(site, asset, known))
    ]
    if not tabs:
        samples = any(parse_key(topic)[0] is RAW for topic in topics)
        raise ValueError(
            "There are no features, states or health in this recording, and nothing to plot"
            + (
                ": it holds raw samples only, which Foxglove cannot decode. Run them through "
                "an edge agent, slowtime edge --file FILE, while slowtime record listens."
                if samples
                else ". Record them: slowtime record."
            )
        )
    whole: Any = "Tab!assets"
    panels[whole] = {"activeTabIdx": 0, "tabs": tabs}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": whole,
    }


def _of_asset(site: str, asset: str, topics: Mapping[str, str], panels: dict[str, Node]) -> Any:
    """Add panels of one asset; how they are arranged."""
    name = f"{site}.{asset}"
    added = []
    for number, plot in enumerate(_plots(site, asset, topics)):
        panels[f"Plot!{name}.{number}"] = plot
        added.append(f"Plot!{name}.{number}")
    state, event = STATE.key(site, asset), EVENT.key(site, asset)
    if state in topics:
        valid = {"value": f"{topics[state]}.valid", "timestampMethod": "receiveTime"}
        panels[f"StateTransitions!{name}"] = {"isSynced": True, "paths": [valid]}
        added.append(f"StateTransitions!{name}")
    if event in topics:
        panels[f"RawMessages!{name}"] = {"topicPath": topics[event], "diffEnabled": False}
        added.append(f"RawMessages!{name}")
    half = (len(added) + 1) // 2
    left, right = _column(added[:half]), _column(added[half:])
    if right is None:
        return left
    return {"direction": "row", "first": left, "second": right, "splitPercentage": 50}


def _plots(site: str, asset: str, topics: Mapping[str, str]) -> Iterator[Node]:
    for title, series in PLOTS:
        paths = [
            {
                "value": f"{topics[stream.key(site, asset)]}{path}",
                "label": label,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for stream, path, label in series
            if stream.key(site, asset) in topics
        ]
        if paths:
            yield {
                "title": title,
                "paths": paths,
                "xAxisVal": "timestamp",
                "showLegend": True,
                "legendDisplay": "floating",
                "showXAxisLabels": True,
                "showYAxisLabels": True,
                "isSynced": True,
            }


def _column(panels: list[str]) -> str | Mapping[str, Any] | None:
    """Stack panels, each of the same height."""
    if len(panels) <= 1:
        return panels[0] if panels else None
    return {
        "direction": "column",
        "first": panels[0],
        "second": _column(panels[1:]),
        "splitPercentage": 100 / len(panels),
    }

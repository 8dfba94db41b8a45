"""Every field that a layout plots is in the recording, by its own schema and its messages."""

import json
import re

import pytest
from mcap.reader import make_reader

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import (
    Event,
    Features,
    Health,
    Mode,
    Quality,
    TwinState,
)
from slowtime_schemas.quantities import Estimate, Quantity
from slowtime_schemas.streams import EVENT, FEATURES, HEALTH, STATE
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import contents, layout_of

T_NS = 1_700_000_000_000_000_000
WHO = {"site": "lab", "asset": "beam-2", "boot": "b", "t_ns": T_NS, "sequence": 0}
SOME = Estimate(value=-0.1, sd=0.01, lo=-0.12, hi=-0.08)
MODE = Mode(frequency_hz=Quantity(value=3.0, sd=0.1), damping_ratio=Quantity(value=0.02, sd=0))


def messages(asset):
    who = WHO | {"asset": asset}
    quality = Quality(samples=9)
    yield (
        FEATURES,
        Features(
            **who,
            start_ns=T_NS,
            slow_time=0.0,
            method="ambient",
            modes=(MODE,),
            quality=quality,
        ),
    )
    yield HEALTH, Health(**who, last_sequence=0, first_held=0, uptime_s=1.0)
    yield STATE, TwinState(
        **who, id=f"lab.{asset}", slow_time=0.0, frequency_hz=SOME, damping_ratio=SOME,
        stiffness_change=SOME, mass_change=SOME, valid=True,
    )  # fmt: skip
    yield EVENT, Event(**who, kind="alarm", severity="alarm", message="It bends.")


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "house.mcap"
    with RecordingWriter(path) as writer:
        for asset in ("beam-2", "mast"):
            for stream, message in messages(asset):
                writer.write(stream, "lab", asset, encode(message), T_NS)
    return path


def panels_of(layout):
    """Panels in the order in which they are laid out."""
    found = []

    def walk(node):
        if isinstance(node, str):
            found.append(node)
            for tab in layout["configById"][node].get("tabs", ()):
                walk(tab["layout"])
        else:
            assert node["direction"] in ("row", "column")
            assert 0 < node["splitPercentage"] < 100
            walk(node["first"])
            walk(node["second"])

    walk(layout["layout"])
    return found


def paths_of(layout):
    for name, panel in layout["configById"].items():
        if "topicPath" in panel:
            yield name, panel["topicPath"]
        for path in panel.get("paths", ()):
            yield name, path["value"]


def steps(path):
    return [int(step) if step.isdigit() else step for step in re.findall(r"\w+", path)]


def by_schema(schema, path):
    for step in steps(path):
        schema = schema["items"] if isinstance(step, int) else schema["properties"][step]
    return schema


def test_what_is_plotted_is_there_by_schema_and_by_message(recording):
    layout = layout_of(list(contents(recording).counts))
    with recording.open("rb") as file:
        read = {c.topic: (s, m.data) for s, c, m in make_reader(file).iter_messages()}
    plotted = list(paths_of(layout))
    assert len(plotted) == 2 * 18
    for name, path in plotted:
        topic, _, field = path.partition(".")
        schema, data = read[topic]
        assert schema is not None
        assert schema.encoding == "jsonschema"
        assert re.fullmatch(r"[\w/-]+", topic), "a path of Foxglove ends at the first dot"
        kind = by_schema(json.loads(schema.data), field)["type"]
        wanted = {"Plot": ("number", "integer"), "StateTransitions": ("boolean",)}
        assert kind in wanted.get(name.partition("!")[0], ("object",))
        value = json.loads(data)
        for step in steps(field):
            value = value[step]
        assert value is not None


def test_every_panel_is_laid_out_once(recording):
    layout = layout_of(list(contents(recording).counts))
    assert sorted(panels_of(layout)) == sorted(layout["configById"])
    titles = [tab["title"] for tab in layout["configById"]["Tab!assets"]["tabs"]]
    assert titles == ["lab.beam-2", "lab.mast"]


def test_what_is_not_in_a_recording_is_not_plotted():
    only = layout_of([HEALTH.key("lab", "beam")])
    assert [path for _, path in paths_of(only)] == [
        "slowtime/v2/lab/health/174/beam.last_sequence",
        "slowtime/v2/lab/health/174/beam.dropped",
    ]  # fmt: skip
    with pytest.raises(ValueError, match="nothing to plot"):
        layout_of([])

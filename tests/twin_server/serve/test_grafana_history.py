"""Each query of the dashboard of histories, sent to a server and selected as Grafana does."""

import datetime
import json
import re
from pathlib import Path

import pytest
import yaml

FOLDER = Path(__file__).parents[3] / "services/grafana/history"
DASHBOARD = json.loads((FOLDER / "dashboard.json").read_text())
DATA_SOURCE = yaml.safe_load((FOLDER / "datasource.yml").read_text())["datasources"][0]
VARIABLE = DASHBOARD["templating"]["list"][0]
ALARMS = DASHBOARD["annotations"]["list"][0]
PANELS = {panel["title"]: panel["targets"][0] for panel in DASHBOARD["panels"]}
TARGETS = {
    **PANELS, "alarms": ALARMS["target"], "twins": VARIABLE["query"]["infinityQuery"],
}  # fmt: skip
TYPES: dict[str, type | tuple[type, ...]] = {
    "timestamp_epoch": (int, float),
    "number": (int, float),
    "string": str,
}


def selected(server, target):
    """Rows of a query: its address with the variables of Grafana, its root by JSONata."""
    jsonata = pytest.importorskip("jsonata")
    known = {
        "twin": "lab.beam",
        "__from:date:iso": "2026-01-01T00:00:00.000Z",
        "__to:date:iso": "2026-01-02T00:00:00.000Z",
    }
    url = re.sub(r"\$\{([^}]+)\}", lambda found: known[found.group(1)], target["url"])
    answer = server.client.get(url)
    assert answer.status_code == 200, answer.text
    rows = jsonata.Jsonata(target["root_selector"]).evaluate(answer.json())
    return rows if isinstance(rows, list) else [rows]


@pytest.mark.parametrize("name", sorted(TARGETS.keys() - {"alarms"}))
def test_every_row_has_the_columns_of_its_query(server, name):
    target = TARGETS[name]
    rows = selected(server, target)
    assert rows
    for row in rows:
        for column in target["columns"]:
            assert isinstance(row[column["selector"]], TYPES[column["type"]])


def test_values_and_times_are_those_of_the_history(server):
    points = server.get("/api/v1/twins/lab.beam/history").json()["points"]
    rows = selected(server, PANELS["Change of stiffness"])
    assert [row["value"] for row in rows] == [
        one["stiffness_change"]["value"] for one in points
    ]
    assert [row["hi"] for row in rows] == [one["stiffness_change"]["hi"] for one in points]
    first = datetime.datetime.fromtimestamp(rows[0]["time"] / 1e3, datetime.UTC)
    assert first == datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def test_alarms_alone_are_annotations(server):
    events = server.get("/api/v1/twins/lab.beam/events").json()["events"]
    alarms = [one["message"] for one in events if one["severity"] == "alarm"]
    rows = [one for one in selected(server, ALARMS["target"]) if one is not None]
    assert [one["text"] for one in rows] == alarms


def test_dashboard_and_data_source_belong_together():
    wanted = {"type": DATA_SOURCE["type"], "uid": DATA_SOURCE["uid"]}
    for one in (VARIABLE, ALARMS, *DASHBOARD["panels"], *TARGETS.values()):
        assert one["datasource"] == wanted
    for target in TARGETS.values():
        assert (target["type"], target["parser"], target["source"]) == (
            "json",
            "backend",
            "url",
        )

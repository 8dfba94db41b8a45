"""What docs/watching.md says of metrics, routes and names is so."""

import json
import re
from pathlib import Path

from slowtime_services import tracing
from slowtime_services.client import Client
from twin_server.serve.access import POLICY
from twin_server.settings import ServeSettings

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs/watching.md").read_text()


def test_what_it_links_to_is_there():
    links = [link for link in re.findall(r"\]\(([^)]+)\)", TEXT) if "://" not in link]
    assert len(links) > 6
    assert [link for link in links if not (ROOT / "docs" / link).exists()] == []


def test_every_route_and_setting_that_it_names_is_one():
    routes = {rule.path for rule in POLICY}
    named = {path.replace("{id}", "{twin_id}") for path in re.findall(r"`(/[\w./{}]+)`", TEXT)}
    assert len(named) >= 5
    assert named <= routes
    settings = set(re.findall(r"`serve\.(\w+)`", TEXT))
    assert settings
    assert settings <= set(ServeSettings.model_fields)
    assert set(re.findall(r"OTEL_\w+", TEXT)) <= set(tracing.ASKED_BY)
    for method in re.findall(r"client\.(\w+)\(", TEXT):
        assert hasattr(Client, method)


def test_every_panel_and_column_that_it_names_is_on_the_dashboard():
    told = json.loads((ROOT / "services/grafana/dashboards/slowtime.json").read_text())
    titles = {panel["title"] for panel in told["panels"]}
    quoted = set(re.findall(r'table "([^"]+)"', TEXT))
    assert quoted
    assert quoted <= titles
    for kind in ("Change of stiffness", "Change of mass", "Natural frequency", "Damping ratio"):
        assert kind in titles


def test_every_extra_that_it_names_is_one():
    project = (ROOT / "pyproject.toml").read_text()
    extras = set(re.findall(r"slowtime\[(\w+)\]", TEXT))
    assert extras == {"telemetry", "parquet"}
    assert all(re.search(rf"^{extra} = \[", project, re.M) for extra in extras)

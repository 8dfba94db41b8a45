"""Dashboard and alerts ask for what the server tells, under the names it tells it by."""

import json
import re
import shutil
import socket
import subprocess
import time
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families

ROOT = Path(__file__).parents[3]
GRAFANA, PROMETHEUS = ROOT / "services/grafana", ROOT / "services/prometheus"
DASHBOARD = json.loads((GRAFANA / "dashboards/slowtime.json").read_text())
ALERTS = yaml.safe_load((PROMETHEUS / "alerts.yml").read_text())
COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())

NEEDS_TROUBLE = ("events_total",)
"""What a server without an event in its life tells nothing of."""


def panels():
    return [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]


def expressions():
    asked = [target["expr"] for panel in panels() for target in panel["targets"]]
    return asked + [rule["expr"] for rule in ALERTS["groups"][0]["rules"]]


@pytest.fixture(scope="module")
def house(beam_and_frame):
    return beam_and_frame(changes="both")


@pytest.fixture(scope="module")
def told(house):
    """Names of all series, and of their labels."""
    text = house.get("/metrics").text
    found: dict[str, set[str]] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, set()).update(sample.labels)
    return found


def test_everything_that_is_asked_for_is_told(told):
    for expression in expressions():
        for name, labels in re.findall(r"(slowtime_\w+)(?:\{([^}]*)\})?", expression):
            assert name in told, expression
            asked = re.findall(r"(\w+)=~?\"", labels)
            assert set(asked) <= told[name], expression
    for panel in panels():
        for target in panel["targets"]:
            (name, *_) = re.findall(r"slowtime_\w+", target["expr"])
            said = set(re.findall(r"\{\{(\w+)\}\}", target.get("legendFormat", "")))
            assert said <= told[name], target["legendFormat"]


def test_every_metric_of_an_asset_is_on_the_dashboard_or_an_alert(told):
    shown = set(re.findall(r"slowtime_asset_\w+", " ".join(expressions())))
    of_assets = {name for name in told if name.startswith("slowtime_asset_")}
    assert of_assets - shown == {
        "slowtime_asset_slow_time", "slowtime_asset_reading_timestamp_seconds",
    }  # fmt: skip


def test_every_panel_says_what_it_shows_and_has_a_place_of_its_own():
    taken: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        at = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(at["x"], at["x"] + at["w"])
            for y in range(at["y"], at["y"] + at["h"])
        }
        assert not cells & taken
        assert max(x for x, _ in cells) < 24
        taken |= cells
    assert all(panel["description"] and panel["title"] for panel in panels())
    ids = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(set(ids)) == len(ids)


def test_the_containers_find_what_is_provisioned():
    source = yaml.safe_load((GRAFANA / "provisioning/datasources/prometheus.yml").read_text())
    (source,) = source["datasources"]
    assert {panel["datasource"]["uid"] for panel in panels()} == {source["uid"]}
    services = COMPOSE["services"]
    assert urlsplit(source["url"]).hostname in services
    (job,) = yaml.safe_load((PROMETHEUS / "prometheus.yml").read_text())["scrape_configs"]
    (target,) = job["static_configs"][0]["targets"]
    host, _, port = target.partition(":")
    assert host in json.loads(services[host]["environment"]["SLOWTIME_TWIN_ACCESS__HOSTS"])
    assert services[host]["ports"][0].endswith(f":{port}")
    (provider,) = yaml.safe_load(
        (GRAFANA / "provisioning/dashboards/slowtime.yml").read_text()
    )["providers"]
    mounted = [volume.split(":")[:2] for volume in services["grafana"]["volumes"]]
    assert ["./services/grafana/dashboards", provider["options"]["path"]] in mounted
    for service in services.values():
        for volume in service.get("volumes", ()):
            if volume.startswith("./"):
                assert (ROOT / volume.split(":")[0]).exists()
    pinned = re.compile(r"[\w./-]+:v?\d+\.\d+\.\d+")
    assert all(pinned.fullmatch(services[name]["image"]) for name in ("grafana", "prometheus"))


@pytest.mark.slow
def test_promtool_finds_nothing_to_say(house):
    if (promtool := shutil.which("promtool")) is None:
        pytest.skip("promtool is not here; Debian has it in the package prometheus")
    config = str(PROMETHEUS / "prometheus.yml")
    subprocess.run([promtool, "check", "config", config], check=True, capture_output=True)
    text = house.get("/metrics").text
    checked = subprocess.run(
        [promtool, "check", "metrics"], input=text, text=True, capture_output=True, check=False
    )
    assert (checked.returncode, checked.stdout + checked.stderr) == (0, "")


@pytest.mark.slow
def test_prometheus_itself_answers_every_question_of_the_dashboard(house, tmp_path, unused):
    if (prometheus := shutil.which("prometheus")) is None:
        pytest.skip("prometheus is not here; Debian has it in the package prometheus")
    text = (PROMETHEUS / "prometheus.yml").read_text()
    text = text.replace("twin:8000", house.url.removeprefix("http://"))
    (tmp_path / "prometheus.yml").write_text(text.replace("5s", "1s"))
    shutil.copy(PROMETHEUS / "alerts.yml", tmp_path)
    at = f"127.0.0.1:{unused}"
    with subprocess.Popen(
        [prometheus, f"--config.file={tmp_path}/prometheus.yml", f"--web.listen-address={at}",
         f"--storage.tsdb.path={tmp_path}/data"], stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        try:
            assert _answers(at)
            left, deadline = expressions(), time.monotonic() + 300
            while left and time.monotonic() < deadline:
                time.sleep(1)
                left = [expression for expression in left if not _result(at, expression)]
        finally:
            process.terminate()
    assert [e for e in left if not any(word in e for word in NEEDS_TROUBLE)] == []


def _result(at, expression):
    """Series of a question; of an alert, of what it compares with its limit."""
    asked = expression.replace("$twin", ".*").replace("$__rate_interval", "20s")
    asked = re.sub(r"(== 0|> \d+)$", "", asked)
    answer = httpx.get(f"http://{at}/api/v1/query", params={"query": asked}).json()
    assert answer["status"] == "success", (expression, answer)
    return answer["data"]["result"]


def _answers(at: str, patience_s: float = 30.0) -> bool:
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        try:
            if httpx.get(f"http://{at}/-/ready").status_code == 200:
                return True
        except httpx.HTTPError:
            pass
        time.sleep(0.2)
    return False


@pytest.fixture
def unused():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]

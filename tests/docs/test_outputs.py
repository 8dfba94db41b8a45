"""The page on outputs: its settings are accepted, its names are those that are sent."""

import re
import tomllib
from pathlib import Path

from slowtime_services.outputs import OutputsSettings
from slowtime_services.outputs.receivers import KINDS
from slowtime_services.outputs.settings import MqttSettings, OpcUaSettings

PAGE = (Path(__file__).parents[2] / "docs/outputs.md").read_text()
BLOCKS = [tomllib.loads(text) for text in re.findall(r"^```toml\n(.*?)^```", PAGE, re.M | re.S)]


def test_every_example_is_accepted():
    kinds = {
        one.kind
        for block in BLOCKS
        for one in OutputsSettings.model_validate(block).outputs.values()
    }
    assert kinds == {"mqtt", "sparkplug", "influx"}


def test_every_kind_has_a_section():
    assert set(re.findall(r'^`kind = "(\w+)"`', PAGE, re.M)) == set(KINDS)


def test_defaults_are_those_of_the_settings():
    one = OpcUaSettings(kind="opcua")
    assert OutputsSettings.model_fields["server"].default in PAGE
    assert f"opc.tcp://{one.host}:{one.port}/slowtime/" in PAGE
    for name in ("backoff_s", "max_backoff_s", "timeout_s"):
        assert f"`{name}` ({getattr(one, name):g})" in PAGE
    assert MqttSettings(kind="mqtt", host="127.0.0.1").prefix == "slowtime"

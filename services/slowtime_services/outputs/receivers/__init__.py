"""The outputs: one module for each kind of receiver."""

from collections.abc import Callable, Mapping
from typing import Any

from slowtime_services.outputs.batch import Output

from .influx import InfluxOutput
from .mqtt_json import MqttOutput
from .opc_ua import OpcUaOutput
from .sparkplug import SparkplugOutput

KINDS: Mapping[str, Callable[[str, Any], Output]] = {
    "mqtt": MqttOutput,
    "sparkplug": SparkplugOutput,
    "influx": InfluxOutput,
    "opcua": OpcUaOutput,
}
"""Kind of the settings → what sends, made of a name and settings."""


def make_output(name: str, settings: Any) -> Output:
    """Make what sends to a receiver.

    Raises
    ------
    NotSentError
        Where its library is not installed.
    """
    return KINDS[settings.kind](name, settings)

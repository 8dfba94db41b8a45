"""Configurations by which Home Assistant finds the sensors of a twin.

References
----------
Home Assistant, "MQTT", section "MQTT discovery": topics PREFIX/COMPONENT/OBJECT/NAME/config,
retained; device, availability, state class and device class of sensors.
"""

import json
import re
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from slowtime_services.outputs.batch import Batch
from slowtime_services.outputs.quantities import Quantity, quantities_of

_DIGITS = {"Hz": 4, "%": 3}
"""Decimal places that are shown; standard deviations of frequencies are some 1e-4 Hz."""


def configurations_of(batch: Batch, prefix: str, base: str, bridge: str) -> dict[str, str]:
    """Return topic → configuration of each sensor of a twin.

    Parameters
    ----------
    prefix
        Of discovery.
    base, bridge
        Topics of the twin, and of the output's own availability.
    """
    shared: dict[str, Any] = {
        "device": _device(batch),
        "availability": [
            {"topic": bridge},
            {
                "topic": f"{base}/status",
                "value_template": "{{ 'online' if value_json.alive else 'offline' }}",
            },
        ],
        "availability_mode": "all",
    }
    owner = _plain(f"slowtime_{batch.site}_{batch.asset}")
    found = {}
    for quantity in quantities_of(batch.twin):
        name = _plain(quantity.name)
        told = _sensor(quantity, f"{base}/state") | {"unique_id": f"{owner}_{name}"} | shared
        found[f"{prefix}/sensor/{owner}/{name}/config"] = json.dumps(told)
    alarm = {
        "name": "Alarm",
        "unique_id": f"{owner}_alarm",
        "device_class": "problem",
        "state_topic": f"{base}/status",
        "value_template": "{{ 'ON' if value_json.raised else 'OFF' }}",
        "json_attributes_topic": f"{base}/status",
    }
    found[f"{prefix}/binary_sensor/{owner}/alarm/config"] = json.dumps(alarm | shared)
    return found


def _sensor(quantity: Quantity, topic: str) -> dict[str, Any]:
    """Describe a sensor; ratios are shown in percent."""
    unit = quantity.unit or "%"
    factor = "" if quantity.unit else " * 100"
    told = f"value_json['{quantity.name}']"
    sensor = {
        "name": quantity.label,
        "state_topic": topic,
        "value_template": f"{{{{ {told}.value{factor} if {told} else none }}}}",
        "json_attributes_topic": topic,
        "json_attributes_template": f"{{{{ {told} | tojson if {told} else '{{}}' }}}}",
        "unit_of_measurement": unit,
        "state_class": "measurement",
        "suggested_display_precision": _DIGITS[unit],
    }
    return sensor | ({"device_class": "frequency"} if unit == "Hz" else {})


def _device(batch: Batch) -> dict[str, Any]:
    return {
        "identifiers": [f"slowtime_{batch.twin.id}"],
        "name": batch.twin.registration.get("name") or batch.twin.id,
        "manufacturer": "slowtime",
        "model": "Digital twin",
        "sw_version": _version(),
    }


def _version() -> str:
    try:
        return version("slowtime")
    except PackageNotFoundError:
        return "unknown"


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]", "_", text)

"""The simulated structures of the demo: what they are, and how their twins are registered.

Slow time runs in periods of the structure, T0, as in chapter 5 of the book; an epoch of half a
minute or more of vibration is heard after every period, so that a life of a thousand periods
passes in a few minutes.
"""

import hashlib
from collections.abc import Mapping
from typing import Any

AMBIENT = {"excitation": "ambient", "seconds": 60.0, "rate_hz": 50.0}
HAMMER = {"excitation": "hammer", "seconds": 20.0, "rate_hz": 50.0}
FATIGUE = {"kind": "fatigue", "renewed_after": 1000.0}
FILLING = {"kind": "filling"}

STRUCTURES: Mapping[str, Mapping[str, Any]] = {
    "tower": {
        **AMBIENT,
        "frequency_hz": 5.0,
        "damping_ratio": 0.01,
        "mass_kg": 2000.0,
        "stiffness": FATIGUE,
        "sensor": {"noise": 0.1, "spikes_per_epoch": 0.05, "dropouts_per_epoch": 0.02},
    },
    "tank": {
        **AMBIENT,
        "frequency_hz": 4.0,
        "damping_ratio": 0.015,
        "mass_kg": 800.0,
        "mass": FILLING,
        "sensor": {"noise": 0.1},
    },
    "wing": {
        **HAMMER,
        "frequency_hz": 6.0,
        "damping_ratio": 0.02,
        "mass_kg": 50.0,
        "stiffness": FATIGUE,
        "mass": FILLING,
        "sensor": {"noise": 0.02},
    },
}
"""Name → what `slowtime_services.simulate.SimulatedStructure` is given."""

CHANGES = {"tower": "stiffness", "tank": "mass", "wing": "both"}


def structure(name: str) -> dict[str, Any]:
    """Fields of a demo structure, with a seed of its own."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little")
    return {**STRUCTURES[name], "seed": seed}


def registration(name: str) -> dict[str, Any]:
    """Tell what a demo structure's twin knows beforehand: how it was built, what may change.

    The damping coefficient of the simulated wing never changes, and its twin is told so. On a
    real structure it does, and mass and stiffness are known no better than it is.
    """
    built = STRUCTURES[name]
    body: dict[str, Any] = {
        "changes": CHANGES[name],
        "nominal": {
            "frequency_hz": built["frequency_hz"],
            "damping_ratio": built["damping_ratio"],
        },
    }
    if name == "wing":
        body["damping_coefficient_sd"] = 0.0
    return body

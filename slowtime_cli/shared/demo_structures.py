"""The simulated structures of the demo, and the registrations of their twins.

Each is heard once a day of its own calendar, for some minutes or for a blow of a hammer, and a
second of the demo is some days of that calendar (`EPOCHS_PER_S`): a life of three years passes
in a few minutes.
"""

import hashlib
from collections.abc import Mapping
from typing import Any

DAILY = {"slow_time_unit": "d", "interval_s": 86400.0}
AMBIENT = {**DAILY, "excitation": "ambient", "seconds": 60.0, "rate_hz": 50.0}
HAMMER = {**DAILY, "excitation": "hammer", "seconds": 20.0, "rate_hz": 50.0}
FATIGUE = {"kind": "fatigue", "renewed_after": 1000.0}
FILLING = {"kind": "filling"}
WEATHER = {
    "mean_c": 8.0,
    "swing_c": 14.0,
    "daily_c": 4.0,
    "period": 365.0,
    "stiffness_per_c": -0.002,
    "stiffness_per_c_below": -0.008,
}
CRACKING = {"kind": "step", "at_slow_time": 400.0, "change": -0.03, "renewed_after": 1460.0}
WEAKENING = {
    "kind": "linear",
    "rate": -2e-3,
    "limit": -0.25,
    "begins": 30.0,
    "renewed_after": 300.0,
}

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
    "frame": {
        **DAILY,
        "kind": "frame",
        "seconds": 120.0,
        "rate_hz": 50.0,
        "floors_kg": [1000.0, 1000.0, 800.0],
        "storeys_n_per_m": [1.2e6, 1.0e6, 0.8e6],
        "damping_ratio": 0.01,
        "stiffness": {"storey2": WEAKENING},
        "sensor": {"noise": 0.1},
    },
    "bridge": {
        **AMBIENT,
        "seconds": 300.0,
        "rate_hz": 20.0,
        "frequency_hz": 3.0,
        "damping_ratio": 0.01,
        "mass_kg": 40000.0,
        "stiffness": CRACKING,
        "temperature": WEATHER,
        "sensor": {"noise": 0.1},
    },
}
"""Name → what a structure of `slowtime_services.simulate` is given."""

CHANGES = {
    "tower": "stiffness",
    "tank": "mass",
    "wing": "both",
    "frame": "elements",
    "bridge": "stiffness",
}

METHODS = {
    "tower": "ambient",
    "tank": "ambient",
    "wing": "free_decay",
    "frame": "modes",
    "bridge": "ambient",
}
"""How each is identified at the edge."""

LIMITS = {
    "tower": ("stiffness_change", -0.3),
    "wing": ("stiffness_change", -0.3),
    "frame": ("elements", -0.2),
    "bridge": ("stiffness_change", -0.1),
}
"""Change below which an alarm is raised, and whose time is forecast."""

THRESHOLDS = {"tank": ("mass_change", 0.2)}
"""Change whose time is forecast, and which is no alarm: a full tank is what a tank is for."""

HORIZON = 200.0
"""How far ahead is forecast, in slow time: also right after a renewal, when little is known."""

REPEATING = ("tank", "wing")
"""Known to come again: what is filled is emptied, and that is no change of the model."""

EPOCHS_PER_S = {"tower": 5.0, "tank": 5.0, "wing": 5.0, "frame": 1.0, "bridge": 5.0}
"""[days/s] How fast each grows old; all modes of three channels take most of a second."""


def structure(name: str) -> dict[str, Any]:
    """Fields of a demo structure, with a seed of its own."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little")
    return {**STRUCTURES[name], "seed": seed}


def registration(name: str) -> dict[str, Any]:
    """Return the registration of a demo structure's twin: nominal model, free parameters.

    The damping coefficient of the simulated wing never changes, and its twin is told so. On a
    real structure it does, and mass and stiffness are known no better than it is. The bridge's
    twin is told nothing but to learn for a year what the temperature does.
    """
    built = STRUCTURES[name]
    asked: dict[str, Any] = {"process": "repeating"} if name in REPEATING else {}
    asked["horizon"] = HORIZON
    common: dict[str, Any] = {"changes": CHANGES[name], "forecast": asked}
    if name in THRESHOLDS:
        quantity, at = THRESHOLDS[name]
        asked["thresholds"] = [{"quantity": quantity, "at": at}]
    if name in LIMITS:
        quantity, below = LIMITS[name]
        common["alarms"] = [{"quantity": quantity, "below": below}]
    if name == "frame":
        model = _model(structure(name))
        return {**common, "model": model}
    if name == "bridge":
        a_year = {"train_span": WEATHER["period"] - 1.0, "train_epochs": 300}
        return {**common, "covariates": {"names": ["temperature_c"], **a_year}}
    body: dict[str, Any] = {
        **common,
        "nominal": {
            "frequency_hz": built["frequency_hz"],
            "damping_ratio": built["damping_ratio"],
        },
    }
    if name == "wing":
        body["damping_coefficient_sd"] = 0.0
    if name == "tower":
        body |= _owned()
    return body


def _owned() -> dict[str, Any]:
    """Return the demo owner's failure limit, costs, and possible actions."""
    return {
        "limit_states": [
            {
                "kind": "threshold",
                "name": "35 % softer",
                "quantity": "stiffness_change",
                "below": -0.35,
                "accepted": 0.01,
            },
            {
                "kind": "response",
                "name": "sway in a storm",
                "load": {
                    "kind": "noise",
                    "psd": 0.02,
                    "low_pass_hz": 5.0,
                    "intensity": {"marginal": "gumbel", "mean": 1.0, "sd": 0.3},
                },
                "response": {
                    "quantity": "displacement",
                    "node": "mass",
                    "statistic": "peak",
                    "duration_s": 600.0,
                },
                "capacity": {"marginal": "lognormal", "mean": 0.05, "sd": 0.008},
                "events": 0.02,
                "accepted": 0.05,
            },
        ],
        "costs": {
            "currency": "EUR",
            "time_unit": "slow_time",
            "failure": {"mean": 900_000.0, "sd": 200_000.0},
            "repair": 40_000.0,
            "inspection": 1_500.0,
        },
        "decision": {
            "failure": {"quantity": "stiffness_change", "below": -0.35},
            "horizon": 300.0,
            "inspection": {"name": "survey", "sd": 0.01},
        },
    }


def _model(fields: dict[str, Any]) -> dict[str, Any]:
    """Describe a frame as built, each floor with its accelerometer, as a model file does."""
    from slowtime_services.models import model_file_of
    from slowtime_services.simulate import SimulatedFrame

    model = model_file_of(SimulatedFrame(**fields).description)
    return model.model_dump(mode="json", exclude_defaults=True)

"""The scenario: a house, its weather, its ageing, and an effect that is drawn from a seed."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_services.simulate import ORIGIN_NS

YEAR = 365.25
"""Days of a year."""
YEARS = 10
SECONDS, RATE_HZ = 60.0, 40.0
"""Length [s] and rate [Hz] of a record: 130 periods of the lowest mode, and nearly four samples
a period of the highest."""
MOST_RECORDS_PER_S = 5.0
"""Records that are measured, sent, recorded and estimated in a second of the sped-up run."""
ASSET = "house"
TWIN = f"demo.{ASSET}"

FLOORS_KG = (1000.0, 1000.0, 1000.0, 800.0)
STOREYS_N_PER_M = (1.6e6, 1.4e6, 1.2e6, 1.0e6)
DAMPING_S = 1.5e-3
"""Damping over stiffness of a storey [s]: 1 % of the lowest mode."""
INPUT_RMS_N = 500.0
NOISE = 0.02
"""Noise of a sensor over what it shows [1]."""
AGEING_PER_DAY = -0.004 / YEAR
"""Relative change of the stiffness of all storeys: 4 % are gone after ten years."""
WEATHER = {
    "mean_c": 10.0,
    "swing_c": 14.0,
    "daily_c": 3.0,
    "period": YEAR,
    # Young's modulus of steel falls by 0.04 to 0.05 % per kelvin near room temperature.
    "stiffness_per_c": -0.00045,
}

ON_ELEMENTS = ("coulomb", "cubic_hardening", "gap_symmetric")
BETWEEN_NODES = ("missing_spring", "quadratic_damping")
KINDS = (*ON_ELEMENTS, *BETWEEN_NODES, "added_mass", "sensor_delay")
"""Effects that may enter; the last one is a fault of a sensor."""
UNJOINED = (
    ("base", "floor2"), ("base", "floor3"), ("base", "floor4"),
    ("floor1", "floor3"), ("floor1", "floor4"), ("floor2", "floor4"),
)  # fmt: skip
"""Pairs of points that no element of the model joins."""
OUTSIDE = "outside"
"""Element by which the simulator joins two of them; the twin's model has none there."""


FAILED = -0.1
"""Change of stiffness that counts as a failure [1]."""
POLICY: Mapping[str, Any] = {
    "samples_s": SECONDS,
    "holdout_s": SECONDS / 3.0,
    "adopt_above": 0.9,
    "adopt_undecided": True,
    "undo_after": 5,
}
"""What the twin may do without a person: see `DisagreementPolicy`. A diagnosis is made of one
record, since the temperature and with it the stiffness change from one record to the next."""


@dataclasses.dataclass(frozen=True, slots=True)
class HiddenEffect:
    """The effect that enters, where and when.

    Parameters
    ----------
    entry
        As a model file has it under `effects`, for the simulator.
    place
        Where a diagnosis should find it: a storey, a floor, a sensor, or two joined points.
    between
        The two points, where no element of the model joins them; None on an element.
    enters, leaves
        Years after the first record.
    """

    entry: Mapping[str, Any]
    place: str
    between: tuple[str, str] | None
    enters: float
    leaves: float

    @property
    def kind(self) -> str:
        """Name of the effect in the catalogue."""
        return str(self.entry["effect"])

    @property
    def is_sensor_fault(self) -> bool:
        """Whether a sensor is wrong, and not the structure."""
        return self.kind == "sensor_delay"


@dataclasses.dataclass(frozen=True, slots=True)
class Scenario:
    """All that decides what the sensors of a run measure.

    Parameters
    ----------
    seed
        Decides the effect, its place and size, weather and noise.
    records
        How many are measured in the ten years.
    every_s
        From one record to the next, by the clock of the run [s].
    real_time
        Whether the sensor's own clock runs as fast as the run's: records follow each other.
    """

    seed: int
    records: int
    every_s: float
    real_time: bool
    effect: HiddenEffect

    @property
    def days_per_record(self) -> float:
        """Days of the calendar from one record to the next."""
        return YEARS * YEAR / self.records

    def record_at(self, years: float) -> int:
        """Return the number of the first record at or after a time."""
        return int(np.ceil(years * YEAR / self.days_per_record))


def scenario(seed: int, duration_s: float, *, real_time: bool = False) -> Scenario:
    """Draw the scenario of a seed.

    Parameters
    ----------
    seed
        Not negative.
    duration_s
        How long the ten years are to last [s].
    real_time
        Whether a record takes as long as it measures, instead of a fraction of a second.

    Examples
    --------
    >>> one = scenario(3, 600.0)
    >>> one.records, one == scenario(3, 600.0)
    (3000, True)
    """
    least_s = SECONDS if real_time else 1.0 / MOST_RECORDS_PER_S
    records = max(min(int(duration_s / least_s), round(YEARS * YEAR)), 100)
    return Scenario(seed, records, max(duration_s / records, least_s), real_time, _drawn(seed))


def _drawn(seed: int) -> HiddenEffect:
    # Of seven seeds in a row that begin at a multiple of seven, each has another kind.
    order = np.random.default_rng([seed // len(KINDS), 59]).permutation(KINDS)
    kind = str(order[seed % len(KINDS)])
    rng = np.random.default_rng([seed, 60])
    size = float(rng.uniform(0.8, 1.25))
    storey = int(rng.integers(len(FLOORS_KG)))
    pair = UNJOINED[int(rng.integers(len(UNJOINED)))]
    enters, leaves = 3.0 + float(rng.uniform(0.1, 0.8)), 7.0
    if kind in ON_ELEMENTS:
        place, entry = f"storey{storey + 1}", {"element": f"storey{storey + 1}"}
    elif kind in BETWEEN_NODES:
        place, entry = "-".join(pair), {"element": OUTSIDE}
    elif kind == "added_mass":
        place, entry = f"floor{storey + 1}", {"node": f"floor{storey + 1}"}
    else:
        place, entry = f"a{storey + 1}", {"sensor": f"a{storey + 1}"}
    return HiddenEffect(
        entry={"effect": kind, **entry, **_parameters(kind, size, storey)},
        place=place,
        between=pair if kind in BETWEEN_NODES else None,
        enters=enters,
        leaves=leaves,
    )


def _parameters(kind: str, size: float, storey: int) -> dict[str, float]:
    """Parameters that make an effect of 10 dB over the noise or more, if not much more."""
    stiffness = STOREYS_N_PER_M[storey]
    return {
        "coulomb": {"friction_n": 150.0 * size},
        "cubic_hardening": {"k3_n_per_m3": 0.1 * size * stiffness / ELONGATION_M**2},
        "gap_symmetric": {"kg_n_per_m": size * stiffness, "gap_m": 1.2 * ELONGATION_M},
        "missing_spring": {"k_n_per_m": 1e5 * size},
        "quadratic_damping": {"c2_n_s2_per_m2": 15_000.0 * size},
        "added_mass": {"dm_kg": 60.0 * size},
        "sensor_delay": {"delay_s": 0.02 * size},
    }[kind]


ELONGATION_M = 1e-3
"""Typical elongation of a storey under the exciter (root mean square) [m]."""


def model() -> dict[str, Any]:
    """Model file of the house as its twin knows it, as built."""
    floors = [f"floor{i}" for i in range(1, len(FLOORS_KG) + 1)]
    below = ["base", *floors[:-1]]
    return {
        "slowtime_model": 1,
        "name": "house",
        "nodes": [
            {"id": floor, "mass_kg": mass}
            for floor, mass in zip(floors, FLOORS_KG, strict=True)
        ],
        "elements": [
            {
                "id": f"storey{i}",
                "between": list(ends),
                "stiffness_n_per_m": stiffness,
                "damping_n_s_per_m": DAMPING_S * stiffness,
            }
            for i, (*ends, stiffness) in enumerate(
                zip(below, floors, STOREYS_N_PER_M, strict=True), 1
            )
        ],
        "inputs": [{"channel": "exciter", "kind": "force", "node": "floor1", "unit": "N"}],
        "sensors": [
            {
                "channel": f"a{i}",
                "quantity": "acceleration",
                "node": floor,
                "unit": "m/s^2",
            }
            for i, floor in enumerate(floors, 1)
        ],
        "tolerance": {"stiffness": 0.02, "damping": 0.15},
    }


def years_of(of: Scenario, t_ns: int) -> float:
    """Time on the calendar of a record that begins at an instant of the sensor's clock."""
    record = (t_ns - ORIGIN_NS) / (1e9 * _interval_s(of))
    return record * of.days_per_record / YEAR


def _interval_s(of: Scenario) -> float:
    return SECONDS if of.real_time else max(of.days_per_record * 86_400.0, SECONDS)


def structure(of: Scenario) -> dict[str, Any]:
    """Fields of the simulated house, as `slowtime_services.simulate` takes them."""
    real = model()
    rng = np.random.default_rng([of.seed, 61])
    for element in real["elements"]:  # not quite as its file says, within tolerance
        element["stiffness_n_per_m"] *= 1.0 + 0.01 * float(rng.standard_normal())
    if of.effect.between is not None:
        beside = {"id": OUTSIDE, "between": list(of.effect.between), "stiffness_n_per_m": 1e-6}
        real["elements"].append(beside)
    ageing = {"kind": "linear", "rate": AGEING_PER_DAY, "limit": -0.5}
    step = of.days_per_record
    return {
        "kind": "model",
        "model": real,
        "stiffness": {
            element["id"]: ageing for element in real["elements"] if element["id"] != OUTSIDE
        },
        "temperature": WEATHER,
        "effects": [dict(of.effect.entry)],
        "enters": of.record_at(of.effect.enters),
        "leaves": of.record_at(of.effect.leaves),
        "epochs": of.records,
        "seconds": SECONDS,
        "rate_hz": RATE_HZ,
        "slow_time_step": step,
        "slow_time_unit": "d",
        "interval_s": _interval_s(of),
        "input_rms": INPUT_RMS_N,
        "band_hz": [0.5, 15.0],
        "sensor": {"noise": NOISE},
        "seed": of.seed,
    }


def registration(of: Scenario) -> dict[str, Any]:
    """Return the registration: what is watched, what failing costs, what is done alone."""
    return {
        "name": "House of four storeys",
        "changes": "stiffness",
        "model": model(),
        "covariates": {
            "names": ["temperature_c"],
            "train_span": YEAR - of.days_per_record,
            "train_epochs": 30,
        },
        "forecast": {"horizon": 5 * YEAR},
        "alarms": [{"quantity": "stiffness_change", "below": FAILED}],
        "limit_states": [
            {
                "kind": "threshold",
                "name": "10 % softer",
                "quantity": "stiffness_change",
                "below": FAILED,
                "accepted": 0.01,
            }
        ],
        "costs": {
            "currency": "EUR",
            "time_unit": "slow_time",
            "failure": {"mean": 900_000.0, "sd": 200_000.0},
            "repair": 40_000.0,
            "inspection": 1_500.0,
        },
        "decision": {
            "failure": {"quantity": "stiffness_change", "below": FAILED},
            "horizon": 5 * YEAR,
            "inspection": {"name": "survey", "sd": 0.005},
        },
        "on_disagreement": dict(POLICY),
    }


def twin_settings() -> dict[str, Any]:
    """Return the settings of the twin server, as its file has them."""
    gap = {"every_s": 0.2, "seconds": SECONDS, "learn": 16, "refit": True, "kept": 5_000}
    return {"gap": gap}


def edge_settings(of: Scenario, hold: Path) -> dict[str, Any]:
    """Return the settings of the edge agent: samples, FFT, running median and average.

    Parameters
    ----------
    hold
        File while which exists a sped-up calendar stands still.
    """
    paced: dict[str, Any] = {"every_s": of.every_s}
    if not of.real_time:
        paced["hold"] = str(hold)
    return {
        "site": "demo",
        "asset": ASSET,
        "input": {"kind": "simulated", "structure": structure(of), **paced},
        "extract": {
            "method": "peak",
            "channels": [f"a{len(FLOORS_KG)}"],
            "band_hz": [1.0, 4.0],
            "median_window": 5,
            "ewma_a": 0.3,
        },
        "publish": {"raw": "on", "ring_s": 2 * SECONDS, "linger_s": 300.0},
    }

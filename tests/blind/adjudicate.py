"""Whether an effect could have been told from its rival at all: the rival is fitted to it.

A rival that can be made to say the same as the truth on the records, to less than chance
would, is equivalent on those data. Force laws of elements are fitted; what scales the whole
equation of a single mass is known without; other pairs are known by rule (`cases.equivalents`).
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from .answers import read_report
from .law import Placed
from .laws import LAWS
from .motion import Diverged
from .sensing import Sensor
from .world import Plan, World, from_json

Array = NDArray[np.float64]
ENOUGH = 9.0
"""Difference of chi-squared below which no one need have decided."""
ROWS = 800
DRAWS = 400
LEAST, MOST = 1e-5, 1e3
"""Bounds of a parameter over its scale."""
SHAPES: dict[str, tuple[tuple[str, str], ...]] = {
    "cubic_hardening": (("k3_n_per_m3", "k/e2"),),
    "cubic_softening": (("k3_n_per_m3", "-k/e2"),),
    "quadratic_stiffness": (("k2_n_per_m2", "+-k/e"),),
    "saturating_stiffness": (("ks_n_per_m", "k"), ("es_m", "e")),
    "gap_symmetric": (("kg_n_per_m", "k"), ("gap_m", "e")),
    "gap_one_sided": (("kg_n_per_m", "k"), ("gap_m", "e"), ("side", "+-1")),
    "coulomb": (("friction_n", "ke"),),
    "stribeck": (("friction_n", "ke"), ("static_n", "ke"), ("vs_m_per_s", "v")),
    "quadratic_damping": (("c2_n_s2_per_m2", "c/v"),),
    "viscous_damping": (("dc_n_s_per_m", "+-c"),),
    "van_der_pol": (("cn_n_s_per_m", "c"), ("e0_m", "e")),
    "stiffness_loss": (("dk_n_per_m", "+-k"),),
    "pendulum_sine": (("k", "k"),),
}
"""Parameters of the rivals that can be tried, and of what size they are."""
FIXED = ("side",)
SCALING = ("added_mass", "input_gain", "sensor_gain")
"""What scales the equation of a single mass."""


def adjudicate(out: Path, trial: str) -> None:
    """Try the rivals of every truth among those that a report left undecided."""
    for result in sorted((out / "results" / trial).iterdir()):
        report = read_report(result) or {}
        truth_file = out / "sealed" / result.name / "truth.json"
        truth = json.loads(truth_file.read_text())
        if report.get("verdict") != "undecided" or len(truth["effects"]) != 1:
            continue
        given = report.get("undecided") or []
        named = {str(e.get("effect")) if isinstance(e, dict) else str(e) for e in given}
        known_file = truth_file.with_name("equivalent.json")
        known = json.loads(known_file.read_text()) if known_file.exists() else {}
        true = truth["effects"][0]["effect"]
        rivals = named - {true} - set(known) - set(truth["equivalents"])
        if true not in named or not rivals:
            continue
        world, plans = from_json(truth["world"]), training_plans(truth)
        excess: dict[str, float] = {}
        if true in SHAPES:
            excess |= {
                rival: least_excess(world, plans, rival)
                for rival in sorted(rivals & set(SHAPES))
            }
        excess |= {rival: scaled_excess(world) for rival in sorted(rivals & set(scaled(world)))}
        if excess:
            known |= {
                rival: {"excess": one, "equivalent": one < ENOUGH}
                for rival, one in excess.items()
            }
            known_file.write_text(json.dumps(known, indent=1))


def training_plans(truth: dict[str, Any]) -> list[Plan]:
    """Give the plans of the records that a diagnosis may learn from."""
    plans = [Plan(**plan | {"band_hz": tuple(plan["band_hz"])}) for plan in truth["plans"]]
    return [plan for i, plan in enumerate(plans) if i != truth["held"]]


def scaled(world: World) -> dict[str, Placed]:
    """Give rivals that say exactly what the truth says, with other constants.

    One mass, pushed by a force that is measured, and heard by one accelerometer:
    :math:`(m + dm) a + c v + k x = f` is :math:`m a + g (c v + k x) = g f` with
    :math:`g = m / (m + dm)`, and that is the motion of a force told as too small, or too large;
    with an accelerometer told so, the same.
    """
    (true,) = world.effects
    heard = [sensor.quantity for sensor in world.sensors]
    if world.rig.size > 1 or world.driven != world.rig.nodes or heard != ["acceleration"]:
        return {}
    if true.law.name not in SCALING:
        return {}
    factor, node = _factor(world), world.rig.nodes[0]
    if true.law.name != "added_mass":
        more = {"dm_kg": world.rig.masses[0] * (1 / factor - 1)}
        return {"added_mass": Placed(LAWS["added_mass"], node, more)}
    places = {"input_gain": world.channels()[0], "sensor_gain": world.sensors[0].channel}
    return {n: Placed(LAWS[n], place, {"gain": factor}) for n, place in places.items()}


def _factor(world: World) -> float:
    """By what the truth makes a force larger than it is; see `scaled`."""
    (true,) = world.effects
    mass = world.rig.masses[0]
    if true.law.name == "added_mass":
        return mass / (mass + true.parameters["dm_kg"])
    return true.parameters["gain"]


def scaled_excess(world: World) -> float:
    """What the constants that go with a rival of `scaled` cost beyond what the truth's do."""
    (true,) = world.effects
    factor = _factor(world)
    bent = (factor if true.law.name == "added_mass" else 1 / factor) - 1
    (own,), (told,) = world.rig.elements, world.nominal.elements
    claimed = np.array([told.stiffness / own.stiffness, told.damping / own.damping]) - 1
    more = np.maximum((bent - claimed) ** 2 - claimed**2, 0.0)
    return float(np.sum(more / np.square(world.tolerance)))


def least_excess(
    world: World, plans: list[Plan], rival: str, evaluations: int = 25, enough: float = ENOUGH
) -> float:
    """Least chi-squared that a rival at the same place leaves of the noiseless truth.

    Stiffnesses and dampings may move, at the price that their tolerance asks. What chance
    adds to the chi-squared of both is the same, so this is their expected difference.
    """
    truth = _Noiseless(world, plans)
    place = world.effects[0].place
    sketch = _Sketch(world, plans, place, rival)
    best = np.inf
    for start in sketch.starts():
        begin = np.concatenate([start.free, start.bent])
        lower = np.repeat([LEAST / 10, -0.9], [len(start.free), len(start.bent)])
        upper = np.repeat([MOST * 10, 9.0], [len(start.free), len(start.bent)])

        def misfit(x: Array, start: "_Start" = start) -> Array:
            parameters = start.parameters(x[: len(start.free)])
            return truth.misfit(Placed(LAWS[rival], place, parameters), x[len(start.free) :])

        found = least_squares(
            misfit, begin, bounds=(lower, upper), x_scale=0.01 + np.abs(begin),
            diff_step=[1e-4] * len(begin), max_nfev=evaluations,
        )  # fmt: skip
        best = min(best, 2 * float(found.cost))
        if best < enough:
            break
    return best


class _Noiseless:
    """The truth without noise, and how far a rival is from it."""

    def __init__(self, world: World, plans: list[Plan]) -> None:
        self.world, self.plans = world, plans
        taken = [world.take(plan, noiseless=True) for plan in plans]
        self.rows = [np.arange(0, len(t.times), max(1, len(t.times) // ROWS)) for t in taken]
        self.weights = [
            np.sqrt(len(t.times) / len(rows)) / t.seen.noise
            for t, rows in zip(taken, self.rows, strict=True)
        ]
        self.outputs = [t.clean[rows] for t, rows in zip(taken, self.rows, strict=True)]
        pairs = list(zip(world.rig.elements, world.nominal.elements, strict=True))
        tolerance = np.repeat(world.tolerance, len(pairs))
        self.claimed = np.array(
            [b.stiffness / a.stiffness - 1 for a, b in pairs]
            + [b.damping / a.damping - 1 for a, b in pairs]
        )
        self.sd = tolerance

    def misfit(self, rival: Placed, bent: Array) -> Array:
        half = len(bent) // 2
        rig = self.world.rig.scaled((1 + bent[:half]).tolist(), (1 + bent[half:]).tolist())
        world = dataclasses.replace(self.world, rig=rig, effects=(rival,))
        # What the prior costs beyond what it costs the truth.
        prior = (
            np.sign(bent)
            * np.sqrt(np.maximum((bent - self.claimed) ** 2 - self.claimed**2, 0.0))
            / self.sd
        )
        parts = [prior]
        for plan, rows, weight, outputs in zip(
            self.plans, self.rows, self.weights, self.outputs, strict=True
        ):
            try:
                told = world.take(plan, noiseless=True).clean[rows]
            except Diverged:
                told = outputs + 1e3 / weight
            parts.append(((told - outputs) * weight).ravel())
        return np.concatenate(parts)


@dataclasses.dataclass(frozen=True)
class _Start:
    names: tuple[str, ...]
    scales: Array
    free: Array
    """Parameters over their scales."""
    bent: Array
    """Changes of the rig's stiffness and damping that go with them."""
    fixed: dict[str, float]

    def parameters(self, x: Array) -> dict[str, float]:
        values = dict(zip(self.names, (x * self.scales).tolist(), strict=True))
        return values | self.fixed


class _Sketch:
    """Starts for a rival: of many draws, those that copy the true force along the motion."""

    def __init__(self, world: World, plans: list[Plan], place: str, rival: str) -> None:
        self.rival = rival
        names = [element.id for element in world.rig.elements]
        column = self.column = names.index(place)
        self.elements = len(names)
        element = world.rig.elements[column]
        states = _everything_heard(world)
        e, v = [], []
        n = world.rig.size
        for plan in plans:
            q = states.take(plan, noiseless=True).clean[::7]
            e.append(q[:, :n] @ world.rig.elongations()[column])
            v.append(q[:, n:] @ world.rig.elongations()[column])
        self.e, self.v = np.concatenate(e), np.concatenate(v)
        size, speed = float(self.e.std()), float(self.v.std())
        self.units = {
            "k": element.stiffness, "c": element.damping, "e": size, "v": speed, "1": 1.0,
            "ke": element.stiffness * size, "k/e": element.stiffness / size,
            "k/e2": element.stiffness / size**2, "c/v": element.damping / speed,
        }  # fmt: skip
        # No further than their tolerance allows.
        self.reach = 2 * np.array(world.tolerance) * [element.stiffness, element.damping]
        self.true = _force(world.effects[0], self.e, self.v)

    def starts(self) -> list[_Start]:
        """Give the two best draws, each drawn on to the nearest that copies best."""
        rng = np.random.default_rng(0)
        drawn = [self._draw(rng) for _ in range(DRAWS)]
        drawn.sort(key=lambda start: float(np.sum(self._left(start, start.free)[0] ** 2)))
        return [self._refined(start) for start in drawn[:2]]

    def _draw(self, rng: np.random.Generator) -> _Start:
        names, scales, fixed = [], [], {}
        for name, unit in SHAPES[self.rival]:
            bare, both = unit.removeprefix("+-").removeprefix("-"), unit.startswith("+-")
            minus = rng.random() < 0.5 if both else unit.startswith("-")
            if name in FIXED:
                fixed[name] = -1.0 if minus else 1.0
            else:
                names.append(name)
                scales.append((-1.0 if minus else 1.0) * self.units[bare])
        free = 10 ** rng.uniform(-3.0, 1.0, len(names))
        return _Start(tuple(names), np.array(scales), free, np.zeros(self.elements * 2), fixed)

    def _left(self, start: _Start, free: Array) -> tuple[Array, Array]:
        """What of the true force is not copied, and what the rig's own constants take up."""
        rival = Placed(LAWS[self.rival], "", start.parameters(free))
        basis = np.column_stack([self.e, self.v])
        left = self.true - _force(rival, self.e, self.v)
        taken = np.linalg.lstsq(basis, left, rcond=None)[0]
        taken = np.clip(taken, -self.reach, self.reach)
        return left - basis @ taken, taken

    def _refined(self, start: _Start) -> _Start:
        size = float(self.true.std()) or 1.0

        def left(x: Array) -> Array:
            return np.asarray(self._left(start, np.exp(x))[0] / size)

        found = least_squares(left, np.log(start.free), max_nfev=60)
        free = np.exp(np.clip(found.x, np.log(LEAST), np.log(MOST)))
        bent = np.zeros(2 * self.elements)
        stiffness, damping = self._left(start, free)[1]
        bent[self.column] = stiffness / self.units["k"]
        bent[self.elements + self.column] = damping / self.units["c"]
        return dataclasses.replace(start, free=free, bent=bent)


def _everything_heard(world: World) -> World:
    nodes = range(world.rig.size)
    sensors = tuple(Sensor(q, i) for q in ("displacement", "velocity") for i in nodes)
    return dataclasses.replace(world, sensors=sensors, noise=(1.0,) * len(sensors))


def _force(effect: Placed, e: Array, v: Array) -> Array:
    law, p = effect.law, effect.parameters
    text = law.force or f"({law.grip})*sign(v)"
    text = (
        text.replace("abs(v)", "absolute(v)")
        .replace("max(", "maximum(")
        .replace("min(", "minimum(")
    )
    space = {
        name: getattr(np, name)
        for name in ("tanh", "exp", "sin", "absolute", "sign", "maximum", "minimum", "where")
    }
    if law.name == "gap_symmetric":
        text = "kg_n_per_m*(e - minimum(maximum(e, -gap_m), gap_m))"
    return np.asarray(
        eval(text, {"__builtins__": {}}, space | p | {"e": e, "v": v, "w": np.abs(v)})
    )

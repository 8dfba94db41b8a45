"""A rig in its laboratory: what it truly is, how it is shaken, and what is recorded of it."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .equations import System
from .law import Placed
from .laws import LAWS
from .linear import linear_motion
from .motion import move
from .rig import BASE, Element, Rig
from .sensing import (
    Sensor,
    Wander,
    after_noise,
    before_noise,
    draw_dropouts,
    draw_noise,
    measured,
)
from .signals import Signal, excitation, knot_rate
from .unexplained import Seen

Array = NDArray[np.float64]
ON_BASE = "base"


@dataclasses.dataclass(frozen=True)
class Plan:
    """How one record is taken; its seed decides all that is random in it."""

    excitation: str
    band_hz: tuple[float, float]
    level: float
    seconds: float
    start_s: float
    seed: int
    lead_s: float = 0.0
    """How long the excitation had run when the record began."""
    kick: float = 0.0
    """Size of a random initial state, in typical states at this level."""


@dataclasses.dataclass(frozen=True, eq=False)
class Taken:
    """One record."""

    times: Array
    """Of the campaign [s]."""
    inputs: dict[str, Array]
    outputs: Array
    clean: Array
    """What faultless, noiseless sensors would have said."""
    seen: Seen


@dataclasses.dataclass(frozen=True)
class World:
    """All that is true of one case, and all that is claimed."""

    rig: Rig
    nominal: Rig
    tolerance: tuple[float, float]
    effects: tuple[Placed, ...]
    driven: tuple[str, ...]
    """Nodes under a measured force, or ``base``."""
    drive: float
    """Root mean square of an input at level 1, in its unit."""
    rate_hz: float
    sensors: tuple[Sensor, ...]
    noise: tuple[float, ...]
    """Standard deviation, one a sensor, at level 1."""
    noise_follows: bool
    """Whether each record's noise goes with its level, as with a range that is adapted."""
    colour: tuple[float, ...]
    campaign_s: float
    scale: tuple[float, float]
    """Typical displacement and velocity at level 1."""
    wander: Wander = dataclasses.field(default_factory=lambda: Wander("record", 0))
    stuck: bool = False
    recorded: bool = True
    """Whether the inputs are measured."""

    def channels(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple("ab" if node == ON_BASE else f"f{node[1:]}" for node in self.driven)

    def column(self, fault: Placed) -> int:
        return [sensor.channel for sensor in self.sensors].index(fault.place)

    def with_effects(self, *effects: Placed) -> "World":
        return dataclasses.replace(self, effects=effects)

    def true_rig(self) -> Rig:
        """The rig, with links that nobody put into the model."""
        extra = tuple(
            Element(f"x{i}", *_ends(placed.place, self.rig), placed.parameters["k"], 0.0)
            for i, placed in enumerate(self.effects)
            if placed.law.name == "missing_link"
        )
        return dataclasses.replace(self.rig, elements=self.rig.elements + extra)

    def take(self, plan: Plan, *, noiseless: bool = False) -> Taken:
        """Shake the rig as planned and write down what the channels say."""
        rng = np.random.default_rng(plan.seed)
        recorded, forces, base = self._signals(plan, rng)
        samples = round(plan.seconds * self.rate_hz)
        lead = round(plan.lead_s * self.rate_hz)
        local = (lead + np.arange(samples)) / self.rate_hz
        times = plan.start_s + np.arange(samples) / self.rate_hz
        begin = plan.start_s - lead / self.rate_hz
        system = System(self.true_rig(), self.effects, forces, base, begin)
        scale = (self.scale[0] * plan.level, self.scale[1] * plan.level)
        start = self._start(system.states, plan, rng)
        motion = move(system, local, start, scale=scale)
        clean = measured(motion, self.sensors)
        wrong = clean
        for fault in self.effects:
            if fault.law.name == "sensor_clock":
                late = local[0] + (local - local[0]) * (1 + fault.parameters["skew"])
                again = measured(move(system, late, start, scale=scale), self.sensors)
                column = self.column(fault)
                wrong = wrong.copy()
                wrong[:, column] = again[:, column]
            elif fault.law.where == "sensor":
                wrong = before_noise(
                    wrong, fault, self.column(fault), times, self.wander, self.campaign_s
                )
        sd = np.array(self.noise) * (plan.level if self.noise_follows else 1.0)
        noise = sd * draw_noise(wrong.shape, self.colour, rng)
        silent, outputs = wrong, wrong + (0.0 if noiseless else noise)
        for fault in self.effects:
            if fault.law.where == "sensor":
                drops = draw_dropouts(samples, self.rate_hz, rng, self.stuck)
                column = self.column(fault)
                silent = after_noise(silent, fault, column, drops)
                outputs = after_noise(outputs, fault, column, drops)
        knots = next(iter(recorded.values())).rate_hz
        on_base = recorded.get("ab")
        seen = Seen(
            {self.rig.nodes.index(n): recorded[c] for n, c in self._nodes()},
            on_base, round(lead * knots / self.rate_hz), round(knots / self.rate_hz),
            silent, sd,
        )  # fmt: skip
        told = recorded if self.recorded else {}
        inputs = {name: signal.at(local) for name, signal in told.items()}
        return Taken(times, inputs, outputs, clean, seen)

    def linear_scale(self, plan: Plan) -> tuple[Array, Array, Array]:
        """Elongations, their rates, and outputs of the linear rig, from the start of a plan."""
        rng = np.random.default_rng(plan.seed)
        _, forces, base = self.with_effects()._signals(plan, rng)
        start = self._start(2 * self.rig.size, plan, rng)
        signal = next(iter([*forces.values(), *base]))
        knots = round(plan.seconds * signal.rate_hz)
        q, v, a = linear_motion(self.rig, forces, base[0] if base else None, knots, start)
        to = self.rig.elongations().T
        shaken = base[0].at(np.arange(knots) / signal.rate_hz) if base else np.zeros(knots)
        pick = {"displacement": q, "velocity": v, "acceleration": a + shaken[:, None]}
        outputs = np.column_stack([pick[s.quantity][:, s.node] for s in self.sensors])
        return q @ to, v @ to, outputs

    def _nodes(self) -> list[tuple[str, str]]:
        pairs = zip(self.driven, self.channels(), strict=True)
        return [(node, channel) for node, channel in pairs if node != ON_BASE]

    def _signals(
        self, plan: Plan, rng: np.random.Generator
    ) -> tuple[dict[str, Signal], dict[int, Signal], tuple[Signal, ...]]:
        """Inputs as recorded; forces and accelerations of the base as they are."""
        seconds = plan.seconds * 1.006 + plan.lead_s + 1.0
        highest = max(plan.band_hz[1], 1.3 * float(self.rig.frequencies_hz()[-1]))
        knots = knot_rate(self.rate_hz, highest)
        recorded, forces, base = {}, {}, []
        for node, channel in zip(self.driven, self.channels(), strict=True):
            values = excitation(plan.excitation, plan.band_hz, seconds, knots, rng)
            signal = Signal.through(self.drive * plan.level * values, knots)
            recorded[channel] = signal
            for fault in self.effects:
                if fault.law.where == "input" and fault.place == channel:
                    signal = _input_fault(signal, fault)
            if node == ON_BASE:
                base.append(signal)
            else:
                forces[self.rig.nodes.index(node)] = signal
        for effect in self.effects:
            if effect.law.name == "base_motion":
                low, high = (float(x) for x in self.rig.frequencies_hz()[[0, -1]])
                hidden = excitation("random", (0.3 * low, 1.3 * high), seconds, knots, rng)
                base.append(Signal.through(effect.parameters["rms_m_per_s2"] * hidden, knots))
        return recorded, forces, tuple(base)

    def _pulled(self) -> Array:
        """Displacements under a steady force at the first driven node, the largest being 1."""
        n = self.rig.size
        pull = np.eye(n)[self.rig.nodes.index(self.driven[0])] / self.rig.masses
        shape = np.linalg.solve(-self.rig.state_matrix()[n:, :n], pull)
        return np.asarray(shape / np.abs(shape).max())

    def _start(self, states: int, plan: Plan, rng: np.random.Generator) -> list[float] | None:
        if not plan.kick:
            return None
        n, size = self.rig.size, plan.kick * plan.level
        if plan.excitation == "release":
            shape = self._pulled()
            return [*(size * self.scale[0] * shape).tolist(), *[0.0] * (states - n)]
        values = rng.standard_normal(2 * n) * np.repeat(self.scale, n) * size
        return [*values.tolist(), *[0.0] * (states - 2 * n)]


def _input_fault(signal: Signal, fault: Placed) -> Signal:
    if fault.law.name == "input_gain":
        return signal.times(fault.parameters["gain"])
    at = np.arange(len(signal.coefficients) + 1) / signal.rate_hz - fault.parameters["delay_s"]
    return Signal.through(signal.at(np.maximum(at, 0.0)), signal.rate_hz)


def _ends(place: str, rig: Rig) -> tuple[int, int]:
    first, second = place.split("-")
    return (BASE if first == ON_BASE else rig.nodes.index(first)), rig.nodes.index(second)


def to_json(world: World) -> dict[str, Any]:
    """All of a world in plain values."""
    plain = dataclasses.asdict(world)
    plain["effects"] = [
        {"effect": p.law.name, "place": p.place, "parameters": p.parameters}
        for p in world.effects
    ]
    return plain


def from_json(plain: dict[str, Any]) -> World:
    """Build a world again from its plain values."""

    def rig(values: dict[str, Any]) -> Rig:
        elements = tuple(Element(**element) for element in values["elements"])
        return Rig(tuple(values["masses"]), elements, values["unit"])

    effects = tuple(
        Placed(LAWS[p["effect"]], p["place"], p["parameters"]) for p in plain["effects"]
    )
    lists = ("tolerance", "driven", "noise", "colour", "scale")
    built = {
        "rig": rig(plain["rig"]),
        "nominal": rig(plain["nominal"]),
        "effects": effects,
        "sensors": tuple(Sensor(**sensor) for sensor in plain["sensors"]),
        "wander": Wander(**plain["wander"]),
    }
    return World(**(plain | {name: tuple(plain[name]) for name in lists} | built))


def whole_samples(seconds: float, rate_hz: float) -> float:
    """Round down to a whole number of samples."""
    return math.floor(seconds * rate_hz) / rate_hz

r"""Runs of a drifting plant whose friction acts along the measured motion.

Friction depends on the sign of the velocity: a free run that has drifted a little reverses at
the wrong instant, and its friction then acts in the wrong direction, which no error of the
inputs would explain. So friction acts along the measured motion (a series-parallel model): that
of a linear run with the most probable errors :math:`w` of its inputs,

.. math:: w = \arg\min \sum_k |W_k|^2 / S + |R_k - h_k W_k|^2 / N_k .

The residual then drifts by the integral of the errors of the force, and is weighted so.

References
----------
.. [1] K. S. Narendra, K. Parthasarathy, "Identification and control of dynamical systems using
   neural networks", IEEE Trans. Neural Networks 1 (1990), for series-parallel models.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.noise import Noise, rigid_body_drift
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, Input
from slowtime.dynamics.effects import Effect, Friction, Law, Motion, force_along
from slowtime.dynamics.plant import Name, Plant
from slowtime.dynamics.plant.simulation_run import PlantRun
from slowtime.signals.spectra import transform

DIFFERENCE_STEP = 1e-4
"""[1] Relative step of central differences of friction. Source: near the cube root of the
double precision, where truncation and rounding errors balance."""

EXTRAPOLATED_PART = 4
"""[1] The residual is extrapolated over one part in so many of the record. Source:
docs/what_decides.md: half and double change no answer."""
SLOPE_PART = 100
"""[1] Its slope at the end is fitted to one part in so many of the record. Source:
docs/what_decides.md: half and double change no answer."""

Series = Float[np.ndarray, "time channel"]
Values = Float[np.ndarray, " parameter"]
InitialState = Float[np.ndarray, " state"] | None


def needs_measured_friction(plant: Plant, noise: Noise) -> bool:
    """Whether a plant has rigid motions and friction, and no other nonlinear law."""
    actions = [plant.kinds[effect.kind].action for effect in plant.effects]
    asks = any(isinstance(action, Friction) for action in actions)
    bends = any(isinstance(action, Law) for action in actions)
    return noise.drift is not None and asks and not bends


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeasuredFrictionPlant:
    """A plant in one record, with its friction along the measured motion."""

    plant: Plant
    trial: Trial
    noise: Noise
    number: int

    def simulate(
        self,
        values: Values,
        inputs: Series,
        rate_hz: float,
        *,
        state0: InitialState = None,
        start_s: float = 0.0,
    ) -> Float[np.ndarray, "time sensor"]:
        """Run the model; see `Plant.simulate`."""
        bare = self._bare(values)
        push = bare.friction_forces(self._seen(bare, inputs, state0))
        return bare.run(inputs, push, state0, self.trial).outputs

    def sensitivities(
        self,
        values: Values,
        inputs: Series,
        rate_hz: float,
        free: Sequence[Name],
        *,
        state0: InitialState = None,
        start_s: float = 0.0,
    ) -> tuple[Float[np.ndarray, "time sensor"], Float[np.ndarray, "time sensor slope"]]:
        """Run with sensitivities to free parameters and initial state; see `Plant`."""
        bare = self._bare(values)
        seen = self._seen(bare, inputs, state0)
        push = bare.friction_forces(seen)
        own = [name for name in free if name not in bare.renamed]
        linear = [bare.renamed[name] for name in free if name in bare.renamed]
        outputs, slopes = bare.plant.sensitivities(
            bare.plant.values, np.concatenate([inputs, push], axis=1), rate_hz, linear,
            state0=state0, start_s=start_s,
        )  # fmt: skip
        rest = bare.run(0 * inputs, 0 * push, None, self.trial).outputs
        columns = {}
        for name in own:
            at = self.plant.parameters.index(name)
            step = DIFFERENCE_STEP * max(abs(values[at]), DIFFERENCE_STEP)
            ends = []
            for sign in (1.0, -1.0):
                moved = values.copy()
                moved[at] += sign * step
                ends.append(self._bare(moved).friction_forces(seen))
            slope = (ends[0] - ends[1]) / (2 * step)
            columns[name] = bare.run(0 * inputs, slope, None, self.trial).outputs - rest
        known = dict(zip(linear, np.moveaxis(slopes, 2, 0), strict=False))
        parts = [columns[n] if n in columns else known[bare.renamed[n]] for n in free]
        states = list(np.moveaxis(slopes[:, :, len(linear) :], 2, 0))
        return outputs, np.stack([*parts, *states], axis=2)

    def _bare(self, values: Values) -> "_FrictionlessPlant":
        return _FrictionlessPlant.of(self.plant, values)

    def _seen(
        self, bare: "_FrictionlessPlant", inputs: Series, state0: InitialState
    ) -> PlantRun:
        """Run the linear part with the most probable errors of its inputs."""
        rest = np.zeros((len(inputs), len(bare.nodes)))
        run = bare.run(inputs, rest, state0, self.trial)
        own = dataclasses.replace(bare.plant.description, inputs=self.plant.description.inputs)
        drift = rigid_body_drift(own, (self.trial,))
        assert drift is not None
        rate, count = self.trial.rate_hz, len(inputs)
        left = _extrapolated(self.trial.measured - run.outputs, self.trial.used)
        frequency, spectrum = transform(left, rate)
        noise = self.noise.density(self.number, frequency)
        lines = drift.input_errors(frequency, spectrum, noise)
        scale = np.sqrt(2.0 / (rate * len(left)))
        errors = np.fft.irfft(lines / scale, len(left), axis=0)[:count]
        return bare.run(inputs + errors, rest, state0, self.trial)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _FrictionlessPlant:
    """A plant without friction, and with an input force on every node that friction acts on."""

    plant: Plant
    friction: tuple[Effect, ...]
    nodes: tuple[str, ...]
    renamed: dict[Name, Name]

    @classmethod
    def of(cls, plant: Plant, values: Values) -> "_FrictionlessPlant":
        named = dict(zip(plant.parameters, values.tolist(), strict=True))
        whole = with_values(plant.description, named)
        rubs = [isinstance(plant.kinds[e.kind].action, Friction) for e in plant.effects]
        kept = [i for i, own in enumerate(rubs) if not own]
        friction = tuple(
            Effect(
                effect.kind,
                effect.place,
                {n: named["effect", i, n] for n in plant.kinds[effect.kind].names},
            )
            for i, (effect, own) in enumerate(zip(plant.effects, rubs, strict=True))
            if own
        )
        ends = {node for effect in friction for node in _end_nodes(whole, effect)}
        nodes = tuple(node for node in plant.matrices.names if node in ends)
        unit = "N" if whole.unit_of_coordinate == "m" else "N m"
        pushes = tuple(
            Input(channel=f"friction on {node}", kind="force", unit=unit, node=node)
            for node in nodes
        )
        bare = dataclasses.replace(
            whole,
            effects=tuple(whole.effects[i] for i in kept),
            inputs=(*whole.inputs, *pushes),
        )
        renamed: dict[Name, Name] = {
            name: name for name in plant.parameters if name[0] != "effect"
        }
        for name in plant.parameters:
            if len(name) == 3 and name[1] in kept:
                renamed[name] = (name[0], kept.index(name[1]), name[2])
        return cls(Plant.of(bare, kinds=plant.kinds), friction, nodes, renamed)

    def run(self, inputs: Series, push: Series, state0: InitialState, trial: Trial) -> PlantRun:
        """Run with inputs (time, input) and forces on the nodes (time, node) [N]."""
        both = np.concatenate([inputs, push], axis=1)
        return self.plant.run(
            self.plant.values, both, trial.rate_hz, state0=state0, start_s=trial.start_s
        )

    def friction_forces(self, run: PlantRun) -> Series:
        """Friction force on each of the nodes along a run (time, node) [N]."""
        names = self.plant.matrices.names
        dofs = len(names)
        push = np.zeros((len(run.states), len(self.nodes)))
        for effect in self.friction:
            ends = _end_nodes(self.plant.description, effect)
            pair = [
                (sign, names.index(node), self.nodes.index(node))
                for sign, node in zip((-1.0, 1.0), ends, strict=True)
                if node in self.nodes
            ]
            e, v, a = (
                np.sum([sign * series[:, at] for sign, at, _ in pair], axis=0)
                for series in (run.states, run.states[:, dofs:], run.rates[:, dofs:])
            )
            motion = Motion(e=e, v=v, a=a, times=run.times)
            force = force_along(self.plant.kinds[effect.kind], effect.parameters, motion)
            for sign, _, column in pair:
                push[:, column] -= sign * force
        return push


def _extrapolated(
    left: Float[np.ndarray, "time sensor"], used: Bool[np.ndarray, "time sensor"]
) -> Float[np.ndarray, "longer sensor"]:
    """Interpolate gaps of a residual, and extrapolate it beyond the record to zero."""
    count = len(left)
    times = np.arange(count)
    # The length is odd, so that all lines but the first have equal weight.
    more = count // EXTRAPOLATED_PART + 1 - (count + count // EXTRAPOLATED_PART) % 2
    ahead = np.arange(1, more + 1)
    fade = np.cos(np.pi / 2 * ahead / more) ** 2
    columns = []
    for series, use in zip(left.T, used.T, strict=True):
        whole = np.interp(times, times[use], series[use]) if use.any() else 0 * series
        last = max(count // SLOPE_PART, 8)
        slope = np.polyfit(np.arange(last), whole[-last:], 1)[0]
        columns.append(np.concatenate([whole, fade * (whole[-1] + slope * ahead)]))
    return np.stack(columns, axis=1)


def _end_nodes(description: Description, effect: Effect) -> tuple[str, str]:
    first, last = next(e for e in description.elements if e.id == effect.place.id).between
    return first, last

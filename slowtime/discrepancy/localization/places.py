"""What locating found: places in order, and the force and motion at any of them."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Motion, Place
from slowtime.signals.spectra import transform

from .latent_force import Explanation
from .linear_response import LinearModel
from .spectral_lines import TrialLines

ALLOWED_TOLERANCES = 2.0
"""[tolerances] By which a constant may move before that counts as force. Source: the 95 %
level."""
PLACE_MARGIN = 1.2
"""[1] Times what the best place leaves that another must leave to be ruled out. Source:
judgement; no study is recorded."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LatentForce:
    """The force at a place, and the motion along it, in one trial.

    Parameters
    ----------
    force
        Posterior mean: on an element, it resists elongation; on a node or through an input, it
        pushes [N]; of the base, an acceleration [m/s^2]; of a sensor, in its unit. The force by
        which an element's own constants moved beyond `ALLOWED_TOLERANCES` is part of it.
    sd
        Of the error of a sample of `force`, were the model right but for this force.
    noise_sd
        Of that part of `force` that the sensors' noise alone would give.
    motion
        Along an element; of a node, displacement and velocity against the base, acceleration in
        space. Of the base, its acceleration. Of a sensor, what it should have read; of an
        input, what was recorded; both with their first and second differences.
    """

    force: Float[np.ndarray, " time"]
    sd: float
    noise_sd: float
    motion: Motion


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlaceGroup:
    """Places that are one to the sensors, and how well a force there explains the residuals.

    Parameters
    ----------
    places
        In the order element, node, base, input, sensor.
    score
        Gain of log likelihood by one unknown force there, over none.
    p_value
        Probability of such a gain, here or anywhere, where nothing is missing.
    share
        Of the residual power beyond the noise that the force explains.
    left
        What it leaves, over the noise; 1 is as good as can be.
    constants
        Relative change of the free linear constants against nominal that goes with it.
    twins
        Places where another force would do the same to the sensors, line by line: only what
        the force looks like can speak for one of them.
    """

    places: tuple[Place, ...]
    score: float
    p_value: float
    share: float
    left: float
    constants: dict[tuple[str, str], float]
    explained: Explanation
    twins: tuple[Place, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Localization:
    """Where the residuals come from.

    Parameters
    ----------
    groups
        The likeliest first.
    trials, lines
        Records, and their spectra with the noise as it was last heard.
    runs
        Displacement, velocity, acceleration of the reference in each trial.
    outputs
        What the reference says the sensors read.
    nominal, tolerance
        Values of the free linear constants that the model claims, and how well, in their units.
    log_likelihood
        Of all lines, with the likeliest force and the noise as it was last heard: by it other
        accounts of the same records, such as of what inputs do between samples, are compared.
    """

    groups: tuple[PlaceGroup, ...]
    linear: LinearModel
    trials: tuple[Trial, ...]
    lines: tuple[TrialLines, ...]
    runs: tuple[Float[np.ndarray, "order time dof"], ...]
    outputs: tuple[Float[np.ndarray, "time sensor"], ...]
    nominal: dict[tuple[str, str], float]
    tolerance: dict[tuple[str, str], float]
    log_likelihood: float

    def with_base_first(self) -> "Localization":
        """Put the base before a place where another force would do the same to the sensors.

        Which of the two stands first is then a matter of how smooth their spectra are.
        """
        first = self.groups[0]
        for group in self.groups[1:]:
            if any(p.kind == "base" and p in first.twins for p in group.places):
                rest = (other for other in self.groups if other is not group)
                return dataclasses.replace(self, groups=(group, *rest))
        return self

    @property
    def best(self) -> Place:
        """Place of the greatest likelihood."""
        return self.groups[0].places[0]

    @property
    def best_structural(self) -> Place:
        """The best place; of the structure itself, where one does as well as the base."""
        own = [place for place in self.equivalent_places if place.kind in ("element", "node")]
        return own[0] if own and self.best.kind == "base" else self.best

    @property
    def equivalent_places(self) -> tuple[Place, ...]:
        """Places where a force leaves about as little as at the best, which is one of them."""
        most = PLACE_MARGIN * self.groups[0].left
        first, *rest = self.groups
        return (*first.places, *(p for g in rest if g.left < most for p in g.places))

    @property
    def p_value(self) -> float:
        """Probability of so large a gain, at the best place, where nothing is missing."""
        return self.groups[0].p_value

    def group(self, place: Place) -> PlaceGroup:
        """Give the group that holds a place."""
        for group in self.groups:
            if place in group.places:
                return group
        raise ValueError(
            f"{place} was not looked at. Places: "
            f"{', '.join(str(p) for group in self.groups for p in group.places)}."
        )

    def latent(self, place: Place, number: int) -> LatentForce:
        """Force and motion at a place in one trial, as the sensors tell it."""
        explained, lines = self.group(place).explained, self.lines[number]
        found = explained.forces[number]
        assert explained.source is not None
        scale = _direction_ratio(self.linear, place, explained)
        motion = self._motion(place, explained, number)
        series = lines.series(found.mean[:, None])[:, 0] * scale
        if place.kind == "element":
            series = series + self._beyond(place, "stiffness") * motion.e
            series = series + self._beyond(place, "damping") * motion.v
        noise = found.posterior_variance**2 * found.signal
        spacing = float(lines.frequency_hz[1])
        return LatentForce(
            force=series,
            sd=abs(scale) * float(np.sqrt(found.posterior_variance.sum() * spacing)),
            noise_sd=abs(scale) * float(np.sqrt(noise.sum() * spacing)),
            motion=motion,
        )

    def _beyond(self, place: Place, what: str) -> float:
        """Change of an element's constant beyond what its tolerance allows."""
        name = (what, place.id)
        if name not in self.nominal:
            return 0.0
        moved = self.group(place).constants[name] * self.nominal[name]
        allowed = ALLOWED_TOLERANCES * self.tolerance[name]
        return float(moved - np.clip(moved, -allowed, allowed))

    def attenuated(
        self, place: Place, number: int, force: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, " time"]:
        """Give what `latent` would say of a known force: less, where the noise is strong."""
        lines = self.lines[number]
        found = self.group(place).explained.forces[number]
        spectrum = transform(force[:, None], lines.rate_hz)[1][: len(found.posterior_variance)]
        return lines.series(spectrum * (found.posterior_variance * found.signal)[:, None])[:, 0]

    def _motion(self, place: Place, explained: Explanation, number: int) -> Motion:
        trial, lines = self.trials[number], self.lines[number]
        base = lines.series(lines.base[:, None])[:, 0]
        if place.kind == "sensor":
            column = [s.channel for s in self.linear.description.sensors].index(place.id)
            return _motion_of_series(self._reading(explained, number)[:, column], trial)
        if place.kind == "input":
            column = [i.channel for i in self.linear.description.inputs].index(place.id)
            return _motion_of_series(trial.inputs[:, column], trial)
        if place.kind == "base":
            return Motion(e=0 * base, v=0 * base, a=base, times=trial.times_s)
        along = self.linear.elongation(place)
        q, v, a = self.motion(explained, number) @ along
        own = base if place.kind == "node" else 0.0
        return Motion(e=q, v=v, a=a + own, times=trial.times_s)

    def motion(
        self, explained: Explanation, number: int
    ) -> Float[np.ndarray, "order time dof"]:
        """Give displacement, velocity, acceleration of all coordinates, as the sensors tell."""
        lines, state = self.lines[number], explained.forces[number].state
        decays = explained.linear.free_decay(lines.samples, lines.rate_hz, state)[1]
        shifts = np.stack([lines.series(one) for one in explained.shifts[number]])
        return np.asarray(self.runs[number] + decays + shifts)

    def _reading(self, explained: Explanation, number: int) -> Float[np.ndarray, "time sensor"]:
        """Give what sensors would read without their own fault."""
        lines, found = self.lines[number], explained.forces[number]
        decays = explained.linear.free_decay(lines.samples, lines.rate_hz, found.state)[0]
        return np.asarray(self.outputs[number] + decays + lines.series(found.linear))


def _motion_of_series(series: Float[np.ndarray, " time"], trial: Trial) -> Motion:
    rate = np.gradient(series) * trial.rate_hz
    return Motion(e=series, v=rate, a=np.gradient(rate) * trial.rate_hz, times=trial.times_s)


def _direction_ratio(linear: LinearModel, place: Place, explained: Explanation) -> float:
    """Ratio of a place's own unit force to that of the source that stands for its group."""
    source = explained.source
    assert source is not None
    own = next(s for s in linear.sources() if s.place == place)
    if source.sensor is not None:
        return 1.0
    one, other = np.append(own.force, own.base), np.append(source.force, source.base)
    return float(other @ other / (one @ other))

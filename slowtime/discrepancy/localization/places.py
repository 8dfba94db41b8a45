"""Places ranked by likelihood, and the force and motion at any of them."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Motion, Place
from slowtime.signals.spectra import transform

from .latent_force import Explanation
from .linear_response import LinearModel
from .spectral_lines import OuterMotion, TrialLines

ALLOWED_TOLERANCES = 2.0
"""[tolerances] By which a constant may move before that counts as force. Source: the 95 %
level."""
PLACE_MARGIN = 1.2
"""[1] Times what the best place leaves that another must leave to be ruled out. Source:
docs/what_decides.md: half and double change no answer."""


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
    """Places that the sensors cannot tell apart, and how well a force there explains residuals.

    Parameters
    ----------
    share
        Share of the residual power beyond the noise that the force explains.
    left
        Mean square that it leaves, over the noise; 1 is expected of the right place.
    constants
        Relative change of the free linear constants against nominal that goes with it.
    twins
        Places whose transfer is parallel at every line: another force there explains the same,
        and only its spectrum can decide.
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
    """Places ranked by the likelihood of an unknown force.

    Parameters
    ----------
    runs
        Displacement, velocity, acceleration of the reference in each trial.
    nominal, tolerance
        Prior mean and standard deviation of the free linear constants, in their units.
    log_likelihood
        Of all lines with the likeliest force and the last estimate of the noise. Other models
        of the same records, such as other holds of the inputs, are compared by it.
    """

    groups: tuple[PlaceGroup, ...]
    linear: LinearModel
    trials: tuple[Trial, ...]
    lines: tuple[TrialLines, ...]
    runs: tuple[Float[np.ndarray, "order time dof"], ...]
    outer: tuple[OuterMotion, ...]
    outputs: tuple[Float[np.ndarray, "time sensor"], ...]
    nominal: dict[tuple[str, str], float]
    tolerance: dict[tuple[str, str], float]
    log_likelihood: float

    def with_base_first(self) -> "Localization":
        """Put the base before a place whose transfer is parallel to its own."""
        # Their order is otherwise decided by the smoothness of the force spectra alone.
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
        """The best place; one of the structure where that is as good as the base."""
        own = [place for place in self.equivalent_places if place.kind in ("element", "node")]
        return own[0] if own and self.best.kind == "base" else self.best

    @property
    def equivalent_places(self) -> tuple[Place, ...]:
        """Places where a force leaves about as little as at the best, that one included."""
        most = PLACE_MARGIN * self.groups[0].left
        first, *rest = self.groups
        return (*first.places, *(p for g in rest if g.left < most for p in g.places))

    @property
    def p_value(self) -> float:
        """Probability of so large a gain at the best place if nothing is missing."""
        return self.groups[0].p_value

    def group(self, place: Place) -> PlaceGroup:
        """Find the group that holds a place."""
        for group in self.groups:
            if place in group.places:
                return group
        raise ValueError(
            f"{place} was not examined. Places: "
            f"{', '.join(str(p) for group in self.groups for p in group.places)}."
        )

    def latent(self, place: Place, number: int) -> LatentForce:
        """Posterior mean of force and motion at a place in one trial."""
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
        """Change of an element's constant beyond the allowed tolerances, in its unit."""
        name = (what, place.id)
        if name not in self.nominal:
            return 0.0
        moved = self.group(place).constants[name] * self.nominal[name]
        allowed = ALLOWED_TOLERANCES * self.tolerance[name]
        return float(moved - np.clip(moved, -allowed, allowed))

    def attenuated(
        self, place: Place, number: int, force: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, " time"]:
        """Attenuate a known force [N] as the posterior mean does where noise is strong."""
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
        outer = self.linear.elongation_of_supports(place)
        q, v, a = self.motion(explained, number) @ along + self.outer[number].supports @ outer
        own = base if place.kind == "node" else 0.0
        return Motion(e=q, v=v, a=a + own, times=trial.times_s)

    def motion(
        self, explained: Explanation, number: int
    ) -> Float[np.ndarray, "order time dof"]:
        """Posterior displacement, velocity and acceleration of all coordinates in one trial."""
        lines, state = self.lines[number], explained.forces[number].state
        decays = explained.linear.free_decay(lines.samples, lines.rate_hz, state)[1]
        shifts = np.stack([lines.series(one) for one in explained.shifts[number]])
        return np.asarray(self.runs[number] + decays + shifts)

    def _reading(self, explained: Explanation, number: int) -> Float[np.ndarray, "time sensor"]:
        """Give the readings of the sensors without the force that is sought at one of them."""
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

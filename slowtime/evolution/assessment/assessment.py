"""Modes before and now, and a model → which members have lost stiffness, and how much."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from slowtime.evolution.structures import MeasuredModes, UpdatableModel

from .change_model import ChangeModel, change_model
from .detection_limits import DetectionLimit, detection_limits
from .explanations import Explanation, ExplanationSearch
from .member_test import MemberTest
from .state_difference import ALIKE, ModePair, paired_modes, state_difference
from .suspects import COVERAGE, SuspectSet, inclusion, suspect_sets

Verdict = Literal["unchanged", "changed", "undecided", "not comparable"]

LEAST_MODES = 2
"""Modes in both states [1] from which they are compared: one frequency tells a loss from a
common change of all stiffness in no case."""

_OTHER_SHARE = 0.1
"""Share [1] of the false alarms that changes of another kind than losses may make."""

_UNEXPLAINED = 1e-3
"""Probability of a misfit as large [1] below which no set of members explains the change."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class AssessmentSettings:
    """What is assumed of model, temperature and damage.

    Parameters
    ----------
    model_error
        Relative standard deviation of the stiffness of each member about the model [1].
    temperature_sd
        Standard deviation of a common relative change of all stiffness between the two states
        [1]. Source: steel loses 0.05 % a kelvin, concrete 0.1 to 0.2 %; 20 K either way.
    frequency_error, shape_error
        Errors of frequencies, relative, and of components of shapes of norm 1 that the model
        makes besides [1]; they cancel between the states.
    false_alarm
        Probability of a change that is told where there is none [1].
    most
        Largest number of members that are told to have changed.
    seed
        Of the draws of the threshold.
    """

    model_error: float = 0.02
    temperature_sd: float = 0.02
    frequency_error: float = 0.002
    shape_error: float = 0.02
    false_alarm: float = 0.05
    most: int = 3
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse values without a meaning."""
        positive = (self.model_error, self.frequency_error, self.shape_error)
        if not (min(positive) > 0.0 and max(positive) < 1.0 and self.temperature_sd >= 0.0):
            raise ValueError(
                f"model_error={self.model_error}, frequency_error={self.frequency_error}, "
                f"shape_error={self.shape_error}, temperature_sd={self.temperature_sd}. Give "
                "relative standard deviations between 0 and 1, such as 0.02; only "
                "temperature_sd may be 0."
            )
        if not (0.0 < self.false_alarm < 0.5 and self.most >= 1):
            raise ValueError(
                f"false_alarm={self.false_alarm}, most={self.most}. Give a probability below "
                "0.5, such as 0.05, and at least one member."
            )


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Assessment:
    """What two sets of modes say about the members.

    Parameters
    ----------
    verdict
        `unchanged`; `changed`, by the members in `sets`; `undecided`, where something changed
        and the members are not told, as `reason` says; or `not comparable`.
    reason
        Why, where the verdict is one of the last two; else empty.
    sets
        For each changed member the set of those that it may be.
    probability
        Of each member having changed, if anything has [1]; empty without a change.
    p_value
        Probability of scores of the members as large without a change [1].
    other_p_value
        Likewise of a difference as large as a whole [1].
    common_change
        Relative change of all stiffness, as by temperature, and its standard deviation [1].
    pairs
        Modes that were compared.
    """

    verdict: Verdict
    reason: str = ""
    sets: tuple[SuspectSet, ...] = ()
    probability: dict[str, float] = dataclasses.field(default_factory=dict)
    p_value: float = math.nan
    other_p_value: float = math.nan
    common_change: tuple[float, float] = (math.nan, math.nan)
    pairs: tuple[ModePair, ...] = ()

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if self.verdict == "unchanged":
            return f"No member has lost stiffness beyond the errors (p = {self.p_value:.2g})."
        if self.verdict == "not comparable":
            return f"The two states are not comparable: {self.reason}"
        said = "; ".join(one.sentence for one in self.sets)
        if self.verdict == "changed":
            return f"Changed: {said}."
        return f"Changed, but the member is not decidable: {self.reason}"


class Comparison:
    """Two states of a structure with its model: what is assessed, or planned.

    Parameters
    ----------
    structure
        The model; each parameter is the stiffness of a member, of a connection, or of a group
        of them.
    before, now
        Modes of the two states, at the same channels.
    settings
        What is assumed.
    """

    def __init__(
        self,
        structure: UpdatableModel,
        before: MeasuredModes,
        now: MeasuredModes,
        settings: AssessmentSettings,
    ) -> None:
        self.structure = structure
        self.before, self.now = before, now
        self.settings = settings
        self.pairs = paired_modes(before, now)

    @functools.cached_property
    def model(self) -> ChangeModel:
        """The model as the modes before say that it is; modes that it lacks are left out."""
        model = self._fitted(self.pairs)
        alike = ~(model.likeness < ALIKE)
        if LEAST_MODES <= alike.sum() < len(alike):
            model = self._fitted([self.pairs[k] for k in np.flatnonzero(alike)])
        return model

    def _fitted(self, pairs: Sequence[ModePair]) -> ChangeModel:
        given = self.settings
        return change_model(
            self.structure,
            state_difference(self.before, self.now, pairs),
            model_error=given.model_error,
            frequency_error=given.frequency_error,
            shape_error=given.shape_error,
        )

    @functools.cached_property
    def test(self) -> MemberTest:
        """Scores of the members."""
        common = self.settings.temperature_sd * self.model.difference.common_stiffness
        return MemberTest(
            slope=self.model.change(np.zeros(len(self.structure.names))).slope,
            covariance=self.model.difference.covariance + np.outer(common, common),
            seed=self.settings.seed,
        )

    @property
    def levels(self) -> tuple[float, float]:
        """Probabilities of false alarms of the scores, and of the difference as a whole."""
        whole = self.settings.false_alarm
        return (1.0 - _OTHER_SHARE) * whole, _OTHER_SHARE * whole

    def common_change(self, told: Explanation) -> tuple[float, float]:
        """Estimate the common change of all stiffness, and its standard deviation [1]."""
        prior = self.settings.temperature_sd
        along = prior * self.model.difference.common_stiffness
        left = self.model.difference.values - told.predicted.rows
        covariance = self.test.covariance + told.predicted.covariance
        gain = np.linalg.solve(covariance, along)
        share = max(1.0 - float(gain @ along), 0.0)
        return prior * float(gain @ left), prior * math.sqrt(share)


def assess(
    structure: UpdatableModel,
    before: MeasuredModes,
    now: MeasuredModes,
    settings: AssessmentSettings | None = None,
) -> Assessment:
    """Find the members that have lost stiffness between two states.

    Parameters
    ----------
    structure
        The model; each parameter is the stiffness of a member, of a connection, or of a group
        of them.
    before, now
        Modes of the two states, at the same channels.
    settings
        What is assumed of model, temperature and damage.

    Returns
    -------
    The verdict, and for each changed member the set of those that it may be.

    Raises
    ------
    ValueError
        Where the channels of the states are not those of the model.
    """
    comparison = Comparison(structure, before, now, settings or AssessmentSettings())
    if (reason := _incomparable(comparison)) is not None:
        return Assessment(verdict="not comparable", reason=reason, pairs=comparison.pairs)
    test, difference = comparison.test, comparison.model.difference
    found = Assessment(
        verdict="unchanged",
        p_value=test.p_value(difference.values),
        other_p_value=test.misfit_p_value(difference.values),
        pairs=difference.pairs,
    )
    level, other_level = comparison.levels
    search = ExplanationSearch(comparison.model, test.covariance, comparison.settings.most)
    if found.p_value > level and found.other_p_value > other_level:
        common = comparison.common_change(search.nothing)
        return dataclasses.replace(found, common_change=common)
    told = search.run()
    sets = suspect_sets(structure.names, told)
    reason = _undecidable(told, sets, len(structure.names))
    return dataclasses.replace(
        found,
        verdict="changed" if reason is None else "undecided",
        reason=reason or "",
        sets=sets,
        probability=inclusion(structure.names, told),
        common_change=comparison.common_change(told[0]),
    )


def _incomparable(comparison: Comparison) -> str | None:
    given = min(len(comparison.before.frequency_hz), len(comparison.now.frequency_hz))
    least, found = max(LEAST_MODES, math.ceil(given / 2)), len(comparison.pairs)
    if found < least:
        return (
            f"{found} modes are in both, alike by MAC (at least {ALIKE:g}) and frequency; "
            f"needed are {least}. Identify both states from the same channels, and longer "
            "records."
        )
    alike = int(np.sum(~(comparison.model.likeness < ALIKE)))
    if alike < LEAST_MODES:
        return (
            f"{alike} of the modes before are like those of the model (MAC at least "
            f"{ALIKE:g}). Update the model, or correct its sensors."
        )
    return None


def _undecidable(
    told: list[Explanation], sets: tuple[SuspectSet, ...], count: int
) -> str | None:
    if told[0].p_value < _UNEXPLAINED:
        return (
            f"no loss of up to {len(told[-1].members) or 1} members explains the difference "
            f"(p = {told[0].p_value:.1g}). Something else changed, such as a mass, or the "
            "errors of the modes are larger than stated."
        )
    largest = max(len(one.suspects) for one in sets)
    if count > 2 and largest > count / 2:
        return f"{largest} of {count} members explain the difference about as well."
    return None


def plan_limits(
    structure: UpdatableModel,
    expected: MeasuredModes,
    settings: AssessmentSettings | None = None,
    *,
    power: float = 0.9,
) -> tuple[DetectionLimit, ...]:
    """Find, before measuring, the smallest loss of each member that `assess` will find.

    Parameters
    ----------
    structure
        The model.
    expected
        Modes that will be measured in each of the states, with their standard deviations;
        `expected_modes` makes them of a model.
    settings
        What is assumed of model, temperature and damage.
    power
        Probability with which a loss is found: the change is told, and the member is in the
        named set [1]; below 0.95.

    Returns
    -------
    One limit for each member.

    Raises
    ------
    ValueError
        Where `power` is not between 0 and 0.95.
    """
    if not 0.0 < power < COVERAGE:
        raise ValueError(
            f"power={power}. Give a probability below {COVERAGE:g}, that of the named set."
        )
    comparison = Comparison(structure, expected, expected, settings or AssessmentSettings())
    return detection_limits(
        comparison.model,
        comparison.test,
        level=comparison.levels[0],
        power=power,
        coverage=COVERAGE,
    )


def expected_modes(
    structure: UpdatableModel,
    channels: np.ndarray,
    modes: int,
    *,
    frequency_sd: float = 0.001,
    shape_sd: float = 0.01,
) -> MeasuredModes:
    """Modes of the model as they will be measured, without noise.

    Parameters
    ----------
    structure
        The model.
    channels
        What each channel sees of the degrees of freedom.
    modes
        Number of lowest modes.
    frequency_sd
        Relative standard deviation of a frequency [1].
    shape_sd
        Standard deviation of a component of a shape over the largest one [1].

    Returns
    -------
    The modes with their standard deviations.
    """
    found = structure.sensed_modes(np.zeros(len(structure.names)), channels, modes)
    shapes = found.sensed[:, :modes].T
    frequency = found.frequency_hz[:modes]
    largest = np.abs(shapes).max(axis=1, initial=1e-300, keepdims=True)
    return MeasuredModes(
        frequency_hz=frequency,
        frequency_sd_hz=frequency_sd * frequency,
        shapes=shapes if len(channels) > 1 else None,
        shape_sd=shape_sd * largest * np.ones(shapes.shape) if len(channels) > 1 else None,
        channels=channels if len(channels) > 1 else None,
    )

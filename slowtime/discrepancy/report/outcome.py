"""What a likelihood says of a campaign; verdict, words and report follow from it alike."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

from slowtime.discrepancy.diagnosis import (
    Experiment,
    Gap,
    GapStep,
    MeasuredForce,
    NamedEffect,
    Number,
    Rival,
    Spectra,
    Surface,
    Suspect,
    Traces,
    When,
)
from slowtime.discrepancy.quoting import percent
from slowtime.dynamics.description import Description


@dataclasses.dataclass(frozen=True, slots=True)
class ErrorMeasure:
    """What errors on records that were not fitted are of, in words.

    Parameters
    ----------
    of
        Of what, such as " of the force"; empty for the motion of free runs.
    reached, alone
        Say that an error is the noise floor, and what the noise floor is otherwise.
    """

    of: str = ""
    text: Callable[[float], str] = percent
    reached: str = "the noise floor"
    alone: str = "noise alone would give"


FREE_RUNS = ErrorMeasure()
NEVER = When((), (), "")
NOTHING = "nothing_missing"
"""In place of an effect, among rivals."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Outcome:
    """Hypotheses as one likelihood judges them, of frequencies over slow time for example.

    Fields that are not told here are those of `Answer`.

    Parameters
    ----------
    effects
        That are named, with their rivals; faults of channels that screening found come beside.
    undecided
        What the records cannot tell apart, no effect (`NOTHING`) included; empty where all is
        decided.
    constants_suffice, near_unknown
        Whether wrong constants, or a law near the one named that is not known, are among these.
    unknown
        What is missing, in words, where no effect known here explains it; empty otherwise.
    """

    effects: Sequence[NamedEffect]
    undecided: Sequence[Rival]
    unknown: str
    nothing_probability: float
    residual_white: bool
    white_p_value: float
    nothing: str = "Nothing is missing beyond the stated tolerances."
    moved: Mapping[str, Number] = dataclasses.field(default_factory=dict)
    constants_suffice: bool = False
    near_unknown: bool = False
    experiment: Experiment | None = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CampaignOutcome(Outcome):
    """The same of a campaign; fields that are not told here are those of `Diagnosis`."""

    gap: Gap
    refitted: Description
    augmented: Description
    chi2_per_datum: float
    traces: tuple[Traces, ...]
    spectra: Spectra
    notes: Sequence[str]
    measure: ErrorMeasure = FREE_RUNS
    where: tuple[Suspect, ...] = ()
    when: When = NEVER
    surface: Surface | None = None
    measured_force: MeasuredForce | None = None
    exhausted: bool = False


def gap_of(
    effects: Sequence[NamedEffect],
    errors: Sequence[float],
    *,
    nominal: float,
    floor: float,
    held_out: bool,
    kept: float | None = None,
    worst: float | None = None,
    further: Sequence[GapStep] = (),
) -> Gap:
    """Give the errors of the model as given, refitted, and after each effect.

    Those of the adopted model, and of its worst sensor, are the last where not given.
    """
    steps = (
        GapStep(one.effect.kind, one.effect.place, error)
        for one, error in zip(effects, errors[1:], strict=False)
    )
    kept = errors[-1] if kept is None else kept
    return Gap(
        nominal=nominal,
        refitted_nominal=errors[0],
        steps=(*steps, *further),
        augmented=kept,
        noise_floor=floor,
        on="holdout" if held_out else "tail",
        worst=kept if worst is None else worst,
    )

"""The memory of a twin of elements between epochs, as numbers and text."""

import dataclasses
import math
from typing import Any

from twin_server.estimate.covariates import Condition, Training, condition_of, training_of


@dataclasses.dataclass(frozen=True, slots=True)
class Reference:
    """A mode that the next epoch's modes are compared with.

    Parameters
    ----------
    frequency_hz
        Where it was seen last, evened out a little.
    shape
        Likewise, in displacements, of unit norm; None where no shape was ever seen.
    boot, identity
        What the edge calls it, and in which of its boots.
    missed
        Epochs since it was seen.
    """

    frequency_hz: float
    shape: tuple[float, ...] | None
    boot: str = ""
    identity: int | None = None
    missed: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class ModeSamples:
    """Readings of one mode that were gathered while learning.

    Parameters
    ----------
    epochs
        Frequency [Hz], its sd, damping ratio, its sd; NaN where not known.
    weighted, weight
        Sums of real shapes over their variances, and of the inverse variances, per channel.
    last, last_sd
        The newest of these shapes, NaN where not heard.
    jumped, jumps
        Sum of squared steps from one shape to the next over their variances, and how many
        steps of a component are in it.
    training
        Under covariates, what is gathered instead of `epochs`.
    steps
        The latest steps from one shape to the next over their standard deviations, per
        channel, 0 where not heard.
    """

    epochs: tuple[tuple[float, float, float, float], ...] = ()
    weighted: tuple[float, ...] = ()
    weight: tuple[float, ...] = ()
    last: tuple[float, ...] = ()
    last_sd: tuple[float, ...] = ()
    jumped: float = 0.0
    jumps: int = 0
    training: Training | None = None
    steps: tuple[tuple[float, ...], ...] = ()

    @property
    def count(self) -> int:
        """Number of epochs that have shown the mode."""
        return len(self.epochs) if self.training is None else self.training.offered


@dataclasses.dataclass(frozen=True, slots=True)
class Baseline:
    """One mode of the model, as the structure had it to begin with.

    Parameters
    ----------
    mode
        Its number in the model, 0 for the lowest.
    frequency_hz, relative_sd
        As learnt.
    damping_ratio, damping_relative_sd
        As learnt; NaN where none was found.
    shape, shape_sd
        As learnt, per channel of the model, NaN where not heard; None without shapes.
    scatter, shape_scatter
        How many times farther than their standard deviations said the readings stepped from
        one epoch to the next while learning; those to come are taken to do the same.
    condition
        Under covariates, what is normal for its frequency; the one above is at the reference.
    shape_common
        Patterns of errors that channels had in common from one epoch to the next while
        learning, in standard deviations of their components, 0 where not heard.
    """

    mode: int
    frequency_hz: float
    relative_sd: float
    damping_ratio: float
    damping_relative_sd: float
    shape: tuple[float, ...] | None = None
    shape_sd: tuple[float, ...] | None = None
    scatter: float = 1.0
    shape_scatter: float = 1.0
    condition: Condition | None = None
    shape_common: tuple[tuple[float, ...], ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class ChangeSuspicion:
    """Whether a change is suspected, and the number of consecutive readings against it."""

    word: str
    holds: bool = False
    against: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class ModePool:
    """One mode in the readings of a pool, beside its baseline.

    Parameters
    ----------
    readings
        How many have shown it.
    weight, weighted
        Sum of inverse variances of ln(frequency over the learnt one), and of that times them.
    common
        Largest standard deviation of what all readings have in common [1].
    shape_weight, shape_weighted
        The same sums of the components of shapes, by channel; none without shapes.
    """

    readings: int = 0
    weight: float = 0.0
    weighted: float = 0.0
    common: float = 0.0
    shape_weight: tuple[float, ...] = ()
    shape_weighted: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class ReadingPool:
    """Readings that wait for a comparison with the reference.

    Parameters
    ----------
    modes
        One for each baseline; none without readings.
    readings, since_ns, until_ns
        How many, and the sensor time of the first and the last [ns].
    compared_ns
        Sensor time of the comparison before [ns]; None before the first.
    """

    modes: tuple[ModePool, ...] = ()
    readings: int = 0
    since_ns: int = 0
    until_ns: int = 0
    compared_ns: int | None = None

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> "ReadingPool":
        """Read a pool from the JSON of `dataclasses.asdict`."""
        modes = tuple(
            ModePool(
                **{
                    **one,
                    "shape_weight": tuple(one["shape_weight"]),
                    "shape_weighted": tuple(one["shape_weighted"]),
                }
            )
            for one in content["modes"]
        )
        return cls(**{**content, "modes": modes})


@dataclasses.dataclass(frozen=True, slots=True)
class ElementMemory:
    """State of a twin of elements between epochs.

    Parameters
    ----------
    references
        Modes followed; once learnt, one for each of `baselines`, in the same order.
    lessons
        While learning, one for each of `references`; later none.
    learnt_from, since, until
        Epochs gathered so far, and the least and greatest of their slow times.
    theta
        Where the structure is in the model: logarithms of the factors on all stiffnesses and
        masses; none while learning.
    baselines
        Modes of the model that were found in the structure.
    suspicions
        What is believed to have changed, or is on its way to be.
    unit_doubts
        What was said last of channels whose units are in doubt.
    pool
        Readings since the latest comparison of the members with the reference.
    assessed
        That comparison, as JSON has it; None before the first, or where none is asked for.
    """

    references: tuple[Reference, ...] = ()
    lessons: tuple[ModeSamples, ...] = ()
    learnt_from: int = 0
    theta: tuple[float, ...] = ()
    baselines: tuple[Baseline, ...] = ()
    suspicions: tuple[ChangeSuspicion, ...] = ()
    since: float = math.inf
    until: float = -math.inf
    unit_doubts: tuple[str, ...] = ()
    pool: ReadingPool = ReadingPool()
    assessed: dict[str, Any] | None = None

    @property
    def knows(self) -> bool:
        """Whether learning is over."""
        return bool(self.baselines)

    @property
    def common_share(self) -> float:
        """Share of the variance of an epoch's changes that is due to the baseline.

        That is the same in all epochs. Learning from n epochs leaves the n-th part of the
        variance of one; a law of covariates leaves at most this of what it does not explain.
        """
        laws = [one.condition.law_share for one in self.baselines if one.condition is not None]
        return max(laws, default=1.0 / (1.0 + max(self.learnt_from, 1)))

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> "ElementMemory":
        """Read a memory from the JSON of `dataclasses.asdict`."""
        return cls(
            references=tuple(
                Reference(**{**r, "shape": _floats(r["shape"])}) for r in content["references"]
            ),
            lessons=tuple(
                ModeSamples(
                    tuple((f, s, z, e) for f, s, z, e in one["epochs"]),
                    tuple(one["weighted"]),
                    tuple(one["weight"]),
                    tuple(one["last"]),
                    tuple(one["last_sd"]),
                    one["jumped"],
                    one["jumps"],
                    training_of(one.get("training")),
                    tuple(tuple(step) for step in one.get("steps", ())),
                )
                for one in content["lessons"]
            ),
            learnt_from=content["learnt_from"],
            theta=tuple(content["theta"]),
            baselines=tuple(
                Baseline(
                    **{
                        **b,
                        "shape": _floats(b["shape"]),
                        "shape_sd": _floats(b["shape_sd"]),
                        "condition": condition_of(b.get("condition")),
                        "shape_common": tuple(tuple(p) for p in b.get("shape_common", ())),
                    }
                )
                for b in content["baselines"]
            ),
            suspicions=tuple(ChangeSuspicion(**s) for s in content["suspicions"]),
            since=content.get("since", math.inf),
            until=content.get("until", -math.inf),
            unit_doubts=tuple(content.get("unit_doubts", ())),
            pool=ReadingPool.from_dict(
                content.get("pool") or dataclasses.asdict(ReadingPool())
            ),
            assessed=content.get("assessed"),
        )


def _floats(numbers: list[float] | None) -> tuple[float, ...] | None:
    return None if numbers is None else tuple(numbers)

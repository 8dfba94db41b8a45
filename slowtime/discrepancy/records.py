"""Records of a campaign, in the units and in the order of the description's channels."""

import dataclasses

import numpy as np
import scipy.fft
from jaxtyping import Bool, Float

from slowtime.dynamics.description import Description

MIN_SAMPLES = 64
"""[samples] Least length of a record; spectra and initial states of shorter ones mean nothing.
Source: docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trial:
    """One record: inputs and outputs on one clock.

    Parameters
    ----------
    inputs
        Inputs (time, input) in the units of the description; no columns where the excitation
        was not measured.
    outputs
        Outputs (time, sensor) in the units of the description.
    start_s
        Campaign time of the first sample [s], so that slow changes can be dated.
    use
        False for samples to leave out (time, sensor); where not given, those that are not
        finite.

    Raises
    ------
    ValueError
        Where the rate is not positive, lengths differ, or the record is too short.

    Examples
    --------
    >>> trial = Trial(inputs=np.zeros((100, 1)), outputs=np.ones((100, 2)), rate_hz=50.0)
    >>> trial.duration_s, bool(trial.use.all())
    (2.0, True)
    """

    inputs: Float[np.ndarray, "moment input"]
    outputs: Float[np.ndarray, "time sensor"]
    rate_hz: float
    start_s: float = 0.0
    use: Bool[np.ndarray, "time sensor"] | None = None

    def __post_init__(self) -> None:
        if not (0 < self.rate_hz < np.inf):
            raise ValueError(
                f"rate_hz={self.rate_hz} is not a valid sampling rate. Give one above 0 Hz."
            )
        if len(self.inputs) != len(self.outputs):
            raise ValueError(
                f"Inputs have {len(self.inputs)} samples, outputs {len(self.outputs)}. Cut "
                "both to the time they share."
            )
        if len(self.outputs) < MIN_SAMPLES:
            raise ValueError(
                f"The record has {len(self.outputs)} samples; at least {MIN_SAMPLES} are "
                "needed. Give a longer record."
            )
        finite = np.isfinite(self.outputs)
        kept = finite if self.use is None else self.use & finite
        object.__setattr__(self, "use", kept)

    @property
    def used(self) -> Bool[np.ndarray, "time sensor"]:
        """Mask of the valid samples."""
        assert self.use is not None
        return self.use

    @property
    def measured(self) -> Float[np.ndarray, "time sensor"]:
        """Outputs, with zeros in place of invalid samples."""
        return np.where(self.used, self.outputs, 0.0)

    @property
    def duration_s(self) -> float:
        """Length of the record [s]."""
        return len(self.outputs) / self.rate_hz

    def part(self, first: int, last: int) -> "Trial":
        """Cut out a part of the record, from sample `first` up to `last`, without it."""
        return Trial(
            inputs=self.inputs[first:last],
            outputs=self.outputs[first:last],
            rate_hz=self.rate_hz,
            start_s=self.start_s + first / self.rate_hz,
            use=self.used[first:last],
        )

    def trimmed(self) -> "Trial":
        """Leave out the last few samples, so that the length suits fast Fourier transforms.

        Examples
        --------
        >>> still = np.zeros((8821, 1))  # a prime number of samples
        >>> len(Trial(inputs=still, outputs=still, rate_hz=100.0).trimmed().outputs)
        8820
        """
        return self.part(0, scipy.fft.prev_fast_len(len(self.outputs)))

    @property
    def times_s(self) -> Float[np.ndarray, " time"]:
        """Campaign time of each sample [s]."""
        return self.start_s + np.arange(len(self.outputs)) / self.rate_hz


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Campaign:
    """A model and the records that it is to explain.

    Parameters
    ----------
    trials
        Records that models are fitted to.
    holdout
        Records that models are judged by; nothing is fitted to them.

    Raises
    ------
    ValueError
        Where channels do not fit the description, or an input is not finite.
    """

    description: Description
    trials: tuple[Trial, ...]
    holdout: tuple[Trial, ...] = ()

    def __post_init__(self) -> None:
        if not self.trials:
            raise ValueError("There is no record to learn from. Give at least one trial.")
        if not self.description.sensors:
            raise ValueError(
                "The model lists no sensors. State which quantity each channel measures."
            )
        for trial in (*self.trials, *self.holdout):
            _check_channels(self.description, trial)

    @property
    def ambient(self) -> bool:
        """Whether no input was measured."""
        return not self.description.inputs

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors, in order."""
        return tuple(sensor.channel for sensor in self.description.sensors)


def _check_channels(description: Description, trial: Trial) -> None:
    for what, given, wanted in (
        ("input", trial.inputs.shape[1], len(description.inputs)),
        ("sensor", trial.outputs.shape[1], len(description.sensors)),
    ):
        if given != wanted:
            raise ValueError(
                f"A record has {given} {what} columns, the model lists {wanted}. Give one "
                "column for each, in the model's order."
            )
    bad = ~np.isfinite(trial.inputs)
    if bad.any():
        name = description.inputs[int(np.nonzero(bad.any(axis=0))[0][0])].channel
        raise ValueError(
            f"Input {name!r} is not finite in {int(bad.any(axis=1).sum())} samples. The "
            "excitation must be known throughout the record: fill the gap, or cut the "
            "record there."
        )

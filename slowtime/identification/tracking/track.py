"""The state of one tracked mode: frequency, shape and rate of detection."""

import dataclasses

import numpy as np
from jaxtyping import Complex

from slowtime.identification.estimates import Measured
from slowtime.identification.modes import Mode

from . import frequency as frequencies
from . import shape as shapes
from .frequency import FrequencyBelief
from .shape import ShapeBelief

MEMORY = 50.0
"""Epochs over which the detection rate is averaged."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Track:
    """One followed mode, a candidate as long as `identity` is None.

    Parameters
    ----------
    identity
        Its lasting number.
    frequency, shape
        Where it is believed to be, and what it is believed to look like.
    known_by
        The shape it was first known by, or since its last veering.
    first, last
        Epochs at which it was first and last seen.
    seen, chances
        Epochs that showed it, of those since the first that could have.
    missed
        Epochs since the last sight that could have shown it and did not.
    shows
        Share of recent epochs that showed it [1].
    """

    identity: int | None
    frequency: FrequencyBelief
    shape: ShapeBelief
    known_by: Complex[np.ndarray, " channel"]
    first: int
    last: int
    seen: int = 1
    chances: int = 1
    missed: int = 0
    shows: float = 0.8

    @property
    def frequency_hz(self) -> Measured:
        """Where the frequency is believed to be [Hz]."""
        value = float(np.exp(self.frequency.mean))
        return Measured(value, value * self.frequency.sd)

    def ahead(self, elapsed: float) -> "Track":
        """Predict frequency and shape.

        Parameters
        ----------
        elapsed
            Number of epochs.

        Returns
        -------
        Predicted track.
        """
        return dataclasses.replace(
            self,
            frequency=frequencies.predict_belief(self.frequency, elapsed),
            shape=shapes.predict_belief(self.shape, elapsed),
        )

    def sighted(self, mode: Mode, epoch: int) -> "Track":
        """Update by a mode that belongs to the track.

        Parameters
        ----------
        mode
            Identified mode.
        epoch
            Number of the epoch.

        Returns
        -------
        Updated track.
        """
        where = mode.frequency_hz
        return dataclasses.replace(
            self,
            frequency=frequencies.update(self.frequency, where.value, where.sd),
            shape=shapes.update(self.shape, mode.shape, mode.shape_sd),
            last=epoch,
            seen=self.seen + 1,
            chances=self.chances + 1,
            missed=0,
            shows=self.shows + (1.0 - self.shows) / MEMORY,
        )

    def overlooked(self) -> "Track":
        """Note an epoch that could have shown it and did not."""
        fewer = self.shows - self.shows / MEMORY
        return dataclasses.replace(
            self, missed=self.missed + 1, chances=self.chances + 1, shows=fewer
        )

    def known_anew(self) -> "Track":
        """From now on known by the shape it has now."""
        return dataclasses.replace(self, known_by=self.shape.shape)

    def log_ratio(self, mode: Mode) -> float:
        """Log-likelihood ratio of a mode: this track against any frequency and shape.

        Parameters
        ----------
        mode
            Identified mode.

        Returns
        -------
        Log-ratio.
        """
        where = mode.frequency_hz
        return frequencies.log_density(self.frequency, where.value, where.sd) + (
            shapes.log_ratio(self.shape, mode.shape, mode.shape_sd)
        )


def begin(mode: Mode, epoch: int) -> Track:
    """Track of a new candidate."""
    shape = shapes.initial_belief(mode.shape, mode.shape_sd)
    return Track(
        identity=None,
        frequency=frequencies.initial_belief(mode.frequency_hz.value, mode.frequency_hz.sd),
        shape=shape,
        known_by=shape.shape,
        first=epoch,
        last=epoch,
    )

"""Finds the nominal model that each reading is compared with, given or learnt."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from slowtime_schemas.messages import Features
from twin_server.estimate.checkpoint import Checkpoint, Twin
from twin_server.estimate.columns import Columns
from twin_server.estimate.notices import Notice

from .covariate_removal import remove_covariates
from .learning import learn


@dataclasses.dataclass(frozen=True, slots=True)
class Nominals:
    """The nominal model that each reading is compared with; NaN while it is being learnt.

    Parameters
    ----------
    frequency, relative_sd, damping, damping_relative_sd
        Natural frequency [Hz] and damping ratio, with their errors.
    under_covariates
        Which readings are of a twin whose frequency depends on covariates.
    freed_hz, freed_sd
        Of those, the frequency and its sd at the reference [Hz]; NaN for others.
    reasons
        Bits that stand against those.
    """

    frequency: Float[np.ndarray, " time"]
    relative_sd: Float[np.ndarray, " time"]
    damping: Float[np.ndarray, " time"]
    damping_relative_sd: Float[np.ndarray, " time"]
    under_covariates: Bool[np.ndarray, " time"]
    freed_hz: Float[np.ndarray, " time"]
    freed_sd: Float[np.ndarray, " time"]
    reasons: Int[np.ndarray, " time"]

    @classmethod
    def none(cls, count: int) -> "Nominals":
        """No nominal values known yet."""
        f, f_sd, z, z_sd, freed, freed_sd = np.full((6, count), np.nan)
        never, nothing = np.zeros(count, dtype=bool), np.zeros(count, dtype=np.uint32)
        return cls(f, f_sd, z, z_sd, never, freed, freed_sd, nothing)

    def put(self, rows: Int[np.ndarray, " some"], numbers: Float[np.ndarray, "some 4"]) -> None:
        """Fill in the nominal model of some readings.

        Parameters
        ----------
        rows
            Indices of the readings.
        numbers
            Frequency [Hz], its relative sd [1], damping ratio [1] and its relative sd [1].
        """
        self.frequency[rows], self.relative_sd[rows] = numbers[:, 0], numbers[:, 1]
        self.damping[rows], self.damping_relative_sd[rows] = numbers[:, 2], numbers[:, 3]


def nominals_of(
    twins: Sequence[Twin],
    features: Sequence[Features],
    given: Columns,
    owner: Int[np.ndarray, " time"],
    rows_of: Sequence[Int[np.ndarray, " _"]],
) -> tuple[Nominals, list[Checkpoint], list[list[Notice]]]:
    """Return the nominal values for each reading; without any, the twin learns them here.

    Parameters
    ----------
    twins
        Registrations and checkpoints.
    features
        Features messages of all readings.
    given
        The same as columns.
    owner
        Index into `twins` of each reading.
    rows_of
        Indices of the readings of each twin.

    Returns
    -------
    Nominal values of each reading; new checkpoint and notices of each twin.
    """
    nominals = Nominals.none(len(given))
    checkpoints: list[Checkpoint] = []
    notices: list[list[Notice]] = []
    for twin, rows in zip(twins, rows_of, strict=True):
        conditioned = twin.registration.covariates is not None
        one = _under_covariates if conditioned else _fill_in_nominals
        checkpoint, told = one(twin, features, given, rows, nominals)
        checkpoints.append(checkpoint)
        notices.append(told)
    return nominals, checkpoints, notices


def _fill_in_nominals(
    twin: Twin,
    features: Sequence[Features],
    given: Columns,
    rows: Int[np.ndarray, " some"],
    nominals: Nominals,
) -> tuple[Checkpoint, list[Notice]]:
    """Fill in the given or learnt nominal values, from the reading that ends learning."""
    checkpoint, begins, notices = twin.checkpoint, 0, []
    if checkpoint.known is None:
        epochs = np.column_stack(
            (
                given.frequency_hz[rows],
                given.frequency_sd[rows] * given.learning_factor[rows],
                given.damping_ratio[rows],
                given.damping_sd[rows] * given.learning_factor[rows],
            )
        )
        lesson = learn(
            checkpoint, [tuple(e) for e in epochs.tolist()], twin.registration.learn_epochs
        )
        checkpoint, begins = lesson.checkpoint, lesson.used
        if lesson.nominal is not None:
            notices.append(_learnt(lesson.used - 1, checkpoint))
    known = checkpoint.known
    if known is not None:
        numbers = (
            known.frequency_hz,
            known.frequency_relative_sd,
            known.damping_ratio,
            known.damping_relative_sd,
        )
        nominals.put(rows[begins:], np.broadcast_to(numbers, (len(rows) - begins, 4)))
    return checkpoint, notices


def _under_covariates(
    twin: Twin,
    features: Sequence[Features],
    given: Columns,
    rows: Int[np.ndarray, " some"],
    nominals: Nominals,
) -> tuple[Checkpoint, list[Notice]]:
    """Fill in the readings as they would have been at the reference of the covariates."""
    freed = remove_covariates(
        twin.registration, twin.checkpoint, [features[row] for row in rows], given.of(rows)
    )
    nominals.put(rows, freed.nominal)
    nominals.under_covariates[rows] = True
    nominals.freed_hz[rows], nominals.freed_sd[rows] = freed.frequency_hz, freed.frequency_sd
    nominals.reasons[rows] = freed.reasons
    return freed.checkpoint, freed.notices


def _learnt(row: int, checkpoint: Checkpoint) -> Notice:
    known = checkpoint.known
    assert known is not None
    return Notice(
        row,
        "nominal_learnt",
        "info",
        f"The nominal model has been learnt: {known.frequency_hz:.6g} Hz "
        f"(known to {known.frequency_relative_sd:.2g} of itself)"
        + (
            f", damping ratio {known.damping_ratio:.3g}."
            if checkpoint.has_damping
            else "; no damping ratio was found."
        ),
        checkpoint.nominal() or {},
    )

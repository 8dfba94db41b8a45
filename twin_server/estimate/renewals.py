"""Follows renewals that the edge announces: later readings are of another structure."""

import dataclasses
from collections.abc import Sequence

from slowtime_schemas.messages import Features
from slowtime_schemas.quantities import RENEWALS

from .checkpoint import Checkpoint
from .notices import Notice

RENEWED = "renewed"
"""Kind of the event; it belongs to the first reading of the renewed structure."""


def follow_renewals(
    checkpoint: Checkpoint, features: Sequence[Features]
) -> tuple[Checkpoint, list[Notice]]:
    """Follow how often the structure of one twin was renewed, through its next features.

    The count travels with every reading, so that a lost reading loses no renewal. A count that
    falls is that of an edge that began anew, and announces nothing.
    """
    before, notices = checkpoint.renewals, []
    for row, message in enumerate(features):
        count = message.covariates.get(RENEWALS)
        if count is None or count == before:
            continue
        if before is not None and count > before:
            notices.append(_notice(row, message, count))
        before = count
    if before == checkpoint.renewals:
        return checkpoint, notices
    return dataclasses.replace(checkpoint, renewals=before), notices


def _notice(row: int, message: Features, count: float) -> Notice:
    return Notice(
        row,
        RENEWED,
        "info",
        f"Structure renewed: from reading {message.sequence} on it is as built again. Changes "
        "before and after belong to different structures.",
        {"renewals": count},
    )

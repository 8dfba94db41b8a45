"""What a twin does by itself once its model disagrees with raw samples."""

from typing import Annotated

from pydantic import Field

from slowtime_schemas.quantities import Immutable
from twin_server.orders import Seconds

Probability = Annotated[float, Field(gt=0, le=1)]


class DisagreementPolicy(Immutable):
    """Diagnoses that a twin orders without a person, and what becomes of their results.

    Examples
    --------
    >>> DisagreementPolicy(adopt_above=0.9).tries
    3
    """

    samples_s: Annotated[
        Seconds | None,
        Field(description="Raw samples asked from the edge; by default two comparisons."),
    ] = None
    holdout_s: Annotated[
        Seconds | None, Field(description="Of these, the last, which judge and are not fitted.")
    ] = None
    quick: bool = False
    """Refit fewer rivals, and look for one effect only."""
    tries: Annotated[
        int, Field(ge=1, le=20, description="Diagnoses of one disagreement, of newer samples.")
    ] = 3
    between: Annotated[
        int, Field(ge=1, le=10_000, description="Comparisons from one of them to the next.")
    ] = 10
    adopt_above: Annotated[
        Probability | None,
        Field(
            description="An effect of at least this probability is adopted if the error on "
            "the samples that judge has fallen; null leaves that to a person."
        ),
    ] = None
    adopt_undecided: bool = False
    """Whether the likeliest of several effects that the records do not tell apart is adopted,
    where all of them together are as probable as `adopt_above` asks."""
    undo_after: Annotated[
        int | None,
        Field(
            ge=2,
            le=10_000,
            description="Comparisons in a row by which an adopted model is worse than the "
            "one before, and beyond the limit, after which the adoption is undone; null "
            "leaves that to a person.",
        ),
    ] = None

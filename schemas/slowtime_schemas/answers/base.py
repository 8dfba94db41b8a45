"""What all answers of REST share."""

from typing import Any

from pydantic import (
    BaseModel,
    ConfigDict,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)


class RestAnswer(BaseModel):
    """Immutable; fields that a newer server adds are ignored."""

    # Built at first use: the client asks for few of all answers, and starts sooner.
    model_config = ConfigDict(frozen=True, extra="ignore", defer_build=True)


def _known_or_newer(value: Any, known: ValidatorFunctionWrapHandler) -> Any:
    try:
        return known(value)
    except ValidationError:
        if isinstance(value, str):
            return value
        raise


Extensible = WrapValidator(_known_or_newer)
"""Marks a choice of words to which a newer server may add; an older client takes any word."""

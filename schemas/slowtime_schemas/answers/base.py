"""What all answers of REST share."""

import importlib
from html import escape
from typing import Any, ClassVar

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
    TABLE: ClassVar[str] = ""
    """Field whose members are the rows of the answer's table; none: the answer is one row."""

    def rows(self) -> list[dict[str, Any]]:
        """Return the table of the answer; names of nested values are joined by underscores."""
        members = getattr(self, self.TABLE) if self.TABLE else (self,)
        return [_flat(one.model_dump()) for one in members]

    def to_pandas(self) -> Any:
        """Convert the table of the answer to a pandas DataFrame.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return data_frame(self.rows())

    def _repr_html_(self) -> str:
        said = getattr(self, "sentence", None) or type(self).__name__
        rows = [
            {name: value for name, value in row.items() if not isinstance(value, list | tuple)}
            for row in self.rows()
        ]
        names = list(rows[0]) if rows else []
        heads = "".join(f"<th>{escape(name)}</th>" for name in names)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(_cell(row.get(n)))}</td>" for n in names) + "</tr>"
            for row in rows
        )
        return f"<p>{escape(said)}</p><table><tr>{heads}</tr>{body}</table>"


def data_frame(rows: list[dict[str, Any]]) -> Any:
    """Return rows as a pandas DataFrame.

    Raises
    ------
    ImportError
        If pandas is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module("pandas").DataFrame(rows)
    except ModuleNotFoundError as error:
        raise ImportError(
            "This needs pandas, which is not installed. Install it with: "
            "pip install 'slowtime[tables]'"
        ) from error


def _flat(values: dict[str, Any]) -> dict[str, Any]:
    """Join the names of nested values by underscores."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            found |= {f"{name}_{inner}": one for inner, one in _flat(value).items()}
        else:
            found[name] = value
    return found


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _known_or_newer(value: Any, known: ValidatorFunctionWrapHandler) -> Any:
    try:
        return known(value)
    except ValidationError:
        if isinstance(value, str):
            return value
        raise


Extensible = WrapValidator(_known_or_newer)
"""Marks a choice of words to which a newer server may add; an older client takes any word."""

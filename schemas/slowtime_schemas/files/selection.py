"""File of a person's choice of modes: edits of the automatic choice."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from slowtime_schemas.quantities import Frozen

MOST_EDITS = 1000
"""Edits of one file at most [1]: far more than a record has modes."""

Hertz = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class SelectionEdit(Frozen):
    """One edit: `keep` a pole, `drop` a mode, `merge` modes, or `split` a mode `into` parts."""

    keep: Hertz | None = None
    drop: Hertz | None = None
    merge: Annotated[tuple[Hertz, ...], Field(min_length=2)] | None = None
    split: Hertz | None = None
    into: Annotated[tuple[Hertz, ...], Field(min_length=2)] | None = None
    order: Annotated[int, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _is_one_edit(self) -> "SelectionEdit":
        given = [
            name
            for name in ("keep", "drop", "merge", "split")
            if getattr(self, name) is not None
        ]
        if len(given) != 1:
            raise ValueError("Give one of `keep`, `drop`, `merge` and `split` for each edit")
        if (self.split is None) != (self.into is None):
            raise ValueError("Give `split: 5.36` together with `into: [5.3, 5.4]`")
        if self.order is not None and given[0] in ("drop", "merge"):
            raise ValueError("`order` goes with `keep` and `split`")
        return self


class SelectionFile(Frozen):
    """Edits of the automatic choice of modes; frequencies in Hz."""

    slowtime_selection: Literal[1]
    automatic: bool = True
    edits: Annotated[tuple[SelectionEdit, ...], Field(max_length=MOST_EDITS)] | None = None

"""States of a twin in order, with statistics where they are a selection."""

from collections.abc import Iterable

from slowtime_schemas.answers.history import BandsModel
from slowtime_schemas.answers.twins import State


class TwinHistory(list[State]):
    """States in order: all of a span, or a selection with statistics of all.

    Parameters
    ----------
    bands
        What all readings show, where the states are but some of them; else None.
    """

    def __init__(self, states: Iterable[State], bands: BandsModel | None = None) -> None:
        super().__init__(states)
        self.bands = bands

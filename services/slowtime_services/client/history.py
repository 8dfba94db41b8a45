"""States of a twin in order, with statistics where they are a selection."""

from collections.abc import Iterable
from typing import Any

from slowtime_schemas.answers.base import data_frame
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

    def to_pandas(self) -> Any:
        """Convert the states to a pandas DataFrame.

        Returns
        -------
        One row per state: slow time, then value, sd, lo and hi of the frequency [Hz] and of
        the changes of stiffness and mass [1], and whether the state is valid.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        names = ("frequency_hz", "stiffness_change", "mass_change")
        return data_frame(
            [
                {
                    "slow_time": state.slow_time,
                    **{
                        f"{name}_{part}": getattr(getattr(state, name), part, None)
                        for name in names
                        for part in ("value", "sd", "lo", "hi")
                    },
                    "valid": state.valid,
                }
                for state in self
            ]
        )

"""What a check of `slowtime doctor` returns."""

import dataclasses
from typing import Literal

State = Literal["ok", "note", "problem"]


@dataclasses.dataclass(frozen=True, slots=True)
class CheckLine:
    """One line of the report.

    Parameters
    ----------
    group
        Heading under which it stands.
    name
        What was checked.
    state
        `ok`; `note` where something optional is absent; `problem` where something fails.
    text
        What was found.
    advice
        What to do; empty where nothing has to be done.
    """

    group: str
    name: str
    state: State
    text: str
    advice: str = ""

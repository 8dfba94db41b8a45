"""What a person chooses where modes are identified, declared here alone.

The command line and the Python interface take names, types, defaults and help from
`IdentifyOptions`. This module imports no arithmetic, so that `--help` costs nothing.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal, Protocol, get_args, runtime_checkable

AllChannels = Literal["modes", "bayes", "efdd", "fdd"]
ALL_CHANNELS: tuple[str, ...] = get_args(AllChannels)
"""Methods that find the modes of all channels together, with shapes."""

OneByOne = Literal["auto", "ambient", "free_decay", "peak"]
"""Methods that find one mode after the other, in single channels."""

Method = Literal["auto", AllChannels, "ambient", "free_decay", "peak"]
WITH_POLES = ("modes", "bayes")
"""Methods with poles to choose from."""

Gaps = Literal["use", "fill", "split"]
Action = Literal["keep", "drop", "merge", "split"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """One edit of the automatic choice.

    Parameters
    ----------
    action
        ``keep`` a pole of the diagram; ``drop`` a mode; ``merge`` modes into one; ``split`` a
        mode into several.
    at_hz
        Natural frequencies of the poles or modes meant [Hz].
    into_hz
        Of the parts of a mode that is split [Hz].
    order
        Model order of the poles that are kept or split into; None for that of the longest line
        of poles in the diagram.
    """

    action: Action
    at_hz: tuple[float, ...]
    into_hz: tuple[float, ...] = ()
    order: int | None = None

    def __str__(self) -> str:
        text = f"{self.action} {_listed(self.at_hz)}"
        text += f" into {_listed(self.into_hz)}" if self.into_hz else ""
        return text + (f" (order {self.order})" if self.order is not None else "")


def _listed(values: Sequence[float]) -> str:
    return " and ".join(f"{hz:.5g}" for hz in values) + " Hz"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Edits of the automatic choice.

    Parameters
    ----------
    edits
        In any order.
    automatic
        Whether modes of the automatic choice that no edit names are reported. They are part of
        the model either way, as neighbours.
    """

    edits: tuple[Edit, ...] = ()
    automatic: bool = True

    @property
    def notes(self) -> tuple[str, ...]:
        """What the result says of the choice; nothing where it is the automatic one."""
        if self.automatic and not self.edits:
            return ()
        base = "the automatic choice" if self.automatic else "no mode"
        edits = "; ".join(map(str, self.edits)) or "none"
        return (f"Modes chosen by hand, from {base}: {edits}.",)


@runtime_checkable
class FileName(Protocol):
    """Path of a file, of any class; whoever reads files opens it."""

    def __fspath__(self) -> str:
        """Return the path as text."""
        ...


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyOptions:
    """Options of an identification of modes from responses.

    Parameters
    ----------
    band_hz
        Lowest and highest frequency of the modes that are reported [Hz]; by default, all that
        the record can show. Modes beside it are modelled too, so that its edges change nothing.
    method
        ``auto`` chooses by the kind of record. ``modes``: every mode from all channels
        together, with shapes; lines of rotating machines are marked. ``bayes``: these modes by
        the fast Bayesian FFT. ``efdd``, ``fdd``: frequency domain decomposition, with and
        without damping. ``ambient``, ``free_decay``, ``peak``: mode by mode.
    gaps
        Missing samples. ``use``: all samples that are there count, and errors grow by the loss.
        ``fill``: gaps of up to 10 samples are filled, longer ones cut the record. ``split``:
        every gap cuts it. Of a record that is cut, the longest part is used.
    select
        A person's choice of modes, as edits of the automatic one (keep, drop, merge, split): a
        file or, in Python, a `Selection`. A report and `Modes.to_selection` write such a file.
        It needs a method with poles: ``modes``, which ``auto`` becomes, or ``bayes``.

    Raises
    ------
    ValueError
        If the method has no poles to choose from.
    """

    band_hz: tuple[float, float] | None = None
    method: Method = "auto"
    gaps: Gaps = dataclasses.field(default="use", metadata={"rare": True})
    select: Selection | FileName | str | None = dataclasses.field(
        default=None, metadata={"rare": True}
    )

    def __post_init__(self) -> None:
        if self.select is None:
            return
        if self.method == "auto":
            object.__setattr__(self, "method", "modes")
        if self.method not in WITH_POLES:
            raise ValueError(
                f"select= chooses among poles, which method={self.method!r} has none of. Give "
                "method='modes' or 'bayes'."
            )

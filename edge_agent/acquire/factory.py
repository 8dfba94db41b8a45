"""Opens the source that the settings name."""

import threading

from edge_agent.inputs import BoardsInput, LiveInput
from edge_agent.settings import FileInput, Input, SimulatedInput
from slowtime_services.bus import Bus
from slowtime_services.clock import Clock

from .file import FileSource
from .live import LiveSource, TransportContext, check, importing
from .recording import RecordingSource
from .simulated import SimulatedSource
from .source import BlockSource, Pacer


def check_input(settings: Input) -> None:
    """Refuse an input that cannot be opened, before anything starts.

    Raises `ValueError` where a scheme, a parameter or a library is missing.
    """
    boards = settings.boards if isinstance(settings, BoardsInput) else (settings,)
    for board in boards:
        if isinstance(board, LiveInput):
            check(board)


def open_source(
    settings: Input,
    clock: Clock,
    stop: threading.Event,
    covariates: tuple[str, ...] = (),
    *,
    bus: Bus | None = None,
    twin: tuple[str, str] = ("", ""),
) -> BlockSource:
    """Open the source that the settings name.

    A file's reader keeps the channels `covariates`; samples that come over the bus are those of
    the twin, given by site and asset.
    """
    pacer = Pacer(clock, stop)
    if isinstance(settings, SimulatedInput):
        return SimulatedSource(settings, pacer)
    if isinstance(settings, FileInput):
        return FileSource(settings, pacer, covariates=covariates)
    if isinstance(settings, LiveInput):
        opened = importing(check(settings))(settings, TransportContext(clock, bus, twin))
        return LiveSource(settings, opened, stop)
    if isinstance(settings, BoardsInput):
        raise ValueError("Several boards are opened one by one.")
    return RecordingSource(settings, pacer)

"""Recordings in: as messages, as blocks of samples, or played onto a bus as an edge would."""

from .blocks import block_of, measured_rate, raw_blocks, record_of, record_or_foreign
from .integrity import Supervise, check
from .layout import layout_of
from .ledger_check import LedgerCheck, verdicts
from .player import PLAYED, Played, ReplayProgress, replay
from .recording_reader import (
    Contents,
    RecordedMessage,
    RecordingError,
    contents,
    read_recording,
)

__all__ = [
    "PLAYED",
    "Contents",
    "LedgerCheck",
    "Played",
    "RecordedMessage",
    "RecordingError",
    "ReplayProgress",
    "Supervise",
    "block_of",
    "check",
    "contents",
    "layout_of",
    "measured_rate",
    "raw_blocks",
    "read_recording",
    "record_of",
    "record_or_foreign",
    "replay",
    "verdicts",
]

"""Recordings in: as messages, as blocks of samples, or played onto a bus as an edge would."""

from .blocks import block_of, raw_blocks, record_of
from .playing import Played, Progress, replay
from .reading import Contents, Recorded, RecordingError, contents, read_recording

__all__ = [
    "Contents",
    "Played",
    "Progress",
    "Recorded",
    "RecordingError",
    "block_of",
    "contents",
    "raw_blocks",
    "read_recording",
    "record_of",
    "replay",
]

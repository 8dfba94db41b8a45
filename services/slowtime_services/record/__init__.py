"""Messages in, recordings (MCAP) out; damaged recordings in, sound ones out."""

from .recorder import Recorder, Recording
from .recovery import Recovered, recover
from .writer import RecordingWriter, free_path

__all__ = ["Recorder", "Recording", "RecordingWriter", "Recovered", "free_path", "recover"]

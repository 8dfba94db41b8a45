"""Formats that a library reads: recognised by their first bytes, read in their own process.

A reader is a module of this room with one function, ``read(path, max_bytes) -> Found``, and a
line in `READERS` that says what it recognises and which library it needs. The libraries are
extras; a missing one is named with the line that installs it.
"""

import dataclasses
import importlib.util
import re
from pathlib import Path

from slowtime_services.files.binary import reader_process
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Sheet
from slowtime_services.plugins.discovery import plugins

from .found import Found
from .series_selection import sheet_of

HEAD_BYTES = 4096
OWN = "plugin:"
"""Before the name of an installed part, in the place of a module of this room."""
OURS = frozenset(("", "csv", "txt", "tsv", "dat", "npy", "npz", "mat", "xlsx"))
"""Endings that no part of somebody's own is asked for."""


@dataclasses.dataclass(frozen=True, slots=True)
class Reader:
    """A format: its name, how it is recognised, and the module that reads it.

    Parameters
    ----------
    name
        What people call a file of it, with its article.
    module
        Module of this room.
    suffixes
        Endings of its files' names, in small letters. They decide where `begins` is None.
    begins
        First bytes of its files.
    library, imports
        Name of the library at PyPI, and of what is imported before it is asked; empty where
        slowtime has it, or where the reader looks for it itself.
    gives
        What is read of it.
    """

    name: str
    module: str
    suffixes: tuple[str, ...]
    begins: bytes | None
    library: str
    imports: str
    gives: str

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether a file of that name and those first bytes is of this format."""
        if self.begins is None:
            return path.suffix.lower() in self.suffixes
        return re.match(self.begins, head, re.DOTALL) is not None

    @property
    def installed(self) -> bool:
        """Whether its library is here."""
        return not self.imports or importlib.util.find_spec(self.imports) is not None

    def open(self, path: Path, max_bytes: int, wanted: tuple[str, ...] | None) -> Sheet:
        """Read a file of this format.

        Parameters
        ----------
        max_bytes
            What it may hold at most.
        wanted
            Channels to choose among series of different rates; None for all.

        Raises
        ------
        RecordError
            Where the library is missing, or the file is damaged or holds no series.
        """
        if not self.installed:
            raise RecordError(
                f"{path.name} is {self.name}, which {self.library} reads. Install it: "
                f"pip install 'slowtime[formats]' or pip install {self.library}."
            )
        told, arrays = reader_process.run(
            f"{__name__}.reader_main",
            path,
            max_bytes,
            self.name,
            words=(self.module, self.name),
        )
        return sheet_of(path.name, self.name, Found.of_json(told, arrays), wanted)


READERS: tuple[Reader, ...] = (
    Reader("a TDMS file of National Instruments", "tdms", (".tdms",), rb"TDSm",
           "npTDMS", "nptdms", "channels with units, rate and start of their waveform"),
    Reader("a WAV file", "wav", (".wav",), rb"RI(FF|FX)....WAVE",
           "", "", "channels as they were quantised, and the rate"),
    Reader("a miniSEED file", "seismic", (".mseed", ".msd", ".miniseed"),
           rb"\d{6}[DRQM][ \0]|MS\x03", "obspy", "obspy",
           "traces merged by channel, rate and start; gaps as missing samples"),
    Reader("a SAC file", "seismic", (".sac",), None,
           "obspy", "obspy", "its trace, rate and start"),
    Reader("a GCF file of Güralp", "seismic", (".gcf",), None,
           "obspy", "obspy", "its traces, rate and start"),
    Reader("a SEG-2 file", "seismic", (".sg2", ".seg2"), None,
           "obspy", "obspy", "its traces, rate and start"),
    Reader("a binary universal file (UFF 58b)", "uff", (".uff", ".unv"),
           rb"\s*-1\s*\n\s*58b", "pyuff", "pyuff",
           "evenly spaced time responses, their units and interval"),
    Reader("an HDF5 file", "hdf5", (".h5", ".hdf5", ".hdf", ".sdf5"), rb"\x89HDF\r\n\x1a\n",
           "h5py", "h5py", "datasets of numbers; rate, start and units from attributes"),
    Reader("a Parquet file", "columnar", (".parquet", ".pq"), rb"PAR1",
           "pyarrow", "pyarrow", "columns of numbers, a column of stamps as clock"),
    Reader("an Arrow or Feather file", "columnar", (".arrow", ".feather", ".ipc"), rb"ARROW1",
           "pyarrow", "pyarrow", "columns of numbers, a column of stamps as clock"),
    Reader("a recording of ROS 2 or Foxglove (MCAP)", "ros", (".mcap",), None,
           "mcap-ros2-support", "",
           "sensor_msgs/Imu, geometry_msgs/AccelStamped, accelerations in JSON; their stamps"),
)  # fmt: skip
"""The first that recognises a file reads it."""


def reader_of(path: Path) -> Reader | None:
    """Find the reader of a file; None where none recognises it."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    known = next((one for one in READERS if one.recognises(path, head)), None)
    return known or _own_reader(path.suffix.lower().lstrip("."))


def _own_reader(ending: str) -> Reader | None:
    """Find an installed part that is named after the ending; it runs in a separate process."""
    if ending in OURS:
        return None
    for part in plugins("slowtime.readers"):
        if part.name == ending:
            kind = f"a file for the reader {ending!r} of {part.distribution} {part.version}"
            return Reader(kind, f"{OWN}{ending}", (f".{ending}",), None, "", "", "")
    return None


__all__ = ["READERS", "Found", "Reader", "reader_of"]

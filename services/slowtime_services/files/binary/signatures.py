"""First bytes of binary files, and advice how to read each kind."""

import re
import struct
from pathlib import Path

from slowtime_services.files.record import RecordError

HEAD_BYTES = 4096
_SAC_VERSION_AT, _SAC_VERSION = 304, 6
"""Byte and value of NVHDR, the header version of a SAC file (its manual, "Data file
format")."""

_OBSPY = (
    "Read it with ObsPy: `pip install obspy`, then "
    "`obspy.read(FILE).write(OUT, format='SLIST')`"
)
_PANDAS = "then `pandas.{reader}(FILE).to_csv(OUT, index=False)`"
_UNPACK = "Unpack it first ({tool}), and give the file inside"

_SIGNATURES: tuple[tuple[bytes, str, str], ...] = (
    (rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an old Excel workbook (.xls) or OLE file",
     "Save its sheet as CSV, or read it with pandas: `pip install pandas xlrd`, "
     + _PANDAS.format(reader="read_excel")),
    (rb"\x1f\x8b", "packed with gzip", _UNPACK.format(tool="gunzip")),
    (rb"BZh[1-9]", "packed with bzip2", _UNPACK.format(tool="bunzip2")),
    (rb"\xfd7zXZ\0", "packed with xz", _UNPACK.format(tool="unxz")),
    (rb"7z\xbc\xaf\x27\x1c", "a 7z archive", _UNPACK.format(tool="7z x")),
    (rb"\x28\xb5\x2f\xfd", "packed with zstd", _UNPACK.format(tool="unzstd")),
    (rb"Rar!\x1a\x07", "a RAR archive", _UNPACK.format(tool="unrar x")),
    (rb"#ROSBAG V", "a ROS 1 bag", "Turn it into CSV, a topic a file"),
    (rb"MATLAB 5\.0 MAT-file", "a MATLAB file", "Name it .mat"),
    (rb"\x93NUMPY", "a NumPy file", "Name it .npy"),
    (rb"\x80[\x02-\x05]", "a Python pickle, which can run code when opened and is never read",
     "Save plain numeric arrays instead, with `numpy.savez`"),
    (rb"SQLite format 3\0", "an SQLite database", "Export its table as CSV"),
    (rb"MDF     |UnFinMF ", "an ASAM MDF file",
     "Read it with asammdf: `pip install asammdf`, then `asammdf.MDF(FILE).export('csv')`"),
    (rb"\|CF,", "an imc FAMOS file", "Export it from imc FAMOS as text or as MATLAB"),
    (rb"\"?TOB[123]\"?,", "a binary table of a Campbell logger (TOB)",
     "Turn it into TOA5 with Campbell's CardConvert or LoggerNet"),
    (rb"DEWESoft|DEWE|DSDF", "a Dewesoft file", "Export it from Dewesoft as text or as MATLAB"),
    (rb"fLaC", "a FLAC sound file", "Turn it into WAV, and that into NumPy"),
    (rb"OggS|ID3|....ftyp", "a sound or video file", "Give the samples themselves"),
    (rb"%PDF|\x89PNG|\xff\xd8\xff|GIF8", "a document or picture, not samples",
     "Give the samples themselves"),
    (rb"\x7fELF|MZ[\x00-\xff]\x00", "a program", "Give a file of samples"),
)  # fmt: skip
_COMPILED = tuple((re.compile(form, re.DOTALL), kind, way) for form, kind, way in _SIGNATURES)
"""Start of a file, what it is, and how to read it."""

_SUFFIXES = {
    ".wdq": "a WinDaq file", ".dxd": "a Dewesoft file", ".d7d": "a Dewesoft file",
    ".evt": "a Kinemetrics event file", ".segy": "a SEG-Y file", ".sgy": "a SEG-Y file",
}  # fmt: skip
"""What a binary file of this suffix is, where its first bytes do not say."""

_OBSPY_SUFFIXES = frozenset((".segy", ".sgy"))


def refuse_binary(path: Path) -> None:
    """Refuse a file of a known binary kind.

    Raises
    ------
    RecordError
        Which names the kind and a way to turn the file into one that is read.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    found = _kind_of(head, path)
    if found is not None:
        kind, way = found
        joint = " is " if kind.startswith(("a ", "an ", "packed")) else ": "
        raise RecordError(f"{path.name}{joint}{kind}, which is not read as it stands. {way}.")


def _kind_of(head: bytes, path: Path) -> tuple[str, str] | None:
    if head[:4] == b"PK\x03\x04":
        return _zip_kind(head)
    for form, kind, way in _COMPILED:
        if form.match(head):
            return kind, way
    if len(head) > _SAC_VERSION_AT + 4 and b"\0" in head:
        if _SAC_VERSION in (
            struct.unpack_from(f"{o}i", head, _SAC_VERSION_AT)[0] for o in "<>"
        ):
            return "a SAC file", "Name it .sac"
        suffix = path.suffix.lower()
        if suffix in _SUFFIXES:
            way = _OBSPY if suffix in _OBSPY_SUFFIXES else "Export it as text or as MATLAB"
            return f"{_SUFFIXES[suffix]} by its name", way
    return None


def _zip_kind(head: bytes) -> tuple[str, str]:
    if b"xl/" in head or b"[Content_Types].xml" in head:
        return "an Excel workbook", "Name it .xlsx"
    if b"opendocument" in head:
        return "a spreadsheet of OpenDocument", "Save its sheet as CSV"
    if b".npy" in head:
        return "a NumPy archive", "Name it .npz"
    return "a zip archive", _UNPACK.format(tool="unzip")

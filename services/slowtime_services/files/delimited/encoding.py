"""Character encoding of a text file: byte order marks, UTF-16, old code pages."""

import re
from pathlib import Path

from slowtime_services.files.record import RecordError

ALLOWED = "Allowed: text, .npy, .npz, .mat and the formats of docs/files.md."
SAMPLE_BYTES = 4096
BYTE_ORDER_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""First bytes of text in UTF-16."""
ZEROS_OF_UTF16 = 0.4
"""Share of zero bytes at every second place from which text is taken for UTF-16: of Latin
letters and digits it is nearly 1, of other scripts less, of binary numbers both
places have some."""

_MINUS = str.maketrans({"\u2212": "-", "\ufeff": None})
_NARROW = re.compile("(?<=\\d)[\u00a0\u2009\u202f](?=\\d{3})")
"""A fixed or thin space between thousands."""


def decode(path: Path) -> str:
    """Text of a file, with plain minus signs and no spaces inside of numbers.

    Raises
    ------
    RecordError
        Where it is no text.
    """
    with path.open("rb") as file:
        head = file.read(SAMPLE_BYTES)
        if not head.startswith(BYTE_ORDER_MARKS):
            _text(head[:-3], path.name)  # devices have no end; binary files are refused by it
        raw = head + file.read()
    return _NARROW.sub("", _text(raw, path.name).translate(_MINUS))


def _text(raw: bytes, name: str) -> str:
    if raw.startswith(BYTE_ORDER_MARKS):
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError as error:
            raise RecordError(
                f"{name} begins as UTF-16 text and is none: {error.reason} at byte "
                f"{error.start}. {ALLOWED}"
            ) from error
    sample = raw[:SAMPLE_BYTES]
    if b"\0" in sample:
        for codec, zeros, others in (
            ("utf-16-le", sample[1::2], sample[::2]),
            ("utf-16-be", sample[::2], sample[1::2]),
        ):
            if zeros.count(0) >= ZEROS_OF_UTF16 * len(zeros) and 0 not in others:
                return raw.decode(codec, errors="replace")
        raise RecordError(f"{name} is not text: it holds zero bytes. {ALLOWED}")
    for codec in ("utf-8-sig", "cp1252"):
        try:
            return raw.decode(codec)
        except UnicodeDecodeError:
            continue
    return raw.decode("latin-1")

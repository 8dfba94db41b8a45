"""Finds lines and frames in byte streams; bytes between them are garbage."""

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from edge_agent.acquire.live.batch import GarbledError
from edge_agent.layouts import CsvLayout, JsonLayout, PackedLayout

from .packed import is_sound, read_header, samples_of

MOST_LINE_BYTES = 2**20
"""Bytes of a line, beyond which it is garbage."""
MOST_WAITING_BYTES = 2**16
"""Longest frame whose length stands in its header: a false one would hold up those after it."""
CHECKED_PER_BYTE = 16
"""Bytes that are checked in vain for each byte that comes, at most [1]. Garbage has a sync by
chance every 2**16 bytes; what has more of them was made to be checked again and again."""
MOST_CHECKED_BYTES = 16 * MOST_WAITING_BYTES
"""Of those, what is saved up while frames are sound [bytes]: some false frames in a row."""


@runtime_checkable
class Framer(Protocol):
    """Finds messages in a stream."""

    garbage_bytes: int

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Messages that are complete with `data`."""
        ...

    def reset(self) -> None:
        """Discard the incomplete message, because the connection has changed."""
        ...


def framer_of(layout: JsonLayout | CsvLayout | PackedLayout) -> Framer:
    """Return the framer for the messages of a layout.

    Raises `ValueError` where frames could not be found again after garbage.
    """
    if not isinstance(layout, PackedLayout):
        return LineFramer()
    if not layout.sync:
        raise ValueError(
            "A packed layout on a byte stream was given without `sync`: frames could not be "
            "found again after a lost byte. Give the bytes that each begins with, such as "
            "sync = 'a55a', or send datagrams."
        )
    if layout.samples is None and "samples" not in (what for what, _, _ in layout.fields):
        raise ValueError(
            "A packed layout on a byte stream was given that does not say how long a frame is. "
            "Give `samples`, or 'samples:u8' in the header."
        )
    return FrameFramer(layout)


class LineFramer:
    """Lines end with a line feed; comments, headings and too long lines are garbage.

    Examples
    --------
    >>> framer = LineFramer()
    >>> list(framer.feed(b"1,2" + bytes([10]) + b"3")), list(framer.feed(b",4" + bytes([10])))
    ([b'1,2'], [b'3,4'])
    """

    def __init__(self) -> None:
        self.garbage_bytes = 0
        self._begun = bytearray()
        self._overlong = False

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Lines that are complete with `data`, without their ends."""
        first, *others = data.split(b"\n")
        # Appended in place: a line that comes byte by byte is not copied with each of them.
        self._begun += first
        for following in others:
            line, self._begun = self._begun, bytearray(following)
            if self._overlong:
                self.garbage_bytes += len(line) + 1
                self._overlong = False
            elif stripped := bytes(line).strip():
                yield stripped
        if len(self._begun) > MOST_LINE_BYTES:
            self.garbage_bytes += len(self._begun)
            self._begun, self._overlong = bytearray(), True

    def reset(self) -> None:
        """Discard the incomplete line."""
        self.garbage_bytes += len(self._begun)
        self._begun, self._overlong = bytearray(), False


class FrameFramer:
    """Finds frames by sync bytes, and verifies them by length and checksum.

    Without a checksum, a frame after garbage is believed once another one follows it.
    """

    def __init__(self, layout: PackedLayout) -> None:
        self.garbage_bytes = 0
        self._layout, self._sync = layout, layout.sync_bytes
        self._buffer = bytearray()
        self._locked = layout.checksum != "none"
        self._checks_left = MOST_CHECKED_BYTES

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Frames that are complete with `data`."""
        self._buffer += data
        more = CHECKED_PER_BYTE * len(data)
        self._checks_left = min(self._checks_left + more, MOST_CHECKED_BYTES)
        while self._skip_to_sync():
            size = self._frame_bytes()
            if size is None:
                return
            if size == 0 or (len(self._buffer) >= size and not self._believes(size)):
                self._drop(self._false_bytes(size))
                self._locked = self._layout.checksum != "none"
                continue
            needed = size if self._locked else size + len(self._sync)
            if len(self._buffer) < needed:
                return
            frame = bytes(self._buffer[:size])
            del self._buffer[:size]
            self._locked = True
            yield frame

    def reset(self) -> None:
        """Discard the incomplete frame."""
        self._drop(len(self._buffer))
        self._locked = self._layout.checksum != "none"

    def _skip_to_sync(self) -> bool:
        """Drop bytes before the next sync; False if there is none yet."""
        place = self._buffer.find(self._sync)
        if place > 0:
            self._locked = self._layout.checksum != "none"
        if place >= 0:
            self._drop(place)
            return True
        # The end of it may be the beginning of a sync.
        self._drop(max(0, len(self._buffer) - len(self._sync) + 1))
        return False

    def _frame_bytes(self) -> int | None:
        """Length of the frame that begins here; 0 where it cannot be one, None to wait."""
        if len(self._buffer) < self._layout.begin_bytes:
            return None
        try:
            header = read_header(self._layout, bytes(self._buffer[: self._layout.begin_bytes]))
            count = samples_of(self._layout, header)
        except GarbledError:
            return 0
        if count is None or count < 1:
            return 0
        size = self._layout.frame_bytes(count)
        fixed = count == self._layout.samples
        return size if fixed or size <= MOST_WAITING_BYTES else 0

    def _believes(self, size: int) -> bool:
        if self._layout.checksum != "none":
            return is_sound(self._layout, bytes(self._buffer[:size]))
        following = self._buffer[size : size + len(self._sync)]
        return self._locked or self._sync.startswith(bytes(following))

    def _false_bytes(self, size: int) -> int:
        """Bytes to drop of a false frame: one, or all where too many were checked in vain."""
        if size <= self._checks_left:
            self._checks_left -= size
            return 1
        return size

    def _drop(self, count: int) -> None:
        self.garbage_bytes += count
        del self._buffer[:count]

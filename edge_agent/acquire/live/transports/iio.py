"""Linux industrial I/O: devices of `/sys/bus/iio`, read by their buffer."""

import functools
import logging
import os
import select
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.formats.iio_scan import Scan, batches_of, element_of, scan_of
from edge_agent.acquire.live.registry import Opened, TransportContext
from edge_agent.inputs import LiveInput
from edge_agent.layouts import Channel, JsonLayout, Stamp
from slowtime_services.clock import Clock

from .limits import AT_ONCE, POLL_S

logger = logging.getLogger(__name__)

UNITS = {"accel": "m/s^2", "anglvel": "rad/s", "voltage": "mV", "magn": "G", "temp": "mdegC"}
"""Units after scale and offset, by kind of channel, as the kernel's documents fix them."""


class Device:
    """One device of a tree of sysfs."""

    def __init__(self, root: Path, name: str) -> None:
        self._all = root / "sys/bus/iio/devices"
        self.folder = self._device_folder(name)
        self.node = root / "dev" / self.folder.name

    def _device_folder(self, name: str) -> Path:
        devices = sorted(self._all.glob("iio:device*"))
        for device in devices:
            if name == device.name or name == _text(device / "name"):
                return device
        there = ", ".join(f"{d.name} ({_text(d / 'name')})" for d in devices) or "none"
        raise ValueError(f"No device is called {name!r} in {self._all}. There: {there}.")

    def elements(self) -> list[str]:
        """Names of all scan elements, in the order of a scan."""
        found = self.folder.glob("scan_elements/in_*_index")
        names = [path.name[3:-6] for path in found]
        return sorted(names, key=lambda n: int(_text(self._scan(n, "index")) or 0))

    def enabled(self) -> list[str]:
        """Names of those that are enabled."""
        return [name for name in self.elements() if _text(self._scan(name, "en")) == "1"]

    def type_of(self, name: str) -> str:
        """Type string of an element."""
        return _text(self._scan(name, "type"))

    def number(self, name: str, what: str, otherwise: float) -> float:
        """Scale or offset of a channel: its own, that of its kind, or what is given.

        The number is in the units of the kernel's interface; `what` is ``scale`` or ``offset``.
        """
        kind = name.split("_")[0].rstrip("0123456789")
        for stem in (f"in_{name}", f"in_{kind}"):
            if text := _text(self.folder / f"{stem}_{what}"):
                return float(text)
        return otherwise

    def rate_hz(self) -> float | None:
        """Return the sampling frequency, if the device states it."""
        path = self._frequency()
        return None if path is None else float(_text(path) or 0) or None

    def set_up(self, chosen: Sequence[str], rate_hz: float | None, length: int) -> None:
        """Enable the chosen channels.

        The rate is unchanged where None; the buffer holds `length` scans. Raises `ValueError`
        where that needs rights that this process has not.
        """
        try:
            _write(self.folder / "buffer/enable", "0")
            for name in self.elements():
                _write(self._scan(name, "en"), str(int(name in chosen)))
            path = self._frequency()
            if rate_hz is not None and path is not None:
                _write(path, f"{rate_hz:g}")
            _write(self.folder / "buffer/length", str(length))
            _write(self.folder / "buffer/enable", "1")
        except PermissionError as error:
            if set(self.enabled()) == set(chosen) and self.is_running():
                return
            raise ValueError(
                f"{error.filename} may not be written. Run the agent in a group that may (a "
                "udev rule), or enable the buffer before it starts."
            ) from error

    def is_running(self) -> bool:
        """Whether the buffer is enabled."""
        return _text(self.folder / "buffer/enable") == "1"

    def _frequency(self) -> Path | None:
        found = sorted(self.folder.glob("*sampling_frequency"))
        return found[0] if found else None

    def _scan(self, name: str, what: str) -> Path:
        return self.folder / "scan_elements" / f"in_{name}_{what}"


class Buffer:
    """Whole scans out of the device node."""

    is_stream = ends = False

    def __init__(
        self, device: Device, scan: Scan, set_up: functools.partial[None], clock: Clock
    ) -> None:
        self._device, self._scan, self._set_up, self._clock = device, scan, set_up, clock

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Return scans as they arrive; a device that was gone is set up again."""
        self._set_up()
        node = os.open(self._device.node, os.O_RDONLY | os.O_NONBLOCK)
        begun = b""
        try:
            while not stop.is_set():
                ready, _, _ = select.select([node], [], [], POLL_S)
                data = _read(node) if ready else None
                if data == b"":
                    return
                if data is None:
                    yield None
                    continue
                begun += data
                whole = len(begun) // self._scan.size * self._scan.size
                if whole:
                    yield Packet(begun[:whole], self._clock.now_ns())
                    begun = begun[whole:]
        finally:
            os.close(node)

    def close(self) -> None:
        """Do nothing: each connection closes its own resources."""


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Find the device, choose its channels and read how they are packed."""
    device = Device(
        settings.sysfs, settings.source.partition(":")[2].strip("/").partition("?")[0]
    )
    words = settings.parameters
    every = device.elements()
    chosen = words["channels"].split(",") if "channels" in words else device.enabled() or every
    missing = sorted(set(chosen) - set(every))
    if missing or not set(chosen) - {"timestamp"}:
        raise ValueError(f"{device.folder.name} has no channels {missing}. There: {every}.")
    if "timestamp" in every and "timestamp" not in chosen:
        chosen = [*chosen, "timestamp"]
    chosen = [name for name in every if name in chosen]
    scan = scan_of(tuple(element_of(name, device.type_of(name)) for name in chosen))
    names = tuple(name for name in chosen if name != "timestamp")
    rate_hz = settings.rate_hz or device.rate_hz()
    if rate_hz is None:
        raise ValueError(f"{device.folder.name} does not say its rate. Give ?rate_hz=.")
    layout = JsonLayout(
        channels=tuple(_channel(device, name) for name in names),
        stamp=Stamp(at="timestamp", unit="ns", clock="utc") if "timestamp" in chosen else None,
    )
    length = int(words.get("length", "4096"))
    set_up = functools.partial(device.set_up, chosen, settings.rate_hz, length)
    decode = functools.partial(batches_of, scan, names)
    return Opened(Buffer(device, scan, set_up, around.clock), layout, rate_hz, decode)


def _channel(device: Device, name: str) -> Channel:
    kind = name.split("_")[0].rstrip("0123456789")
    return Channel(
        name=name,
        unit=UNITS.get(kind, "1"),
        scale=device.number(name, "scale", 1.0),
        # The kernel adds its offset before it scales; a layout takes its own off.
        offset=-device.number(name, "offset", 0.0),
    )


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _write(path: Path, text: str) -> None:
    if path.exists():
        path.write_text(text)


def _read(node: int) -> bytes | None:
    try:
        return os.read(node, AT_ONCE)
    except BlockingIOError:
        return None

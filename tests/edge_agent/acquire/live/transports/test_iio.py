"""Industrial I/O over a tree that looks like sysfs, and a FIFO that looks like the device."""

import struct
import threading
import time

import numpy as np
import pytest

from edge_agent.acquire import open_source
from edge_agent.acquire.live.formats.iio_scan import element_of, scan_of, values_of
from edge_agent.inputs import LiveInput
from slowtime_services.clock import SystemClock
from tests.edge_agent.acquire.live.listening import opened
from tests.edge_agent.acquire.live.sysfs import SCALE, scan, tree


def test_scans_of_a_buffer_become_blocks_in_si_units_with_their_stamps(tmp_path):
    device, stop = tree(tmp_path), threading.Event()
    live = LiveInput(
        source="iio:///adxl355?channels=accel_x,accel_z", sysfs=tmp_path, rate_hz=250
    )
    whole = LiveInput(source="iio:///iio:device0", sysfs=tmp_path)
    assert opened(whole, stop)._opened.rate_hz == 125.0
    source = opened(live, stop)
    start_ns = time.time_ns()

    def write():
        with (tmp_path / "dev/iio:device0").open("wb", buffering=0) as node:
            for n in range(500):
                if n != 77:
                    # Elements that are not enabled are not in a scan.
                    data = struct.pack(">2I", (n << 12) & 0xFFFFFFFF, ((-n) << 12) & 0xFFFFFFFF)
                    node.write(data + struct.pack("<q", start_ns + n * 4_000_000))
                time.sleep(0.0005)

    writer = threading.Thread(target=write)
    writer.start()
    blocks, taken = [], 0
    for block in source:
        blocks.append(block)
        taken += len(block.samples)
        if taken == 499:
            break
    stop.set()
    writer.join()
    assert blocks[0].channels == ("accel_x", "accel_z")
    assert blocks[0].units == ("m/s^2", "m/s^2")
    for block in blocks:
        numbers = np.arange(block.first_index, block.next_index)
        np.testing.assert_allclose(block.samples, np.c_[numbers, -numbers] * SCALE, rtol=1e-6)
        assert block.start_ns == pytest.approx(
            start_ns + block.first_index * 4_000_000, abs=5e6
        )
    assert source.counts()["samples_lost"] == 1
    assert (device / "buffer/enable").read_text() == "1"
    assert (device / "in_accel_sampling_frequency").read_text() == "250"
    enabled = [
        n
        for n in ("x", "y", "z")
        if (device / f"scan_elements/in_accel_{n}_en").read_text() == "1"
    ]
    assert enabled == ["x", "z"]


def test_a_device_or_channel_that_is_not_there_is_answered_with_those_that_are(tmp_path):
    tree(tmp_path)
    stop = threading.Event()
    with pytest.raises(ValueError, match=r"'mpu6050'.*There: iio:device0 \(adxl355\)"):
        open_source(LiveInput(source="iio:///mpu6050", sysfs=tmp_path), SystemClock(), stop)
    with pytest.raises(ValueError, match=r"no channels \['accel_q'\]. There: \['accel_x'"):
        open_source(
            LiveInput(source="iio:///adxl355?channels=accel_q", sysfs=tmp_path),
            SystemClock(),
            stop,
        )


@pytest.mark.parametrize(
    ("kind", "data", "value"),
    [
        ("le:s16/16>>0", "feff", -2),
        ("be:u12/16>>4", "fff0", 4095),
        ("be:s12/16>>4", "fff0", -1),
        ("le:s20/32>>4", "f0ffff00", -1),
        ("le:s64/64>>0", "ffffffffffffffff", -1),
        ("le:u64/64>>0", "ffffffffffffffff", 2**64 - 1),
    ],
)
def test_type_strings_say_what_numbers_are(kind, data, value):
    whole = scan_of((element_of("a", kind),))
    assert int(values_of(whole, bytes.fromhex(data))["a"][0]) == value
    packed = scan([1, -1, 2], 5)
    parts = tuple(element_of(n, "be:s20/32>>12") for n in "xyz")
    layout = scan_of((*parts, element_of("timestamp", "le:s64/64>>0")))
    assert {k: v.tolist() for k, v in values_of(layout, packed).items()} == {
        "x": [1], "y": [-1], "z": [2], "timestamp": [5],
    }  # fmt: skip


def test_a_type_that_is_none_is_refused():
    for text in ("s16/16>>0", "le:s16/16X4>>0", "le:s16/16>>8"):
        with pytest.raises(ValueError, match="has the type"):
            element_of("a", text)

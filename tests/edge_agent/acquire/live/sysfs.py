"""A tree that looks like sysfs with an ADXL355, and scans as its driver packs them."""

import os
import struct

SCALE = 3.824e-5


def tree(root, *, rate_hz=125, name="adxl355"):
    """Make a device of three axes of 20 bits and a stamp, as the driver `adxl355` shows it."""
    device = root / "sys/bus/iio/devices/iio:device0"
    (device / "scan_elements").mkdir(parents=True)
    (device / "buffer").mkdir()
    (root / "dev").mkdir()
    os.mkfifo(root / "dev/iio:device0")
    texts = {
        "name": name, "in_accel_scale": f"{SCALE:.6e}", "in_temp_scale": "-0.1",
        "in_accel_sampling_frequency": str(rate_hz), "buffer/enable": "1", "buffer/length": "2",
    }  # fmt: skip
    for n, axis in enumerate("xyz"):
        texts[f"scan_elements/in_accel_{axis}_en"] = "0"
        texts[f"scan_elements/in_accel_{axis}_index"] = str(n)
        texts[f"scan_elements/in_accel_{axis}_type"] = "be:s20/32>>12"
    texts |= {
        "scan_elements/in_timestamp_en": "0", "scan_elements/in_timestamp_index": "3",
        "scan_elements/in_timestamp_type": "le:s64/64>>0",
    }  # fmt: skip
    for place, text in texts.items():
        (device / place).write_text(text + "\n")
    return device


def scan(values, stamp_ns):
    """Pack one scan as the kernel would: 3 x 4 bytes, 4 of padding, 8 of stamp."""
    return struct.pack(">3I", *((v << 12) & 0xFFFFFFFF for v in values)) + struct.pack(
        "<4xq", stamp_ns
    )

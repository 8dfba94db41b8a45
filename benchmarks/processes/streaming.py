"""What an edge's windows and long files cost: shares of a core, multiples of their own bytes.

`python -m benchmarks.processes.streaming` takes some minutes; `--hours 24` reads a day of 16
channels instead of half an hour. Each case runs in a process of its own, whose peak of memory
is measured against that of one which has only imported what the case needs.

CPU is a share of the window's own length. `slow core` is that share on a core a quarter as fast
as this one, which a Raspberry Pi 4 is about.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.signal as sps

from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.detection.resonance_peaks import separate_peaks
from slowtime.identification.recursive import RecursiveModes
from slowtime.identification.single_mode.estimation import first_mode
from slowtime_services.files import open_record

SLOW = 4.0
MOST_OF_FAST = 0.25
"""Share of a core that a window of 60 s at 50 kHz may take."""
MOST_OF_SLOW = 0.10
"""Share of a slow core that 3 channels at 200 Hz may take."""
MOST_BYTES = 6.0
"""Memory of a window at 50 kHz, in units of its own bytes."""
MOST_MIB = 500.0
"""Resident memory of a file of any length."""
MODES_HZ = (1.2, 3.1, 7.7, 16.0)


def sway(count: int, channels: int, rate_hz: float, seed: int) -> np.ndarray:
    """Motion of some modes, heard by all channels, with a tenth of noise."""
    rng = np.random.default_rng(seed)
    samples = 0.1 * rng.standard_normal((count, channels))
    for hz in MODES_HZ:
        pole = np.exp((-0.01 + 1j) * 2 * np.pi * hz / rate_hz)
        motion = sps.lfilter(
            [1.0], [1.0, -2 * pole.real, abs(pole) ** 2], rng.standard_normal(count)
        )
        samples += np.outer(motion / motion.std(), rng.standard_normal(channels))
    return samples


def window(method: str, channels: int, seconds: float, rate_hz: float) -> dict[str, float]:
    """CPU and memory of one window."""
    samples = sway(round(seconds * rate_hz), channels, rate_hz, 1)
    identify = first_mode if method == "auto" else identify_modes
    identify(samples[: round(10 * 64 * rate_hz / 50)][:20_000], rate_hz)
    idle = _resident_now()
    began = time.process_time()
    identify(samples, rate_hz)
    spent = time.process_time() - began
    # The window itself is among what was resident before.
    bytes_taken = _resident_peak() - idle + samples.nbytes
    return {"cpu_s": spent, "share": spent / seconds, "bytes": bytes_taken / samples.nbytes}


def single_mode(count: int, windows: int = 4) -> tuple[float, float]:
    """Processor time of a warm single-mode window, and of one FFT of it [ms].

    A mode of 1 Hz and 2 % at 50 Hz, with 5 % of noise; windows follow one another.
    """
    rate_hz, pole = 50.0, np.exp((-0.02 + 1j) * 2 * np.pi / 50.0)
    rng = np.random.default_rng(1)
    force = rng.standard_normal((windows + 1) * count)
    samples = sps.lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], force)
    samples += 0.05 * samples.std() * rng.standard_normal(len(samples))
    spent = []
    for first in range(0, len(samples), count):
        began = time.process_time()
        first_mode(samples[first : first + count], rate_hz)
        spent.append(time.process_time() - began)
    began = time.process_time()
    for _ in range(100):
        np.fft.rfft(samples[:count])
    transform = (time.process_time() - began) / 100
    return 1e3 * float(np.median(spent[1:])), 1e3 * transform


def long_file(hours: float, channels: int, rate_hz: float) -> dict[str, float]:
    """CPU and memory of a long file read as a stream, piece by piece."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.npy"
        count, step = round(hours * 3600 * rate_hz), round(600 * rate_hz)
        whole = np.lib.format.open_memmap(path, mode="w+", dtype="<f4", shape=(count, channels))
        for first in range(0, count, step):
            whole[first : first + step] = sway(min(step, count - first), channels, rate_hz, 1)
        del whole
        recursive = RecursiveModes(rate_hz=rate_hz, band_hz=(0.5, 25.0), every_s=1e9)
        state, began = recursive.start(), time.process_time()
        with open_record(path, rate_hz=rate_hz) as opened:
            for block, _ in opened.blocks:
                state, _ = recursive.step(state, np.asarray(block.samples, dtype=float))
        modes = recursive.solved(state)
        spent = time.process_time() - began
    share = spent / (hours * 3600)
    return {"mib": _resident_peak() / 2**20, "share": share, "modes": float(len(modes))}


def peaks() -> float:
    """Cost of separating twice as many peaks, in units of 2 (1 + 1 / log2 n) of n log n."""
    took = []
    for count in (200_000, 400_000):
        level = np.random.default_rng(1).standard_normal(count)
        tops = sps.find_peaks(level)[0]
        times = []
        for _ in range(3):
            began = time.process_time()
            separate_peaks(level, tops, np.full(len(tops), 3.0))
            times.append(time.process_time() - began)
        took.append(min(times))
    return float(took[1] / took[0] / (2 * (1 + 1 / np.log2(200_000))))


def _resident_now() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def _resident_peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _apart(*case: str) -> dict[str, float]:
    """Run a case in a process of its own."""
    ran = subprocess.run(
        [sys.executable, "-m", "benchmarks.processes.streaming", "--case", *case],
        check=True,
        capture_output=True,
        text=True,
    )
    found: dict[str, float] = json.loads(ran.stdout)
    return found


def _case(what: str, *given: str) -> dict[str, float]:
    if what == "window":
        method, channels, seconds, rate_hz = given
        return window(method, int(channels), float(seconds), float(rate_hz))
    hours, channels, rate_hz = given
    return long_file(float(hours), int(channels), float(rate_hz))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print every figure; 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--hours", default="0.5", help="of the long file")
    parser.add_argument("--case", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.case:
        print(json.dumps(_case(*given.case)))
        return 0
    fine = True
    growth = peaks()
    fine &= growth < 1.5
    print(f"twice as many peaks, over n log n: {growth:.2f}")
    print("window                          CPU / its length   on a slow core   bytes / its own")
    for method in ("auto", "modes"):
        for channels, seconds, rate_hz in (
            (1, 60, 50_000),
            *((n, 600, 200) for n in (3, 16, 64)),
        ):
            found = _apart("window", method, str(channels), str(seconds), str(rate_hz))
            name = f"{method:6} {channels:3} × {seconds:4} s at {rate_hz:6} Hz"
            slow = SLOW * found["share"]
            print(f"{name}   {found['share']:10.4f} {slow:16.4f} {found['bytes']:16.1f}")
            if rate_hz == 50_000:
                fine &= found["share"] <= MOST_OF_FAST and found["bytes"] <= MOST_BYTES
            elif channels == 3:
                fine &= slow <= MOST_OF_SLOW
    print("single-mode window, warm              ms   in FFTs of it")
    for count in (3_000, 36_000):
        spent, transform = single_mode(count)
        print(f"{count:6} samples {spent:24.0f} {spent / transform:14,.0f}")
    found = _apart("long", given.hours, "16", "200")
    fine &= found["mib"] <= MOST_MIB
    print(
        f"{given.hours} h × 16 channels × 200 Hz as a stream: CPU / its length "
        f"{found['share']:.4f}, {found['mib'] / MOST_MIB:.2f} of {MOST_MIB:.0f} MiB"
    )
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())

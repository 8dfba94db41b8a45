"""Files that nobody should hand in: each is read, or refused in a sentence; none hangs."""

import contextlib
import io
import random
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from slowtime_schemas.streams import FEATURES, RAW
from slowtime_services.files import read_record
from slowtime_services.models import read_model
from slowtime_services.record import RecordingWriter, recover
from slowtime_services.replay import contents, raw_blocks, read_recording
from tests.services.loggers.made import table, wrapped

from .mutate import mutated
from .reader_server import children
from .wire import GOOD, NOW_NS

PATIENCE_S = 120
MOST_BYTES = 64 << 20
MODEL = (Path(__file__).parents[2] / "schemas/golden/model_file/v1.yaml").read_bytes()


def _made(write: Callable[[Any], object], name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def _hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["acc"], file["fs"] = np.random.default_rng(0).normal(size=(2, 50)), [[100.0]]


def _mcap(path: Path) -> None:
    payloads = dict(GOOD)
    with RecordingWriter(path) as writer:
        for stream in (FEATURES, RAW):
            key = stream.key("lab", "beam-1")
            for payload in payloads[key]:
                writer.write(stream, "lab", "beam-1", payload, NOW_NS, NOW_NS)


def logged(rows: int = 40) -> list[bytes]:
    """Text of loggers: stamps, counters, headings with figures, wrapped series, formats."""
    rng = random.Random(5)
    made = [
        table(rng, clock=clock, facts=None, name="", rows=rows, side=side).content
        for clock, side in (
            ("iso", "status"), ("micros, wrapping", "count"), ("american", "magnitude"),
            ("datum; zeit", "constant"), ("excel", "empty"), ("six columns", ""),
            ("past midnight", "packet"), ("hhmmss", ""), ("whole seconds", "second"),
        )
    ]  # fmt: skip
    made += [
        table(rng, clock=None, facts=facts, name="", rows=rows).content
        for facts in ("decimated", "german, short", "hms", "ascii", "thousands")
    ]
    made += [wrapped(rng, kind, "", 8, rows).content for kind in ("peer", "csmip", "duration")]
    numbers = "".join(f"{i % 7 - 3:9d}" + "\n" * (i % 8 == 7) for i in range(rows))
    knet = "Station Code      X\nSampling Freq(Hz) 100Hz\nScale Factor      2(gal)/8\nMemo.\n"
    head = (
        f"TIMESERIES XX_A__BHZ, {rows} samples, 100 sps, 2024-04-21T15:00:00, SLIST, FLOAT, g\n"
    )
    lvm = (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\n***End_of_Header***\n"
        "Channels\t1\nSamples\t8\nDelta_X\t0.01\n***End_of_Header***\nX_Value\ta\n"
    )
    unv = (
        "    -1\n    58\na\nb\nc\nd\ne\n 1 1 0 0 NONE 7 3 NONE 0 0\n"
        f" 2 {rows} 1 0.0 1.0E-02 0.0\n 17 0 0 0 Time s\n 12 0 0 0 A g\n 0\n 0\n"
    )
    made += [(text + numbers).encode() for text in (knet, head)]
    made += [(lvm + "\t1.5\n" * 8).encode(), f"{unv}{numbers}    -1\n".encode()]
    return made


def _good() -> dict[str, list[bytes]]:
    values = np.random.default_rng(0).normal(size=(60, 3))
    text = io.StringIO()
    np.savetxt(text, values, delimiter=",", header="t [s],acc_x [g],acc_y [g]", fmt="%.5f")
    plain = text.getvalue().encode()
    return {
        ".csv": [plain, plain.replace(b",", b"\t"), plain.replace(b",", b";"), *logged()],
        ".npy": [_made(lambda p: np.save(p, values), "a.npy")],
        ".npz": [_made(lambda p: np.savez(p, acc=values, fs=100.0), "a.npz"),
                 _made(lambda p: np.savez_compressed(p, acc=values, fs=100.0), "a.npz")],
        ".mat": [_made(lambda p: scipy.io.savemat(p, {"acc": values, "fs": 100.0}), "a.mat"),
                 _made(lambda p: scipy.io.savemat(
                     p, {"s": {"acc": values}, "fs": 9.0}, do_compression=True), "a.mat"),
                 _made(_hdf5, "a.mat")],
        ".yaml": [MODEL],
        ".mcap": [_made(_mcap, "a.mcap")],
    }  # fmt: skip


GOOD_FILES = _good()


def read(path: Path) -> None:
    """Everything that slowtime does with a file of this kind before it believes it."""
    if path.suffix == ".yaml":
        read_model(path)
    elif path.suffix == ".mcap":
        with contextlib.suppress(ValueError, OSError):
            recover(path, path.with_name("recovered.mcap"))
        path.with_name("recovered.mcap").unlink(missing_ok=True)
        contents(path)
        for _ in read_recording(path):
            pass
        for _ in raw_blocks(path, site="lab", asset="beam-1"):
            pass
    else:
        with contextlib.suppress(ValueError):
            read_record(path, max_bytes=MOST_BYTES, skip_missing=True)
        read_record(path, rate_hz=100.0, max_bytes=MOST_BYTES)


@contextlib.contextmanager
def in_time() -> Iterator[None]:
    """Raise where something takes longer than `PATIENCE_S`."""

    def late(*_: object) -> None:
        raise TimeoutError(f"longer than {PATIENCE_S} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def run(cases: int, seed: int, kinds: tuple[str, ...] = tuple(GOOD_FILES)) -> dict[str, int]:
    """Read `cases` files; how many of each kind were read and refused. Raises all else."""
    rng, counts = random.Random(seed), dict[str, int]()
    with tempfile.TemporaryDirectory() as folder, children():
        for number in range(cases):
            kind = kinds[number % len(kinds)]
            path = Path(folder) / f"handed-in{kind}"
            path.write_bytes(mutated(GOOD_FILES[kind], rng))
            try:
                with in_time():
                    read(path)
                came = "read"
            except TimeoutError:
                raise
            except (ValueError, OSError) as error:
                came = "refused" if 10 < len(str(error)) < 5_000 else f"said {error!r}"
            except BaseException:
                print(f"case {number} of seed {seed}, {kind}: {path.read_bytes()[:4000]!r}")
                raise
            assert came in ("read", "refused"), came
            counts[f"{kind} {came}"] = counts.get(f"{kind} {came}", 0) + 1
    return counts

"""Files of the formats of the field, made bad: each is read or refused, in bounds, by name."""

import io
import json
import random
import re
import struct
import subprocess
import sys
import tempfile
import time
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import scipy.io.wavfile

from slowtime_services.exports import write_universal
from slowtime_services.files import Record, RecordError, read_record
from slowtime_services.modal import read_modes

from .mutate import mutated
from .workers import worker

RATE_HZ, ROWS = 200.0, 120
PATIENCE_S = 60.0
MOST_BYTES = 16 << 20
APART_EVERY = 500
"""Files after which one is read by a process of its own, as users' files are."""
SAMPLES = np.random.default_rng(9).standard_normal((ROWS, 3))
SIZES = (0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1, 10**9, 10**12, 2**63 - 1)
"""Counts that no file of a few kilobytes holds."""


def _written(write: Callable[[Path], object], ending: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / f"a{ending}"
        write(path)
        return path.read_bytes()


def _tdms(path: Path) -> None:
    import nptdms

    says = {"wf_increment": 1 / RATE_HZ, "unit_string": "g",
            "wf_start_time": np.datetime64("2024-03-05")}  # fmt: skip
    with nptdms.TdmsWriter(path) as writer:
        for part in (SAMPLES[:60], SAMPLES[60:]):
            writer.write_segment(
                [nptdms.ChannelObject("g", f"a{i}", part[:, i], says) for i in range(3)]
            )


def _wav(path: Path) -> None:
    scipy.io.wavfile.write(path, 8000, (8000 * SAMPLES[:, :2]).astype(np.int16))


def _seismic(form: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        import obspy

        says = {"network": "AA", "station": "B", "channel": "HNZ", "sampling_rate": RATE_HZ,
                "starttime": obspy.UTCDateTime(2024, 3, 5)}  # fmt: skip
        kind = np.int32 if form == "GCF" else np.float32
        values = (1000 * np.tile(SAMPLES[:, 0], 8)).astype(kind)
        obspy.Stream([obspy.Trace(values, says)]).write(
            str(path), format=form, **({"reclen": 512} if form == "MSEED" else {})
        )

    return write


def _uff(path: Path) -> None:
    write_universal(
        path,
        Record(samples=SAMPLES, rate_hz=RATE_HZ, channels=("x", "y", "z"), units=("g",) * 3),
    )


def _hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("run/acceleration")
        group.attrs["fs"] = RATE_HZ
        for i in range(3):
            group.create_dataset(f"a{i}", data=SAMPLES[:, i], compression="gzip")
            group[f"a{i}"].attrs["units"] = "g"
        file["link"] = h5py.SoftLink("/run")


def _arrow(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.feather
    import pyarrow.parquet

    steps = pa.array(np.arange(ROWS) * 5_000_000 + 10**18, pa.timestamp("ns"))
    table = pa.table([steps, *SAMPLES.T], names=["time", "x", "y", "z"])
    if path.suffix == ".parquet":
        pyarrow.parquet.write_table(table, path)
    else:
        pyarrow.feather.write_feather(table, str(path))


def _xlsx(path: Path) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["t [s]", "x [g]", "y [g]"])
    for i, row in enumerate(SAMPLES[:40].tolist()):
        book.active.append([i / RATE_HZ, *row[:2]])
    book.save(path)


def _ros(path: Path) -> None:
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kinds, name = types.types, "geometry_msgs/msg/AccelStamped"
    folder = path.with_name("bag")
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as out:
        topic = out.add_connection("/a", name, typestore=types)
        vector = kinds["geometry_msgs/msg/Vector3"]
        for i, row in enumerate(SAMPLES.tolist()):
            at = 10**18 + i * 5_000_000
            stamp = kinds["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9)
            body = kinds[name](
                kinds["std_msgs/msg/Header"](stamp, "a"),
                kinds["geometry_msgs/msg/Accel"](vector(*row), vector(0.0, 0.0, 0.0)),
            )
            out.write(topic, at, types.serialize_cdr(body, name))
    path.write_bytes(next(folder.glob("*.mcap")).read_bytes())


def _json(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/imu", "json", writer.register_schema("Imu", "jsonschema", b"{}")
        )
        for i, (x, y, z) in enumerate(SAMPLES.tolist()):
            at = 10**18 + i * 5_000_000
            stamp = {"sec": at // 10**9, "nsec": at % 10**9}
            body = {"timestamp": stamp, "linear_acceleration": {"x": x, "y": y, "z": z}}
            writer.add_message(channel, at, json.dumps(body).encode(), at)
        writer.finish()


def _modes(path: Path) -> None:
    import pyuff

    shape = SAMPLES[:8] + 1j * SAMPLES[8:16]
    one = {"type": 55, "model_type": 1, "analysis_type": 3, "data_ch": 2, "load_case": 1,
           "spec_data_type": 12, "mode_n": 1, "node_nums": np.arange(1, 9), "r1": shape[:, 0],
           "r2": shape[:, 1], "r3": shape[:, 2], "eig": -1.0 + 60.0j}  # fmt: skip
    ones = np.ones(8, dtype=int)
    nodes = {"type": 15, "node_nums": np.arange(1, 9), "def_cs": ones, "disp_cs": ones,
             "color": ones, "x": 1.0 * ones, "y": 2.0 * ones, "z": 3.0 * ones}  # fmt: skip
    file = pyuff.UFF(str(path))
    file.write_sets([nodes], "overwrite")
    file.write_sets([one, {**one, "mode_n": 2}], "add")


def _lvm(path: Path) -> None:
    head = (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tYes\n"
        "***End_of_Header***\nChannels\t2\nSamples\t120\t120\nY_Unit_Label\tg\tg\n"
        "Date\t2024/03/05\t2024/03/05\nTime\t06:07:08\t06:07:08\nDelta_X\t0.005\t0.005\n"
        "***End_of_Header***\nX_Value\tx\ty\tComment\n"
    )
    rows = (f"{i / RATE_HZ:.6f}\t{x:.6f}\t{y:.6f}\n" for i, (x, y, _) in enumerate(SAMPLES))
    path.write_text(head + "".join(rows))


MAKERS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "tdms": (".tdms", _tdms),
    "wav": (".wav", _wav),
    "mseed": (".mseed", _seismic("MSEED")),
    "sac": (".sac", _seismic("SAC")),
    "gcf": (".gcf", _seismic("GCF")),
    "uff": (".uff", _uff),
    "hdf5": (".h5", _hdf5),
    "parquet": (".parquet", _arrow),
    "feather": (".feather", _arrow),
    "xlsx": (".xlsx", _xlsx),
    "ros2": (".mcap", _ros),
    "json": (".mcap", _json),
    "lvm": (".lvm", _lvm),
    "modes": (".unv", _modes),
}
"""Formats, the endings of their files, and what writes a good one."""


def hostile(good: bytes, kind: str, rng: random.Random) -> bytes:
    """Make a good file bad, as mutation does, or as an attacker who knows the format."""
    chosen = rng.randrange(8)
    if kind == "xlsx" and chosen < 6:
        return _zipped(good, rng)
    if chosen == 0:
        return good[: rng.randrange(len(good))]
    if chosen in (1, 2):  # a count that the file cannot hold
        body = bytearray(good)
        form = rng.choice(("<I", ">I", "<Q", ">Q", "<H", ">H"))
        at = rng.randrange(min(len(body) - 8, 4096))
        size = struct.calcsize(form)
        struct.pack_into(form, body, at, rng.choice(SIZES) & (256**size - 1))
        return bytes(body)
    if chosen == 3:  # a number as text
        text = good.decode("latin-1")
        digits = [i for i, c in enumerate(text[:20_000]) if c.isdigit()]
        if digits:
            at = rng.choice(digits)
            text = text[:at] + str(rng.choice((*SIZES, "-1", "nan", "1e999"))) + text[at + 1 :]
        return text.encode("latin-1", "replace")
    if kind == "json" and chosen == 4:
        deep = b'{"a":' * rng.choice((50, 2_000)) + b"1"
        return good.replace(b'{"timestamp"', deep + b'{"timestamp"', 1)
    return mutated([good], rng)


def _zipped(good: bytes, rng: random.Random) -> bytes:
    """Change the inside of a workbook: a cell far out, entities, a bomb, deep nesting."""
    out = io.BytesIO()
    chosen = rng.randrange(6)
    with zipfile.ZipFile(io.BytesIO(good)) as source, zipfile.ZipFile(out, "w", 8) as target:
        for item in source.infolist():
            body = source.read(item)
            if item.filename.endswith("sheet1.xml"):
                if chosen == 0:
                    body = body.replace(b'r="C3"', b'r="XFD1048576"')
                elif chosen == 1:
                    bomb = b"".join(
                        b'<!ENTITY e%d "%s">' % (n, b"&e%d;" % (n - 1) * 10)
                        for n in range(1, 20)
                    )
                    body = b'<!DOCTYPE a [<!ENTITY e0 "lol">' + bomb + b"]>" + body
                    body = body.replace(b"<v>", b"<v>&e19;", 1)
                elif chosen == 2:
                    body = body.replace(b"</sheetData>", b" " * (1 << 25) + b"</sheetData>")
                elif chosen == 3:
                    body = body.replace(b"<sheetData>", b"<sheetData>" + b"<row>" * 100_000)
                elif chosen == 4:
                    body = body.replace(b'ref="A1:C41"', b'ref="A1:XFD1048576"')
            if chosen == 5 or rng.randrange(6) == 0:
                body = mutated([body], rng)
            target.writestr(item.filename, body)
    return out.getvalue()


def read(path: Path, kind: str) -> tuple[float | None, bool]:
    """Read a file as its users do; its rate, where it is a record, and whether all was read."""
    if kind == "modes":
        read_modes(path)
        return None, True
    record = read_record(path, max_bytes=MOST_BYTES, skip_missing=True)
    return record.rate_hz, not any("truncated or damaged" in note for note in record.notes)


def run(cases: int, seed: int, kinds: tuple[str, ...] = tuple(MAKERS)) -> Counter[str]:
    """Read `cases` files of each format; how many were read and refused. Raises all else."""
    counts: Counter[str] = Counter()
    with worker(PATIENCE_S) as reader:
        for kind in kinds:
            counts.update(_of_kind(kind, cases, seed))
        counts["readers that died"] = reader.died
        counts[f"readers that were ended after {PATIENCE_S:g} s"] = reader.late
    return counts


def _of_kind(kind: str, cases: int, seed: int) -> Counter[str]:
    rng, counts = random.Random(f"{seed} {kind}"), Counter[str]()
    ending, write = MAKERS[kind]
    good, longest = _written(write, ending), 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"handed-in{ending}"
        path.write_bytes(good)
        right, whole = read(path, kind)
        assert whole, f"a good file of kind {kind} is called damaged"
        for number in range(cases):
            path.write_bytes(hostile(good, kind, rng))
            began = time.monotonic()
            try:
                came = _one(path, kind, right)
            except BaseException:
                print(f"case {number} of seed {seed}, {kind}: {path.read_bytes()[:4000]!r}")
                raise
            longest = max(longest, time.monotonic() - began)
            counts[f"{kind} {came}"] += 1
            if number % APART_EVERY == APART_EVERY - 1:
                _same_apart(path, kind, right, came)
        counts[f"{kind} longest [ms]"] = round(1e3 * longest)
    return counts


def _one(path: Path, kind: str, right: float | None) -> str:
    try:
        rate, whole = read(path, kind)
    except (RecordError, OSError) as error:
        _is_sentence(str(error), path.name)
        return "refused"
    if not whole:
        return "read in part"
    return "read" if rate == right else "read at another rate"


def _is_sentence(said: str, name: str) -> None:
    assert re.search(rf"{re.escape(name)}|Line \d|[Cc]olumn|row \d", said), f"no place: {said}"
    assert 10 < len(said) < 5_000, f"of {len(said)} characters: {said[:500]}"
    assert "Traceback" not in said, said


def _same_apart(path: Path, kind: str, right: float | None, came: str) -> None:
    """Let a process of its own read the same file: it must come to the same."""
    words = [str(path), kind, repr(right)]
    command = ["-c", f"from {__name__} import alone; alone()", *words]
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, *command], capture_output=True, cwd=root, timeout=300, check=True
    )
    assert done.stdout.decode().strip() == came, (came, done.stdout)


def alone() -> None:
    """Read the file that the command line names, its reader in a process of its own."""
    path, kind, right = sys.argv[1:]
    print(_one(Path(path), kind, None if right == "None" else float(right)))

"""Files made to do harm: each is refused in a sentence, quickly, and runs nothing."""

import io
import os
import pickle
import resource
import struct
import zipfile
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import scipy.io
import zstandard
from mcap.records import Chunk
from mcap.writer import CompressionType, IndexType, Writer

from slowtime_services.files import RecordError, read_record
from slowtime_services.models import read_model
from slowtime_services.record import chunks, recover
from slowtime_services.record.chunks import plain
from slowtime_services.replay import contents, read_recording
from tests.fuzz.files import in_time

CAUGHT = "ran.txt"


class Harmful:
    def __reduce__(self):
        return os.system, (f"touch {CAUGHT}",)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not Path(CAUGHT).exists(), "a file ran code"


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.mat", "b.npy", "c.npz"])
def test_a_pickle_is_never_opened(here, name):
    harmful = np.array([Harmful()], dtype=object)
    if name == "b.npy":
        Path(name).write_bytes(pickle.dumps(Harmful()))
    elif name == "c.npz":
        with zipfile.ZipFile(name, "w") as archive:
            archive.writestr("acc.npy", pickle.dumps(Harmful()))
    elif name.endswith("npy"):
        np.save(name, harmful)
    elif name.endswith("npz"):
        np.savez(name, acc=harmful, fs=9.0)
    else:
        scipy.io.savemat(name, {"acc": np.frombuffer(pickle.dumps(Harmful()), np.uint8)})
    if name == "a.mat":  # bytes are numbers, and are read as such
        read_record(name, rate_hz=10.0)
        return
    with pytest.raises(ValueError, match=name):
        read_record(name, rate_hz=10.0)


@pytest.mark.parametrize(
    "text",
    [
        f"!!python/object/apply:os.system ['touch {CAUGHT}']",
        f"slowtime_model: !!python/object/new:os.system ['touch {CAUGHT}']",
        "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]",
        "[" * 100_000,
        "{a: " * 20_000,
        "a: " + "9" * 500_000,
        "slowtime_model: 1\nname: \x00",
        "? " * 30_000,
        "- " * 30_000,
        "a: 0x" + "f" * 100_000,
        "a: 1" + ":59" * 20_000,
    ],
    ids=lambda text: text[:12].encode("unicode_escape").decode(),
)
def test_a_model_file_runs_nothing_and_unfolds_to_nothing(text):
    Path("m.yaml").write_text(text)
    with in_time(), pytest.raises(ValueError, match=r"m\.yaml") as refused:
        read_model("m.yaml")
    assert len(str(refused.value)) < 5_000


def npy_of(shape: str) -> bytes:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"
    header += " " * (63 - (10 + len(header)) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()


@pytest.mark.parametrize(
    "shape", ["(1099511627776,)", "(2305843009213693952, 8)", "(-1,)", "(1e9,)", "(True,)"]
)
def test_a_header_that_promises_the_moon_takes_no_memory(shape):
    Path("a.npy").write_bytes(npy_of(shape) + b"\0" * 64)
    with zipfile.ZipFile("a.npz", "w") as archive:
        archive.writestr("acc.npy", npy_of(shape) + b"\0" * 64)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name in ("a.npy", "a.npz"):
        with in_time(), pytest.raises(ValueError, match=name):
            read_record(name, rate_hz=10.0)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def test_an_archive_that_unpacks_to_gigabytes_is_not_unpacked():
    with zipfile.ZipFile("a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("acc.npy", "w", force_zip64=True) as member:
            member.write(npy_of("(2097152,)"))
            for _ in range(4):
                member.write(bytes(1 << 22))
    assert Path("a.npz").stat().st_size < 1 << 20
    with in_time(), pytest.raises(ValueError, match="MiB"):
        read_record("a.npz", rate_hz=10.0, max_bytes=1 << 22)


def chunk_of(compression: str, data: bytes, stated: int):
    return Chunk(
        compression=compression, data=data, message_end_time=0, message_start_time=0,
        uncompressed_crc=0, uncompressed_size=stated,
    )  # fmt: skip


@pytest.mark.parametrize("stated", [10, 1 << 20, (1 << 28) + 1, (1 << 64) - 1])
def test_a_chunk_unpacks_to_what_it_states_and_no_further(stated):
    huge = bytes(1 << 27)
    for kind, packed in (("zstd", zstandard.compress(huge)), ("lz4", lz4.frame.compress(huge))):
        with in_time(), pytest.raises(ValueError, match="a chunk"):
            plain(chunk_of(kind, packed, stated))
    with pytest.raises(ValueError, match="not zstd or lz4"):
        plain(chunk_of("bz2", b"", 0))


def test_a_recording_of_a_few_kilobytes_stays_one(monkeypatch):
    monkeypatch.setattr(chunks, "LARGEST_CHUNK", 1 << 22)
    with open("bomb.mcap", "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD, chunk_size=1 << 24)
        writer.start()
        schema = writer.register_schema("features", "jsonschema", b"{}")
        channel = writer.register_channel("slowtime/v1/lab/beam/features", "json", schema)
        writer.add_message(channel, 0, bytes(1 << 23), 0)
        writer.finish()
    assert Path("bomb.mcap").stat().st_size < 1 << 14
    with pytest.raises(ValueError, match="8 MiB; at most 4 MiB"):
        list(read_recording("bomb.mcap"))
    assert recover("bomb.mcap", "out.mcap").damaged_chunks == 1


def test_a_recording_without_an_index_is_read_all_the_same():
    for chunking in (True, False):
        file = io.BytesIO()
        writer = Writer(file, use_chunking=chunking, index_types=IndexType.NONE)
        writer.start()
        schema = writer.register_schema("features", "jsonschema", b"{}")
        channel = writer.register_channel("slowtime/v1/lab/beam/features", "json", schema)
        writer.add_message(channel, 5, b"{}", 5)
        writer.finish()
        Path("a.mcap").write_bytes(file.getvalue())
        assert contents("a.mcap").counts == {"slowtime/v2/lab/features/174/beam": 1}
        assert [m.payload for m in read_recording("a.mcap")] == [b"{}"]


@pytest.mark.parametrize(
    "text",
    [
        "," * 500_000 + "\n",
        "1,2\n" * 3 + "x" * 1_000_000,
        "\n" * 500_000,
        "\x00" * 100_000,
        "t;acc\n" + "1e400;nan\n" * 50,
        "rate_hz: " + "9" * 100_000 + "\n1\n2\n",
        '"' * 100_000,
        "a" * 50_000 + "," + "b" * 50_000 + "\n1,2\n3,4\n",
    ],
    ids=lambda text: text[:12].encode("unicode_escape").decode(),
)
def test_a_table_made_to_take_for_ever_does_not(text):
    Path("a.csv").write_text(text)
    said = ""
    with in_time():
        try:
            read_record("a.csv", rate_hz=10.0)
        except ValueError as error:
            said = str(error)
    assert len(said) < 5_000


def test_a_refusal_is_not_as_long_as_what_it_refuses(tmp_path):
    """The two names that an archive gives its member differ, and one is 30,000 bytes long."""
    path = tmp_path / "a.npz"
    np.savez(path, acc=np.zeros(4000))
    content = bytearray(path.read_bytes())
    content[26:28] = (30_000).to_bytes(2, "little")
    path.write_bytes(content)
    with pytest.raises(RecordError, match=r"cannot be read as \.npz") as refused:
        read_record(path)
    assert len(str(refused.value)) < 1_000


def test_a_workbook_of_one_cell_in_its_last_corner_is_refused():
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active["XFD1048576"] = 1.0
    book.save("a.xlsx")
    with (
        in_time(),
        pytest.raises(RecordError, match=r"a\.xlsx states more cells than its size explains"),
    ):
        read_record("a.xlsx", max_bytes=1 << 24)

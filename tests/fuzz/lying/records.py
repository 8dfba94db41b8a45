"""Record files that lie: about their size, about where their samples are, about their nesting."""

import gzip
import io
import json
import struct
import wave
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .cases import Case

ROWS = 2_000
RATE_HZ = 100.0
FAR = 2_000_000_000
"""Samples that a small file claims to hold: 16 GB of doubles."""
UNPACKED = 900_000_000
"""Bytes that a small file unpacks to; few enough to be below every absolute bound."""


def samples(columns: int = 2) -> np.ndarray:
    return np.random.default_rng(5).normal(size=(ROWS, columns))


# NumPy


def npy(path: Path) -> None:
    np.save(path, samples())


def npy_of_more_rows(path: Path) -> None:
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({FAR}, 2), }}"
    head = head.ljust(117) + "\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())


def npy_with_a_heading_of_digits(path: Path) -> None:
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({'9' * 9000}, 2), }}\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())


def npy_with_a_nested_heading(path: Path) -> None:
    head = f"{{'descr': {'(' * 9000}, 'fortran_order': False, 'shape': (2, 2), }}\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())


def npy_of_empty_rows(path: Path) -> None:
    """Write a shape of no bytes with 2e9 rows."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({FAR}, 0), }}"
    head = head.ljust(117) + "\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())


def npz(path: Path) -> None:
    np.savez(path, acc=samples(), fs=RATE_HZ)


def npz_of_zeros(path: Path) -> None:
    _deflated_npz(path, UNPACKED // 8)


def npz_of_more_rows(path: Path) -> None:
    """A member that states more rows than it holds bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        buffer = io.BytesIO()
        np.save(buffer, samples())
        body = buffer.getvalue().replace(b"(2000, 2), }  ", b"(70000000, 2),}")[
            : len(buffer.getvalue())
        ]
        archive.writestr("acc.npy", body)


def npz_that_states_smaller_members(path: Path) -> None:
    """The directory says 1 kB of what unpacks to 1.5 GB."""
    _deflated_npz(path, UNPACKED // 8)
    body = bytearray(path.read_bytes())
    at = body.rfind(b"PK\x01\x02")
    struct.pack_into("<I", body, at + 24, 1000)
    path.write_bytes(body)


def _deflated_npz(path: Path, count: int) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("acc.npy", "w", force_zip64=False) as member:
            head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}"
            head = head.ljust(117) + "\n"
            member.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())
            block = bytes(1 << 24)
            for _ in range(8 * count // len(block)):
                member.write(block)
            member.write(bytes(8 * count % len(block)))


# MATLAB


def mat(path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, {"acc": samples(), "fs": RATE_HZ}, do_compression=True)


def _mat_element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def _mat_file(path: Path, shape: tuple[int, int], data: bytes, name: bytes = b"acc") -> None:
    inner = (
        _mat_element(6, struct.pack("<II", 6, 0))
        + _mat_element(5, struct.pack("<2i", *shape))
        + _mat_element(1, name)
        + data
    )
    matrix = struct.pack("<II", 14, len(inner) & 0xFFFFFFFF) + inner
    packed = zlib.compress(matrix, 9)
    head = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack(
        "<HH", 0x0100, 0x4D49
    )
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def mat_of_zeros(path: Path) -> None:
    """Bytes as doubles: the file may store small integers of an array of doubles as int8."""
    size = UNPACKED // 12
    data = struct.pack("<II", 1, size) + bytes(size)
    _mat_file(path, (size, 1), data)


def mat_of_more_rows(path: Path) -> None:
    _mat_file(path, (120_000_000, 1), struct.pack("<II", 9, 960_000_000) + bytes(64))


def mat_of_negative_size(path: Path) -> None:
    _mat_file(path, (-1, -120_000_000), struct.pack("<II", 9, 0xFFFFFFF8) + bytes(64))


def mat_of_nested_cells(path: Path) -> None:
    inner = b""
    for _ in range(20_000):
        inner = (
            _mat_element(6, struct.pack("<II", 1, 0))
            + _mat_element(5, struct.pack("<2i", 1, 1))
            + _mat_element(1, b"c")
            + (struct.pack("<II", 14, len(inner)) + inner if inner else b"")
        )
        if len(inner) > 1_500_000:
            break
    packed = zlib.compress(struct.pack("<II", 14, len(inner)) + inner, 9)
    head = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack(
        "<HH", 0x0100, 0x4D49
    )
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def mat73(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        file["acc"] = samples().T
        file["fs"] = np.array([[RATE_HZ]])
    _matlab_heading(path)


def mat73_of_zeros(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        _zeros(file, "acc", (1, UNPACKED // 8))
        file["fs"] = np.array([[RATE_HZ]])
    _matlab_heading(path)


def mat73_that_links_elsewhere(path: Path) -> None:
    import h5py

    other = path.with_name("other.h5")
    with h5py.File(other, "w") as file:
        file["acc"] = samples().T
    with h5py.File(path, "w", userblock_size=512) as file:
        file["acc"] = h5py.ExternalLink("other.h5", "/acc")
        file["fs"] = np.array([[RATE_HZ]])
    _matlab_heading(path)


def _matlab_heading(path: Path) -> None:
    body = bytearray(path.read_bytes())
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack(
        "<HH", 0x0200, 0x4D49
    )
    body[: len(head)] = head
    path.write_bytes(body)


# HDF5


def hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["acc"] = samples()
        file.attrs["fs"] = RATE_HZ


def _zeros(file: object, name: str, shape: tuple[int, ...], chunk: int = 1 << 21) -> None:
    """A chunked dataset of zeros: its chunks are one deflated block, or are not stored at all."""
    file.create_dataset(  # type: ignore[attr-defined]
        name,
        shape=shape,
        dtype="f8",
        chunks=tuple(min(n, chunk) for n in shape),
        compression="gzip",
    )


def hdf5_of_chunks_that_are_not_stored(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        _zeros(file, "acc", (UNPACKED // 8,))
        file.attrs["fs"] = RATE_HZ


def hdf5_of_one_deflated_chunk(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        count = UNPACKED // 8
        made = file.create_dataset(
            "acc", shape=(count,), dtype="f8", chunks=(1 << 24,), compression="gzip"
        )
        packed = zlib.compress(bytes(8 << 24), 9)
        for first in range(0, count, 1 << 24):
            made.id.write_direct_chunk((first,), packed)
        file.attrs["fs"] = RATE_HZ


def hdf5_with_external_storage(path: Path) -> None:
    import h5py

    secret = path.with_name("secret.bin")
    samples(1).tofile(secret)
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "acc", shape=(ROWS,), dtype="f8", external=[(secret.name, 0, 8 * ROWS)]
        )
        file.attrs["fs"] = RATE_HZ


def hdf5_with_an_external_link(path: Path) -> None:
    import h5py

    with h5py.File(path.with_name("other.h5"), "w") as file:
        file["acc"] = samples()
    with h5py.File(path, "w") as file:
        file["acc"] = h5py.ExternalLink("other.h5", "/acc")
        file.attrs["fs"] = RATE_HZ


def hdf5_with_a_virtual_dataset(path: Path) -> None:
    import h5py

    with h5py.File(path.with_name("other.h5"), "w") as file:
        file["acc"] = samples()
    layout = h5py.VirtualLayout(shape=(ROWS, 2), dtype="f8")
    layout[:] = h5py.VirtualSource("other.h5", "acc", shape=(ROWS, 2))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("acc", layout)
        file.attrs["fs"] = RATE_HZ


def hdf5_of_groups_within_themselves(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        inner = file.create_group("a")
        inner["b"] = file["/"]
        inner["c"] = inner
        file["acc"] = samples()
        file.attrs["fs"] = RATE_HZ


def hdf5_of_links_that_double(path: Path) -> None:
    """Thirty groups, each linked twice into the one above: 1e9 paths to one dataset."""
    import h5py

    with h5py.File(path, "w") as file:
        above = file["/"]
        for number in range(30):
            group = above.create_group("a")
            above["b"] = group
            above = group
            del number
        above["acc"] = samples()
        file.attrs["fs"] = RATE_HZ


# Workbooks


def xlsx(path: Path) -> None:
    _workbook(path, _rows(300))


def _rows(count: int) -> str:
    cells = (
        f'<row r="{k}"><c r="A{k}"><v>{0.01 * k:.2f}</v></c><c r="B{k}"><v>{k % 7}.5</v></c></row>'
        for k in range(1, count + 1)
    )
    return f"<sheetData>{''.join(cells)}</sheetData>"


def _workbook(
    path: Path, body: str, *, strings: str | None = None, head: str = "", tail: str = ""
) -> None:
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    rel = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    office = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    declared = '<?xml version="1.0" encoding="UTF-8"?>'
    shared = (
        f'<Override PartName="/xl/sharedStrings.xml" ContentType="{office}.sharedStrings+xml"/>'
        if strings is not None
        else ""
    )
    parts = {
        "[Content_Types].xml": f'{declared}<Types xmlns="{package}/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        f'<Override PartName="/xl/workbook.xml" ContentType="{office}.sheet.main+xml"/>'
        f'<Override PartName="/xl/worksheets/sheet1.xml" ContentType="{office}.worksheet+xml"/>{shared}</Types>',
        "_rels/.rels": f'{declared}<Relationships xmlns="{package}/relationships">'
        f'<Relationship Id="r1" Type="{rel}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'{declared}<workbook xmlns="{main}" xmlns:r="{rel}">'
        '<sheets><sheet name="data" sheetId="1" r:id="r1"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'{declared}<Relationships xmlns="{package}/relationships">'
        f'<Relationship Id="r1" Type="{rel}/worksheet" Target="worksheets/sheet1.xml"/>'
        + (
            f'<Relationship Id="r2" Type="{rel}/sharedStrings" Target="sharedStrings.xml"/>'
            if strings is not None
            else ""
        )
        + "</Relationships>",
        "xl/worksheets/sheet1.xml": f'{declared}{head}<worksheet xmlns="{main}">{body}{tail}</worksheet>',
    }
    if strings is not None:
        parts["xl/sharedStrings.xml"] = f'{declared}<sst xmlns="{main}">{strings}</sst>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in parts.items():
            archive.writestr(name, text)


def xlsx_of_shared_strings(path: Path) -> None:
    _workbook(path, _rows(300), strings="<si><t>a</t></si>" * 6_000_000)


def xlsx_of_one_long_string(path: Path) -> None:
    _workbook(path, _rows(300), strings=f"<si><t>{'a' * 300_000_000}</t></si>")


def xlsx_of_merged_cells(path: Path) -> None:
    merged = "".join(f'<mergeCell ref="A{k}:XFD{k}"/>' for k in range(1, 1_000_000))
    _workbook(path, _rows(300), tail=f"<mergeCells>{merged}</mergeCells>")


def xlsx_of_the_last_cell(path: Path) -> None:
    body = (
        '<dimension ref="A1:XFD1048576"/><sheetData><row r="1"><c r="A1"><v>1</v></c></row>'
        '<row r="1048576"><c r="XFD1048576"><v>2</v></c></row></sheetData>'
    )
    _workbook(path, body)


def xlsx_of_wide_rows(path: Path) -> None:
    rows = "".join(f'<row r="{k}"><c r="XFD{k}"><v>2</v></c></row>' for k in range(1, 3_000))
    _workbook(path, f"<sheetData>{rows}</sheetData>")


def xlsx_of_far_rows(path: Path) -> None:
    _workbook(
        path, '<sheetData><row r="2000000000"><c r="A2000000000"><v>2</v></c></row></sheetData>'
    )


def xlsx_of_entities(path: Path) -> None:
    entities = '<!ENTITY a0 "aaaaaaaaaa">' + "".join(
        f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10)
    )
    body = '<sheetData><row r="1"><c r="A1" t="inlineStr"><is><t>&a9;</t></is></c></row></sheetData>'
    _workbook(path, body, head=f"<!DOCTYPE worksheet [{entities}]>")


# National Instruments, WAV, universal files


def tdms(path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        said = {"wf_increment": 1 / RATE_HZ, "unit_string": "g"}
        writer.write_segment([ChannelObject("g", "a", samples()[:, 0], properties=said)])


def tdms_of_more_values(path: Path) -> None:
    """A segment whose index claims 100,000,000 values; those beyond the file are not there."""
    tdms(path)
    body = path.read_bytes()
    path.write_bytes(
        body.replace(struct.pack("<IQ", 1, ROWS), struct.pack("<IQ", 1, 100_000_000))
    )


def tdms_of_many_chunks(path: Path) -> None:
    """A segment that says it goes on far beyond the end of the file."""
    tdms(path)
    body = bytearray(path.read_bytes())
    struct.pack_into("<Q", body, 12, 8_000_000_000)
    path.write_bytes(body)


def tdms_of_many_objects(path: Path) -> None:
    tdms(path)
    body = bytearray(path.read_bytes())
    struct.pack_into("<I", body, 28, 2_000_000_000)
    path.write_bytes(body)


def tdms_of_a_long_name(path: Path) -> None:
    tdms(path)
    body = bytearray(path.read_bytes())
    struct.pack_into("<I", body, 32, 2_000_000_000)
    path.write_bytes(body)


def wav(path: Path) -> None:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(1000)
        file.writeframes((1000 * samples()).astype("<i2").tobytes())


def _wav_with(path: Path, at: int, form: str, value: int) -> None:
    wav(path)
    body = bytearray(path.read_bytes())
    struct.pack_into(form, body, at, value)
    path.write_bytes(body)


def wav_of_more_bytes(path: Path) -> None:
    _wav_with(path, 40, "<I", 1_900_000_000)


def wav_of_a_far_chunk(path: Path) -> None:
    wav(path)
    body = path.read_bytes()
    path.write_bytes(body[:36] + b"LIST" + struct.pack("<I", 4_000_000_000) + body[36:])


def wav_of_no_channels(path: Path) -> None:
    _wav_with(path, 22, "<H", 0)


def wav_of_many_channels(path: Path) -> None:
    _wav_with(path, 22, "<H", 65_535)


def wav_of_empty_chunks(path: Path) -> None:
    wav(path)
    body = path.read_bytes()
    path.write_bytes(body[:36] + b"junk\0\0\0\0" * 2_000_000 + body[36:])


def uff(path: Path) -> None:
    from slowtime_services.exports import write_universal
    from slowtime_services.files import Record

    one = Record(samples=samples(1), rate_hz=RATE_HZ, channels=("a",), units=("g",))
    write_universal(path, one)


def uff_of_more_points(path: Path) -> None:
    """Both headings, of the dataset and of its abscissa, state 900,000,000 points."""
    uff(path)
    body = path.read_bytes()
    for count in (ROWS, 8 * ROWS):
        body = body.replace(b"%10d" % count, b"%10d" % (450_000 * count))
    path.write_bytes(body)


def uff_of_many_marks(path: Path) -> None:
    path.write_bytes(b"    -1\n   58b\n" + b"    -1\n    -1\n" * 400_000)


# Seismology


def mseed(path: Path) -> None:
    import obspy

    trace = obspy.Trace(samples(1)[:, 0].astype(np.float32))
    trace.stats.sampling_rate = RATE_HZ
    trace.write(str(path), format="MSEED", reclen=512)


def mseed_of_two_days(path: Path) -> None:
    """Two records of one channel, decades apart: merged they would be 1e11 samples."""
    import obspy

    parts = []
    for year in (1980, 2020):
        trace = obspy.Trace(samples(1)[:200, 0].astype(np.float32))
        trace.stats.sampling_rate = RATE_HZ
        trace.stats.starttime = obspy.UTCDateTime(year, 1, 1)
        parts.append(trace)
    obspy.Stream(parts).write(str(path), format="MSEED", reclen=512)


def mseed_of_a_gap_below_the_bound(path: Path) -> None:
    """Two records of one channel ten days apart: merged they would be 86 million samples."""
    import obspy

    parts = []
    for day in (1, 11):
        trace = obspy.Trace(samples(1)[:200, 0].astype(np.float32))
        trace.stats.sampling_rate = RATE_HZ
        trace.stats.starttime = obspy.UTCDateTime(2020, 1, day)
        parts.append(trace)
    obspy.Stream(parts).write(str(path), format="MSEED", reclen=512)


def mseed_of_more_samples(path: Path) -> None:
    mseed(path)
    body = bytearray(path.read_bytes())
    struct.pack_into(">H", body, 30, 65_535)
    path.write_bytes(body)


def mseed_of_long_records(path: Path) -> None:
    """A blockette 1000 that states records of 2^255 bytes."""
    mseed(path)
    body = bytearray(path.read_bytes())
    body[54] = 255
    path.write_bytes(body)


def mseed_of_a_round_of_blockettes(path: Path) -> None:
    mseed(path)
    body = bytearray(path.read_bytes())
    struct.pack_into(">H", body, 50, 48)
    path.write_bytes(body)


def sac(path: Path) -> None:
    import obspy

    trace = obspy.Trace(samples(1)[:, 0].astype(np.float32))
    trace.stats.sampling_rate = RATE_HZ
    trace.write(str(path), format="SAC")


def sac_of_more_samples(path: Path) -> None:
    sac(path)
    body = bytearray(path.read_bytes())
    struct.pack_into("<i", body, 316, 1_000_000_000)
    path.write_bytes(body)


def sac_of_negative_samples(path: Path) -> None:
    sac(path)
    body = bytearray(path.read_bytes())
    struct.pack_into("<i", body, 316, -5)
    path.write_bytes(body)


def _gcf_block(seconds: int, records: int = 250, rate: int = 25) -> bytes:
    stream = int("ABCZ2", 36) & 0x7FFFFFFF
    days, rest = divmod(seconds, 86_400)
    head = struct.pack(">IIIBBBB", stream, stream, days << 17 | rest, 0, rate, 1, records)
    body = struct.pack(">i", 0) + np.zeros(4 * 250, np.int8).tobytes()
    return head + body[: 1008 - 4] + struct.pack(">i", 0)


def gcf(path: Path) -> None:
    path.write_bytes(b"".join(_gcf_block(86_400 * 3000 + 10 * k) for k in range(4)))


def gcf_of_days(path: Path) -> None:
    path.write_bytes(_gcf_block(86_400 * 3000) + _gcf_block(86_400 * 3010))


def seg2(path: Path) -> None:
    _seg2(path, ROWS)


def _seg2(path: Path, count: int, traces: int = 1, pointer: int | None = None) -> None:
    data = samples(1)[:, 0].astype("<f4").tobytes()
    strings = (
        struct.pack("<H", 3 + len(b"SAMPLE_INTERVAL 0.01"))
        + b"SAMPLE_INTERVAL 0.01\0"
        + b"\0\0"
    )
    first = 32 + 4
    head = struct.pack("<HHHH", 0x3A55, 1, 4, traces) + b"\x01\x00\x00\x01\n\x00" + bytes(18)
    file_strings = b"\0\0"
    at = 32 + 4 + len(file_strings)
    at += -at % 4
    block = 32 + len(strings)
    block += -block % 4
    trace = struct.pack("<HHII", 0x4422, block, len(data), count) + bytes([4]) + bytes(19)
    body = head.ljust(32, b"\0") + struct.pack("<I", at if pointer is None else pointer)
    body = (body + file_strings).ljust(at, b"\0") + (trace + strings).ljust(block, b"\0") + data
    del first
    path.write_bytes(body)


def seg2_of_more_samples(path: Path) -> None:
    _seg2(path, 100_000_000)


# Columns


def parquet(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({"t": np.arange(ROWS) / RATE_HZ, "a": samples(1)[:, 0]})
    pq.write_table(table, path)


def parquet_of_zeros(path: Path) -> None:
    """Written piece by piece: a dictionary of one number, 187 million times."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    piece = pa.table({"a": np.zeros(1 << 22)})
    with pq.ParquetWriter(path, piece.schema, compression="zstd") as writer:
        for _ in range(UNPACKED // 8 >> 22):
            writer.write_table(piece)


def parquet_of_text(path: Path) -> None:
    """A column of one long text that is repeated by reference, beside few numbers."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(
        {
            "a": samples(1)[:1000, 0],
            "s": pa.DictionaryArray.from_arrays(
                np.zeros(1000, np.int32), ["x" * 1_500_000]
            ).cast(pa.string()),
        }
    )
    pq.write_table(table, path, compression="zstd")


def arrow(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.feather as feather

    feather.write_feather(
        pa.table({"t": np.arange(ROWS) / RATE_HZ, "a": samples(1)[:, 0]}),
        str(path),
        compression="zstd",
    )


def arrow_of_zeros(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.feather as feather

    table = pa.table({"a": np.zeros(UNPACKED // 16)})
    feather.write_feather(table, str(path), compression="zstd")


# Recordings


def mcap(path: Path) -> None:
    _mcap(path, json.dumps({"linear_acceleration": {"x": 1.0, "y": 2.0, "z": 3.0}}).encode())


def _mcap(
    path: Path, message: bytes, count: int = 300, *, encoding: str = "json",
    schema: tuple[str, str, bytes] = ("imu", "jsonschema", b"{}"), attached: int = 0,
) -> None:  # fmt: skip
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD, chunk_size=64 << 20)
        writer.start()
        number = writer.register_schema(*schema)
        channel = writer.register_channel("/imu", encoding, number)
        for k in range(count):
            stamp = 10**18 + 10**7 * k
            writer.add_message(
                channel, stamp, message.replace(b"1.0", b"%d.0" % (k % 7)), stamp
            )
        if attached:
            writer.add_attachment(0, 0, "a", "b", bytes(attached))
        writer.finish()


def mcap_of_deep_messages(path: Path) -> None:
    _mcap(path, b'{"a":' * 50_000 + b"1" + b"}" * 50_000, 5)


def mcap_of_digits(path: Path) -> None:
    vector = b'{"x": %s, "y": 2, "z": 3}' % (b"9" * 401)
    _mcap(path, b'{"linear_acceleration": %s}' % vector, 5)


def mcap_of_many_digits(path: Path) -> None:
    vector = b'{"x": %s, "y": 2, "z": 3}' % (b"9" * 5000)
    _mcap(path, b'{"linear_acceleration": %s}' % vector, 5)


def mcap_of_an_infinite_number(path: Path) -> None:
    _mcap(path, b'{"linear_acceleration": {"x": 1e400, "y": 2, "z": 3}}', 5)


def mcap_of_zeros(path: Path) -> None:
    _mcap(path, b" " * 100_000 + b"{}", 10_000)


def mcap_of_a_hostile_schema(path: Path) -> None:
    """A definition of a ROS message whose arrays have 4e9 elements."""
    text = b"float64[4000000000] a\n" * 200
    _mcap(
        path, b"\0\1\0\0" + bytes(8000), 5, encoding="cdr",
        schema=("sensor_msgs/msg/Imu", "ros2msg", text),
    )  # fmt: skip


def mcap_of_a_long_schema(path: Path) -> None:
    text = b"".join(b"float64 a%d\n" % k for k in range(300_000))
    _mcap(
        path, b"\0\1\0\0" + bytes(8000), 5, encoding="cdr",
        schema=("sensor_msgs/msg/Imu", "ros2msg", text),
    )  # fmt: skip


def mcap_of_a_recursive_schema(path: Path) -> None:
    text = (
        b"sensor_msgs/Imu[] header\n"
        + b"=" * 80
        + b"\nMSG: sensor_msgs/Imu\nsensor_msgs/Imu[] a\n"
    )
    _mcap(
        path, b"\0\1\0\0" + b"\xff\xff\xff\x0f" * 2000, 5, encoding="cdr",
        schema=("sensor_msgs/msg/Imu", "ros2msg", text),
    )  # fmt: skip


def mcap_of_an_attachment(path: Path) -> None:
    _mcap(path, b'{"a": 1}', 5)
    body = path.read_bytes()
    attachment = struct.pack("<BQ", 9, 2**62) + bytes(64)
    path.write_bytes(body[:8] + attachment + body[8:])


# Text


def knet(path: Path, scale: str = "2000(gal)/8388608", lines: int = 250) -> None:
    keys = {
        "Origin Time": "2011/03/11 14:46:00", "Lat.": "38.1", "Long.": "142.9",
        "Station Code": "MYG004", "Station Lat.": "38.7", "Record Time": "2011/03/11 14:46:51",
        "Sampling Freq(Hz)": "100Hz", "Duration Time(s)": f"{lines * 8 // 100}", "Dir.": "N-S",
        "Scale Factor": scale, "Max. Acc. (gal)": "10.0", "Last Correction": "2011/03/11 14:46:36",
    }  # fmt: skip
    rows = np.random.default_rng(1).integers(-9999, 9999, (lines, 8))
    text = "".join(f"{key:<18}{value}\n" for key, value in keys.items()) + "Memo.\n"
    path.write_text(text + "\n".join("".join(f"{v:>9}" for v in row) for row in rows) + "\n")


def knet_of_digits(path: Path) -> None:
    knet(path, f"{'9' * 401}(gal)/{'9' * 5000}")


def knet_of_long_numbers(path: Path) -> None:
    knet(path)
    path.write_text(path.read_text() + "9" * 20_000_000 + "\n")


def labview(path: Path, channels: int = 1, stated: str = "1") -> None:
    head = [
        "LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        "Decimal_Separator\t.", "Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative",
        "***End_of_Header***", f"Channels\t{stated}", "Samples\t300", "Y_Unit_Label\tg",
        "X0\t0", "Delta_X\t0.01", "***End_of_Header***", "X_Value\tacc\tComment",
    ]  # fmt: skip
    rows = [f"{0.01 * k:.2f}\t{k % 7}.25" for k in range(300)]
    del channels
    path.write_text("\n".join([*head, *rows]) + "\n")


def labview_of_more_channels(path: Path) -> None:
    labview(path, stated="2000000000")


def labview_of_digits(path: Path) -> None:
    labview(path, stated="9" * 5000)


def labview_of_headers(path: Path) -> None:
    labview(path)
    path.write_text(path.read_text() + "***End_of_Header***\n" * 300_000)


def listing(path: Path, points: str = "2000") -> None:
    head = f"{points} points of accel data equally spaced at .010 sec, in cm/sec2. (8f10.5)"
    rows = ["".join(f"{v:10.5f}" for v in row) for row in samples(8)[:250]]
    path.write_text("\n".join(["Record of 2011", head, *rows]) + "\n")


def listing_of_more_points(path: Path) -> None:
    listing(path, "999999999")


def csv(path: Path) -> None:
    rows = (f"{k / RATE_HZ:.2f},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(samples()))
    path.write_text("t_s,a,b\n" + "\n".join(rows) + "\n")


def csv_of_one_long_line(path: Path) -> None:
    path.write_bytes(b"t,a\n" + b"1," * 10_000_000 + b"\n")


def csv_of_many_columns(path: Path) -> None:
    row = ",".join(["1.5"] * 300_000)
    path.write_text("\n".join([row] * 10) + "\n")


def csv_of_digits(path: Path) -> None:
    csv(path)
    path.write_text(path.read_text() + f"{'9' * 5_000_000},1,2\n")


def csv_of_spaces(path: Path) -> None:
    path.write_bytes(b"# " + b" " * 20_000_000 + b"\n0,1\n1,2\n2,3\n")


def csv_of_quotes(path: Path) -> None:
    path.write_bytes(b't,a\n"' * 4_000_000)


def packed_csv(path: Path) -> None:
    path.write_bytes(gzip.compress(bytes(1000)))


Maker = Callable[[Path], None]


def _cases(
    ending: str, honest: Maker, *lying: Maker, words: tuple[str, ...] = ()
) -> list[Case]:
    command = ("import", "{file}", *words, "--out", "out.mcap")
    return [
        Case(one.__name__, f"f{ending}", honest, one, command, one in HARMLESS) for one in lying
    ]


RATE = ("--rate-hz", "100")
HARMLESS = frozenset(
    (
        hdf5_of_groups_within_themselves, hdf5_of_links_that_double,  # allowed by the format
        xlsx_of_merged_cells,  # formatting, which is not read
        parquet_of_text,  # columns without numbers are not read
    )
)  # fmt: skip
"""Files whose numbers are as they are stated; what is odd in them is not read, or read once."""
CASES: list[Case] = [
    *_cases(".npy", npy, npy_of_more_rows, npy_with_a_heading_of_digits, npy_with_a_nested_heading, npy_of_empty_rows, words=RATE),
    *_cases(".npz", npz, npz_of_zeros, npz_of_more_rows, npz_that_states_smaller_members),
    *_cases(".mat", mat, mat_of_zeros, mat_of_more_rows, mat_of_negative_size, mat_of_nested_cells, words=RATE),
    *_cases(".mat", mat73, mat73_of_zeros, mat73_that_links_elsewhere),
    *_cases(
        ".h5", hdf5, hdf5_of_chunks_that_are_not_stored, hdf5_of_one_deflated_chunk,
        hdf5_with_external_storage, hdf5_with_an_external_link, hdf5_with_a_virtual_dataset,
        hdf5_of_groups_within_themselves, hdf5_of_links_that_double,
    ),
    *_cases(
        ".xlsx", xlsx, xlsx_of_shared_strings, xlsx_of_one_long_string, xlsx_of_merged_cells,
        xlsx_of_the_last_cell, xlsx_of_wide_rows, xlsx_of_far_rows, xlsx_of_entities,
    ),
    *_cases(".tdms", tdms, tdms_of_more_values, tdms_of_many_chunks, tdms_of_many_objects, tdms_of_a_long_name),
    *_cases(
        ".wav", wav, wav_of_more_bytes, wav_of_a_far_chunk, wav_of_no_channels,
        wav_of_many_channels, wav_of_empty_chunks,
    ),
    *_cases(".uff", uff, uff_of_more_points, uff_of_many_marks),
    *_cases(
        ".mseed", mseed, mseed_of_two_days, mseed_of_a_gap_below_the_bound, mseed_of_more_samples,
        mseed_of_long_records, mseed_of_a_round_of_blockettes,
    ),
    *_cases(".sac", sac, sac_of_more_samples, sac_of_negative_samples),
    *_cases(".gcf", gcf, gcf_of_days),
    *_cases(".sg2", seg2, seg2_of_more_samples),
    *_cases(".parquet", parquet, parquet_of_zeros, parquet_of_text, words=RATE),
    *_cases(".arrow", arrow, arrow_of_zeros, words=RATE),
    *_cases(
        ".mcap", mcap, mcap_of_deep_messages, mcap_of_digits, mcap_of_many_digits,
        mcap_of_an_infinite_number, mcap_of_zeros, mcap_of_a_hostile_schema,
        mcap_of_a_long_schema, mcap_of_a_recursive_schema, mcap_of_an_attachment,
    ),
    *_cases(".txt", knet, knet_of_digits, knet_of_long_numbers),
    *_cases(".lvm", labview, labview_of_more_channels, labview_of_digits, labview_of_headers),
    *_cases(".v1", listing, listing_of_more_points),
    *_cases(
        ".csv", csv, csv_of_one_long_line, csv_of_many_columns, csv_of_digits, csv_of_spaces,
        csv_of_quotes, words=(),
    ),
]  # fmt: skip

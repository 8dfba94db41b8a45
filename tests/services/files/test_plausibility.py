"""A file that states one rate and implies another is no record: a person is asked."""

import struct
import warnings

import h5py
import numpy as np
import pytest
import scipy.io.wavfile

from slowtime_services.files import RecordError, read_record

RATE_HZ = 200.0
VALUES = np.random.default_rng(4).standard_normal(2000).astype(np.float32)


@pytest.fixture(autouse=True)
def _libraries_may_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def wav(path):
    scipy.io.wavfile.write(path, 8000, VALUES)
    body = bytearray(path.read_bytes())
    struct.pack_into("<I", body, body.index(b"fmt ") + 12, 16000)
    path.write_bytes(bytes(body))
    return 16000.0


def sac(path):
    obspy = pytest.importorskip("obspy")
    obspy.Trace(VALUES, {"sampling_rate": RATE_HZ}).write(str(path), format="SAC")
    body = bytearray(path.read_bytes())
    struct.pack_into("<f", body, 0, 0.01)
    path.write_bytes(bytes(body))
    return 100.0


def mseed(path):
    """Each record states another rate than the starts of those about it imply."""
    obspy = pytest.importorskip("obspy")
    start, records = obspy.UTCDateTime(2024, 3, 5), []
    for at in range(0, 2000, 100):
        says = {"station": "B", "channel": "HNZ", "sampling_rate": 1.15 * RATE_HZ}
        trace = obspy.Trace(VALUES[at : at + 100], {**says, "starttime": start + at / RATE_HZ})
        trace.write(str(path), format="MSEED", reclen=1024)
        records.append(path.read_bytes())
    path.write_bytes(b"".join(records))
    return 1.15 * RATE_HZ


def hdf5(path):
    with h5py.File(path, "w") as file:
        file["a"] = VALUES
        file["a"].attrs["fs"] = 100.0
        file["a"].attrs["dt"] = 1 / RATE_HZ
    return 100.0


def sdf5(path):
    with h5py.File(path, "w") as file:
        file["a"], file["t"] = VALUES, np.arange(2000) / RATE_HZ
        file["fs"] = 100.0
    return 100.0


def parquet(path):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    steps = pa.array(np.arange(2000) * 5_000_000 + 10**18, pa.timestamp("ns"))
    table = pa.table([steps, VALUES], names=["time", "a"])
    parquet.write_table(table.replace_schema_metadata({"rate_hz": "100"}), path)
    return 100.0


def lvm(path):
    head = (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\n***End_of_Header***\n"
        "Channels\t1\nSamples\t2000\nDelta_X\t0.01\n***End_of_Header***\nX_Value\ta\n"
    )
    rows = (f"{i / RATE_HZ:.6f}\t{value}\n" for i, value in enumerate(VALUES))
    path.write_text(head + "".join(rows))
    return 100.0


@pytest.mark.parametrize(
    ("ending", "write"),
    [("wav", wav), ("sac", sac), ("mseed", mseed), ("h5", hdf5), ("sdf5", sdf5),
     ("parquet", parquet), ("lvm", lvm)],
    ids=lambda one: one if isinstance(one, str) else "",
)  # fmt: skip
def test_two_rates_are_a_question_that_a_person_can_answer(tmp_path, ending, write):
    path = tmp_path / f"a.{ending}"
    given = write(path)
    with pytest.raises(RecordError, match=rf"a\.{ending}.*--rate-hz"):
        read_record(path, skip_missing=True)
    if ending != "mseed":  # whose gaps would be wrong as well
        assert read_record(path, rate_hz=given, skip_missing=True).rate_hz == given


def test_losses_are_no_contradiction(tmp_path):
    obspy = pytest.importorskip("obspy")
    start, parts = obspy.UTCDateTime(2024, 3, 5), []
    for at in (0, 400, 900, 1300, 1600):
        says = {"station": "B", "channel": "HNZ", "sampling_rate": RATE_HZ}
        begins = start + at / RATE_HZ
        parts.append(obspy.Trace(VALUES[at : at + 290], {**says, "starttime": begins}))
    obspy.Stream(parts).write(str(tmp_path / "a.mseed"), format="MSEED")
    with pytest.raises(RecordError, match="a value is missing"):
        read_record(tmp_path / "a.mseed", skip_missing=True)


def test_a_universal_file_with_another_number_of_points_is_refused(tmp_path):
    pytest.importorskip("pyuff")
    from slowtime_services.exports import write_universal
    from slowtime_services.files import Record

    made = Record(samples=VALUES[:, None], rate_hz=200.0, channels=("a",), units=("g",))
    write_universal(tmp_path / "a.uff", made)
    body = (tmp_path / "a.uff").read_bytes()
    (tmp_path / "a.uff").write_bytes(
        body.replace(b"      2000         1", b"      2001         1")
    )
    with pytest.raises(RecordError, match=r"states 2001 points and holds 2000"):
        read_record(tmp_path / "a.uff")

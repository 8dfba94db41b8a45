"""What other libraries write is read back: channels, units, rate, start."""

import datetime
import json
import sys
import warnings
import wave
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io.wavfile

from slowtime_services.exports import write_parquet
from slowtime_services.files import Record, RecordError, read_record
from slowtime_services.files.readers import READERS, ros
from slowtime_services.files.record_streams.record_stream import open_record

START = np.datetime64("2024-03-05T06:07:08.250", "ns")
START_NS = int(START.astype(np.int64))
UNITS = {"m/s^2": ("m/s^2", 1.0), "g": ("m/s^2", 9.80665), "in/s^2": ("m/s^2", 0.0254),
         "mm/s": ("m/s", 1e-3), "V": ("V", 1.0), "": ("", 1.0)}  # fmt: skip
"""As files have them: the unit that they are turned into, and its worth."""


@pytest.fixture(params=[0, *(pytest.param(i, marks=pytest.mark.long) for i in (1, 2, 3))])
def drawn(request):
    """Some channels with their names and units, at some rate."""
    rng = np.random.default_rng([17, request.param])
    count = int(rng.integers(200, 900))
    width = int(rng.integers(1, 5))
    rate = float(rng.choice([20.0, 100.0, 128.0, 1000.0, 51200.0]))
    names = [f"acc_{'xyzw'[i]}" for i in range(width)]
    units = [str(rng.choice(list(UNITS))) for _ in range(width)]
    return names, units, rate, rng.standard_normal((count, width))


@pytest.fixture(autouse=True)
def _libraries_may_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def same(record, names, units, rate, samples, start_ns=START_NS, rtol=1e-12):
    assert record.channels == tuple(names)
    assert record.units == tuple(UNITS[unit][0] for unit in units)
    assert record.rate_hz == pytest.approx(rate, rel=1e-6)
    worth = np.array([UNITS[unit][1] for unit in units])
    np.testing.assert_allclose(record.samples, samples * worth, rtol=rtol, atol=1e-12)
    assert record.start_ns == start_ns


def test_tdms(tmp_path, drawn):
    nptdms = pytest.importorskip("nptdms")
    names, units, rate, samples = drawn
    channels = [
        nptdms.ChannelObject(
            "measured", name, samples[:, i],
            {"wf_increment": 1.0 / rate, "wf_start_time": START, "unit_string": units[i]},
        )
        for i, name in enumerate(names)
    ]  # fmt: skip
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(channels)
    same(read_record(tmp_path / "a.tdms"), names, units, rate, samples)


def test_tdms_of_several_rates_asks_which_or_takes_those_named(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    rng = np.random.default_rng(3)
    series = {"fast": (1000.0, 4000), "half": (500.0, 2000), "cold": (1.0, 4)}
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject(
                    "g", name, rng.standard_normal(n), {"wf_increment": 1.0 / rate}
                )
                for name, (rate, n) in series.items()
            ]
        )
    with pytest.raises(RecordError, match=r"4,000 samples at 1000 Hz: fast; 2,000.*--channels"):
        read_record(tmp_path / "a.tdms")
    record = read_record(tmp_path / "a.tdms", channels=["half"])
    assert (record.rate_hz, record.samples.shape) == (500.0, (2000, 1))


@pytest.mark.parametrize("kind", [np.int16, np.float32])
def test_wav(tmp_path, kind):
    rng = np.random.default_rng(4)
    values = 0.1 * rng.standard_normal((500, 2))
    values = values.astype(kind) if kind is np.float32 else (values * 2**14).astype(kind)
    scipy.io.wavfile.write(tmp_path / "a.wav", 8000, values)
    record = read_record(tmp_path / "a.wav")
    assert record.rate_hz == 8000.0
    assert record.samples.dtype == kind
    np.testing.assert_array_equal(record.samples, values)


@pytest.mark.parametrize(("octets", "offset"), [(1, 128), (3, 0)])
def test_wav_of_8_and_24_bits_holds_the_steps_of_its_converter(tmp_path, octets, offset):
    limit = 2 ** (8 * octets - 1)
    values = np.random.default_rng(5).integers(-limit, limit, 400)
    values[:2] = -limit, limit - 1
    with wave.open(str(tmp_path / "a.wav"), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(octets)
        file.setframerate(500)
        file.writeframes(
            b"".join(
                int(v + offset).to_bytes(octets, "little", signed=not offset) for v in values
            )
        )
    record = read_record(tmp_path / "a.wav")
    np.testing.assert_array_equal(record.samples, values.reshape(-1, 2))
    assert any(f"integers of {8 * octets} bits" in note for note in record.notes)
    with open_record(tmp_path / "a.wav") as stream:
        pieces = [block.samples for block, _ in stream.blocks]
    np.testing.assert_array_equal(np.concatenate(pieces), values.reshape(-1, 2))


def test_groups_of_hdf5_that_are_runs_are_asked_about_and_sensors_are_not(tmp_path):
    rng = np.random.default_rng(6)
    for names in (("run1", "run2"), ("roof", "base")):
        with h5py.File(tmp_path / f"{names[0]}.h5", "w") as file:
            for name in names:
                made = file.create_dataset(f"{name}/acc", data=rng.standard_normal((300, 2)))
                made.attrs["Sample Rate"] = "0.2 kHz"
    with pytest.raises(RecordError, match=r"run1, run2, .*--channels run1/acc_0,run1/acc_1"):
        read_record(tmp_path / "run1.h5")
    chosen = read_record(tmp_path / "run1.h5", channels=["run2/acc_0", "run2/acc_1"])
    assert (chosen.rate_hz, chosen.samples.shape) == (200.0, (300, 2))
    assert read_record(tmp_path / "roof.h5").samples.shape == (300, 4)


@pytest.mark.parametrize(("ending", "form"), [("mseed", "MSEED"), ("sac", "SAC")])
def test_seismology(tmp_path, drawn, ending, form):
    obspy = pytest.importorskip("obspy")
    names, _, rate, samples = drawn
    names = [f"HN{'ZNEX'[i]}" for i in range(len(names))][: 1 if form == "SAC" else None]
    rate = 100.0 if form == "SAC" else rate  # its writer rounds an interval to microseconds
    stream = obspy.Stream(
        [
            obspy.Trace(
                samples[:, i].astype(np.float32),
                {"network": "AA", "station": "B", "channel": name, "sampling_rate": rate,
                 "starttime": obspy.UTCDateTime(START_NS / 1e9)},
            )
            for i, name in enumerate(names)
        ]
    )  # fmt: skip
    stream.write(str(tmp_path / f"a.{ending}"), format=form)
    samples = samples[:, : len(names)].astype(np.float32)
    record = read_record(tmp_path / f"a.{ending}")
    same(record, names, [""] * len(names), rate, samples, rtol=1e-6)


@pytest.mark.parametrize("cut", [1, 300, 512 + 77])
def test_a_truncated_miniseed_file_says_how_much_is_missing(tmp_path, cut):
    obspy = pytest.importorskip("obspy")
    path, says = tmp_path / "a.mseed", {"network": "AA", "station": "B", "channel": "HNZ"}
    values = np.random.default_rng(4).integers(-9999, 9999, 2000, dtype=np.int32)
    trace = obspy.Trace(values, {**says, "sampling_rate": 200.0})
    trace.write(str(path), format="MSEED", reclen=512)
    assert read_record(path).notes == ()
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    size = len(whole) - cut
    record = read_record(path)
    assert any(f"{size % 512} of {size} bytes are no records" in note for note in record.notes)
    assert 0 < len(record.samples) < 2000


def test_a_gap_of_miniseed_is_missing_samples(tmp_path):
    obspy = pytest.importorskip("obspy")
    values = np.random.default_rng(5).standard_normal(1000).astype(np.float32)
    start = obspy.UTCDateTime(START_NS / 1e9)
    header = {"station": "B", "channel": "HNZ", "sampling_rate": 100.0}
    parts = [
        obspy.Trace(values[a:b], {**header, "starttime": start + a / 100.0})
        for a, b in ((0, 400), (460, 1000))
    ]
    obspy.Stream(parts).write(str(tmp_path / "a.mseed"), format="MSEED")
    with pytest.raises(RecordError, match="60 values are not finite"):
        read_record(tmp_path / "a.mseed")
    record = read_record(tmp_path / "a.mseed", skip_missing=True)
    assert [(gap.row, gap.missing) for gap in record.gaps] == [(400, 60)]
    np.testing.assert_array_equal(record.samples[:, 0], np.delete(values, np.s_[400:460]))


def test_a_start_that_no_clock_of_64_bits_holds_is_refused(tmp_path):
    obspy = pytest.importorskip("obspy")
    header = {"station": "S", "channel": "HNZ", "sampling_rate": 100.0}
    path = tmp_path / "a.mseed"
    late = obspy.Trace(np.ones(500), {**header, "starttime": obspy.UTCDateTime(2400, 1, 1)})
    now = obspy.Trace(np.ones(500), {**header, "channel": "HNE"})
    obspy.Stream([late, now]).write(str(path), format="MSEED")
    with pytest.raises(RecordError, match=r"HNZ begins \+430 years from 1970.*up to 292"):
        read_record(path)


@pytest.mark.parametrize("binary", [True, False])
def test_universal_files(tmp_path, drawn, binary):
    pyuff = pytest.importorskip("pyuff")
    _, units, rate, samples = drawn
    file = pyuff.UFF(str(tmp_path / "a.uff"))
    for i, unit in enumerate(units):
        made = pyuff.prepare_58(
            binary=int(binary), func_type=1, rsp_node=i + 1, rsp_dir=3, ref_node=0, ref_dir=0,
            rsp_ent_name="NONE", ref_ent_name="NONE", load_case_id=0, ver_num=0,
            id1="made", id2="", id3="", id4="", id5="", z_axis_value=0.0,
            data=samples[:, i], x=np.arange(len(samples)) / rate, num_pts=len(samples),
            abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=1.0 / rate, ord_data_type=4,
            abscissa_spec_data_type=17, abscissa_axis_units_lab="s",
            ordinate_spec_data_type=12, ordinate_axis_units_lab=unit,
            orddenom_spec_data_type=0, z_axis_spec_data_type=0, return_full_dict=False,
        )  # fmt: skip
        file.write_sets([made], mode="add")
    record = read_record(tmp_path / "a.uff")
    names = [f"node {i + 1} +Z" for i in range(len(units))]
    same(record, names, units, rate, samples, start_ns=None, rtol=1e-5)


def test_hdf5(tmp_path, drawn):
    names, units, rate, samples = drawn
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("run/acceleration")
        group.attrs["sampling_rate"] = rate
        for i, name in enumerate(names):
            group[name] = samples[:, i]
            group[name].attrs["unit"] = units[i]
    order = np.argsort(names)
    same(
        read_record(tmp_path / "a.h5"), [names[i] for i in order], [units[i] for i in order],
        rate, samples[:, order], start_ns=None,
    )  # fmt: skip


def test_a_filter_of_hdf5_that_is_not_installed_is_named(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", data=np.arange(500.0), chunks=(100,), compression="lzf")
    from slowtime_services.files.readers import hdf5

    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda code: False)
    with pytest.raises(RecordError, match=r"filter lzf \(32000\), which is not installed"):
        hdf5.read(tmp_path / "a.h5", 10**6)


def test_hdf5_of_one_table(tmp_path, drawn):
    names, units, rate, samples = drawn
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["data"] = samples.T
        file["fs"] = rate
        file["data"].attrs["channel_names"] = names
        file["data"].attrs["units"] = units
    same(read_record(tmp_path / "a.hdf5"), names, units, rate, samples, start_ns=None)


@pytest.mark.parametrize("ending", ["parquet", "feather"])
@pytest.mark.parametrize("stamped", [True, False])
def test_columns_of_arrow(tmp_path, drawn, ending, stamped):
    pa = pytest.importorskip("pyarrow")
    feather = pytest.importorskip("pyarrow.feather")
    parquet = pytest.importorskip("pyarrow.parquet")
    names, units, _, samples = drawn
    rate = 100.0
    steps = np.arange(len(samples)) * 10_000_000
    clock = pa.array(START_NS + steps, pa.timestamp("ns")) if stamped else pa.array(steps / 1e9)
    fields = [pa.field("time_s" if not stamped else "time", clock.type)] + [
        pa.field(name, pa.float64(), metadata={"unit": unit})
        for name, unit in zip(names, units, strict=True)
    ]
    table = pa.table([clock, *samples.T], schema=pa.schema(fields))
    write = parquet.write_table if ending == "parquet" else feather.write_feather
    write(table, str(tmp_path / f"a.{ending}"))
    record = read_record(tmp_path / f"a.{ending}")
    same(record, names, units, rate, samples, start_ns=START_NS if stamped else None)


def test_excel(tmp_path, drawn):
    openpyxl = pytest.importorskip("openpyxl")
    names, units, _, samples = drawn
    book = openpyxl.Workbook()
    book.active.title = "about"
    book.active.append(["Serial", 4711])
    sheet = book.create_sheet("data")
    titles = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    sheet.append(["time", *titles])
    begins = datetime.datetime(2024, 3, 5, 6, 7, 8, 250_000)  # noqa: DTZ001  Excel has none
    for i, row in enumerate(samples.tolist()):
        sheet.append([begins + datetime.timedelta(milliseconds=10 * i), *row])
    book.save(tmp_path / "a.xlsx")
    record = read_record(tmp_path / "a.xlsx")
    same(record, names, units, 100.0, samples)
    assert any("'data' was read, not about" in note for note in record.notes)


def test_recordings_of_ros(tmp_path):
    rosbags = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kinds = types.types
    samples = np.random.default_rng(6).standard_normal((500, 3))
    writer = rosbags.Writer(
        tmp_path / "bag", version=9, storage_plugin=rosbags.StoragePlugin.MCAP
    )
    with writer:
        name = "sensor_msgs/msg/Imu"
        topic = writer.add_connection("/imu", name, typestore=types)
        vector, zero = kinds["geometry_msgs/msg/Vector3"], np.zeros(9)
        for i, row in enumerate(samples.tolist()):
            at = START_NS + i * 5_000_000
            message = kinds[name](
                kinds["std_msgs/msg/Header"](
                    kinds["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9), "imu"
                ),
                kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), zero,
                vector(0.0, 0.0, 0.0), zero, vector(*row), zero,
            )  # fmt: skip
            writer.write(topic, at + 1_000_000, types.serialize_cdr(message, name))
    (path,) = Path(tmp_path / "bag").glob("*.mcap")
    names = [f"linear_acceleration.{axis}" for axis in "xyz"]
    same(read_record(path), names, ["m/s^2"] * 3, 200.0, samples)


def test_accelerated_stamps_of_ros(tmp_path):
    rosbags = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kinds, name = types.types, "geometry_msgs/msg/AccelStamped"
    samples = np.random.default_rng(7).standard_normal((300, 3))
    writer = rosbags.Writer(
        tmp_path / "bag", version=9, storage_plugin=rosbags.StoragePlugin.MCAP
    )
    with writer:
        topic = writer.add_connection("/accel", name, typestore=types)
        vector = kinds["geometry_msgs/msg/Vector3"]
        for i, row in enumerate(samples.tolist()):
            at = START_NS + i * 8_000_000
            stamp = kinds["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9)
            message = kinds[name](
                kinds["std_msgs/msg/Header"](stamp, "a"),
                kinds["geometry_msgs/msg/Accel"](vector(*row), vector(0.0, 0.0, 0.0)),
            )
            writer.write(topic, at, types.serialize_cdr(message, name))
    (path,) = Path(tmp_path / "bag").glob("*.mcap")
    same(read_record(path), [f"linear.{axis}" for axis in "xyz"], ["m/s^2"] * 3, 125.0, samples)


def json_recording(path, messages, schema="sensor_msgs/Imu", topic="/imu"):
    """A recording of messages in JSON, with the time at which each was logged."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        known = writer.register_schema(schema, "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel(topic, "json", known)
        for logged, message in messages:
            body = json.dumps(message).encode()
            writer.add_message(channel, logged, body, logged)
        writer.finish()


@pytest.mark.parametrize("form", ["ros", "foxglove", "text", "unstamped"])
def test_accelerations_in_json(tmp_path, form):
    samples = np.random.default_rng(8).standard_normal((200, 3))

    def message(i, row):
        at, body = START_NS + i * 10_000_000, dict(zip("xyz", row, strict=True))
        stamps: dict[str, dict[str, object]] = {
            "ros": {"header": {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}}},
            "foxglove": {"timestamp": {"sec": at // 10**9, "nsec": at % 10**9}},
            "text": {"timestamp": f"{np.datetime64(at, 'ns')}Z"},
            "unstamped": {},
        }
        name = "linear_acceleration" if form in ("ros", "foxglove") else "accelerometer"
        late = 0 if form == "unstamped" else 3_000_000 * (i % 2)
        return at + late, {
            **stamps[form],
            name: body,
            "orientation": dict.fromkeys("xyzw", 0.0),
        }

    rows = [message(i, row) for i, row in enumerate(samples.tolist())]
    json_recording(tmp_path / "a.mcap", rows)
    record = read_record(tmp_path / "a.mcap")
    name, unit = rows[0][1].keys() - {"header", "timestamp", "orientation"}, ""
    unit = "m/s^2" if "linear_acceleration" in name else ""
    names = [f"{next(iter(name))}.{axis}" for axis in "xyz"]
    same(record, names, [unit] * 3, 100.0, samples)


def test_a_recording_without_accelerations_names_its_topics(tmp_path):
    json_recording(tmp_path / "a.mcap", [(5, {"pose": {"x": 1.0, "y": 2.0, "z": 3.0}})], "Pose")
    with pytest.raises(RecordError, match=r"no vibration in it: topics found: /imu \(Pose\)"):
        read_record(tmp_path / "a.mcap")


WITH_LIBRARY = [one for one in READERS if one.imports and one.imports != "h5py"]


@pytest.mark.parametrize("reader", WITH_LIBRARY, ids=lambda one: one.name)
def test_a_missing_library_is_named_with_its_install_line(tmp_path, monkeypatch, reader):
    monkeypatch.setitem(sys.modules, reader.imports, None)
    begins = {"TDSm": b"TDSm", "58b": b"    -1\n    58b", "PAR1": b"PAR1", "ARROW1": b"ARROW1"}
    head = next((v for k, v in begins.items() if k in str(reader.begins)), b"000001D AAA")
    path = tmp_path / f"a{reader.suffixes[0]}"
    path.write_bytes(head + bytes(200))
    line = rf"pip install 'slowtime\[formats\]' or pip install {reader.library}"
    with pytest.raises(RecordError, match=rf"{reader.library} reads. Install it: {line}"):
        read_record(path)


def test_a_missing_library_of_workbooks_and_recordings_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    (tmp_path / "a.xlsx").write_bytes(b"PK\x03\x04")
    with pytest.raises(RecordError, match="pip install openpyxl"):
        read_record(tmp_path / "a.xlsx")
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    with pytest.raises(RecordError, match="pip install mcap-ros2-support"):
        ros._decoder(tmp_path / "a.mcap")


def test_parquet_without_its_library_is_named_with_its_install_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    made = Record(samples=np.ones((2, 1)), rate_hz=1.0, channels=("a",), units=("g",))
    with pytest.raises(RecordError, match=r"slowtime\[parquet\]' or pip install pyarrow"):
        write_parquet(tmp_path / "a.parquet", made)


def test_what_breaks_a_library_is_refused(tmp_path):
    (tmp_path / "a.tdms").write_bytes(b"TDSm" + bytes(60))
    pytest.importorskip("nptdms")
    with pytest.raises(RecordError, match=r"a\.tdms"):
        read_record(tmp_path / "a.tdms")

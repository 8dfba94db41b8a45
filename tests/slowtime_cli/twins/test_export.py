"""`export`: what is written of a database is what its server gives."""

import csv
import json
import threading
import warnings

import numpy as np
import pyarrow.parquet
import pytest

from slowtime_services.bus import MemoryBus
from slowtime_services.files import read_record
from twin_server.__main__ import run as run_server
from twin_server.settings import TwinSettings


@pytest.fixture
def database(run, recorded):
    """A database of two beams, 40 epochs each."""
    recording = recorded(assets=("beam", "mast"))
    done = run("replay", recording, "--into", "twin.sqlite")
    assert done.status == 0, done.err
    return "twin.sqlite"


def test_a_history_becomes_a_table(run, database):
    said = run("export", database, "--asset", "lab.beam", "--out", "beam.csv")
    assert said.status == 0, said.err
    with open("beam.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["sequence"]) for row in rows] == list(range(40))
    assert rows[-1]["valid"] == "true"
    assert float(rows[-1]["stiffness_change"]) < 0.0
    done = run(
        "export", database, "--asset", "lab.beam", "--start", "slow:30", "--out", "b.parquet"
    )
    assert done.status == 0, done.err
    table = pyarrow.parquet.read_table("b.parquet")
    assert table.column("slow_time").to_pylist() == [float(i) for i in range(30, 40)]


def test_a_site_becomes_a_graph(run, database):
    assert run("export", database, "--site", "lab", "--out", "lab.json").status == 0
    with open("lab.json") as file:
        whole = json.load(file)
    twins = [twin["$dtId"] for twin in whole["digitalTwinsGraph"]["digitalTwins"]]
    assert twins == ["lab", "lab.beam", "lab.mast"]
    assert run("export", database, "--site", "pier", "--out", "pier.json").status == 0
    with open("pier.json") as file:
        assert json.load(file)["digitalTwinsGraph"]["digitalTwins"] == []


def test_a_server_gives_the_same(run, database):
    files = {"beam.csv": "lab.beam", "mast.parquet": "lab.mast", "beam.json": "lab.beam"}
    for name, asset in files.items():
        assert run("export", database, "--asset", asset, "--out", f"file-{name}").status == 0
    stop, ready, urls = threading.Event(), threading.Event(), []
    settings, bus = TwinSettings(database=database, port=0), MemoryBus()

    def told(url):
        urls.append(url)
        ready.set()

    more = {"bus": bus, "stop": stop, "ready": told}
    thread = threading.Thread(target=run_server, args=(settings,), kwargs=more)
    thread.start()
    try:
        assert ready.wait(60)
        for name, asset in files.items():
            done = run("export", "--server", urls[0], "--asset", asset, "--out", name)
            assert done.status == 0, done.err
        away = run("export", "--server", urls[0], "--asset", "lab.no", "--out", "no.json")
    finally:
        stop.set()
        thread.join(60)
        bus.close()
    assert away.status == 2
    assert "No twin is called lab.no" in away.err
    for name in files:
        with open(name, "rb") as given, open(f"file-{name}", "rb") as ours:
            assert given.read() == ours.read()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--out", "a.csv"), "database or a record, or --server"),
        (("twin.sqlite", "--out", "a.csv"), "Name the twin with --asset"),
        (("twin.sqlite", "--asset", "lab.no", "--out", "a.csv"), "There is no twin lab.no"),
        (("twin.sqlite", "--out", "a.xlsx"), "does not end in"),
        (("twin.sqlite", "--out", "a.json", "--start", "slow:1"), "a graph is of now"),
        (
            ("twin.sqlite", "--asset", "lab.beam", "--start", "soon", "--out", "a.csv"),
            "not a valid date and time",
        ),
        (("twin.sqlite", "--out", "a.uff"), "a twin keeps none"),
        (
            ("twin.sqlite", "--out", "a.csv", "--reading", "unit=g"),
            "--reading unit goes with a record",
        ),
        ((__file__, "--out", "a.csv"), "--reading skip_lines"),
        ((__file__, "--asset", "lab.beam", "--out", "a.csv"), "--asset goes with a twin's"),
        ((__file__, "--out", "a.json"), "JSON is a graph of twins"),
        (("--server", "http://127.0.0.1:9", "--out", "a.json"), "did not answer"),
        (("--server", "localhost", "--out", "a.json"), "not a valid address of a server"),
    ],
)
def test_what_cannot_be_written_is_said_and_leaves_no_file(
    run, database, tmp_path, arguments, says
):
    done = run("export", *arguments)
    assert done.status == 2
    assert says in " ".join(done.err.split())
    assert not list(tmp_path.glob("a.*"))


START = np.datetime64("2024-03-05T06:07:08.123456", "ns")


@pytest.fixture(params=[0, *(pytest.param(i, marks=pytest.mark.long) for i in range(1, 6))])
def recording(run, request):
    """Samples of some type and rate, imported as a recording."""
    rng = np.random.default_rng([5, request.param])
    rate = float(rng.choice([20.0, 99.7, 128.0, 1000.0, 51200.0]))
    names = ["roof", "node 7 -Z", "x [1]"][: int(rng.integers(1, 4))]
    kind = rng.choice(["<f8", "<f4", "<i4", "<i2"])
    samples = (1000 * rng.standard_normal((700, len(names)))).astype(kind)
    columns = {f"c{i}": samples[:, i] for i in range(len(names))}
    np.savez("r.npz", fs=rate, **columns)  # type: ignore[arg-type]
    flags = (
        "--reading",
        "columns=" + ",".join(names),
        "--unit",
        "m/s^2",
        "--start",
        f"{START}Z",
    )
    done = run("import", "r.npz", *flags, "--out", "r.mcap")
    assert done.status == 0, done.err
    return names, rate, samples


def exported(run, out, *flags):
    done = run("export", "r.mcap", "--out", out, *flags)
    assert done.status == 0, done.err


def test_a_recording_becomes_csv(run, recording):
    names, rate, samples = recording
    exported(run, "r.csv")
    with open("r.csv", newline="") as file:
        heads, *rows = list(csv.reader(file))
    assert heads == ["time", *(f"{name} [m/s^2]" for name in names)]
    told = np.array([[float(field) for field in row[1:]] for row in rows])
    np.testing.assert_array_equal(told, samples.astype(float))
    stamps = np.array([row[0].removesuffix("Z") for row in rows], dtype="datetime64[ns]")
    late = (stamps - START).astype(np.int64)
    np.testing.assert_allclose(late, np.arange(700) * 1e9 / rate, atol=0.51)


def test_a_recording_becomes_parquet(run, recording):
    names, rate, samples = recording
    exported(run, "r.data", "--setting", "format=parquet")
    table = pyarrow.parquet.read_table("r.data")
    assert table.column_names == ["time", *names]
    assert float(table.schema.metadata[b"rate_hz"]) == rate
    for name, column in zip(names, samples.T, strict=True):
        assert table.field(name).metadata == {b"unit": b"m/s^2"}
        told = table.column(name).to_numpy()
        np.testing.assert_array_equal(told, column)
        assert told.dtype == samples.dtype
    assert table.column("time").cast("int64").to_pylist()[0] == START.astype(np.int64)


def test_a_recording_becomes_a_universal_file(run, recording):
    pyuff = pytest.importorskip("pyuff")
    names, rate, samples = recording
    exported(run, "r.uff")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sets = pyuff.UFF("r.uff").read_sets()
    sets = sets if isinstance(sets, list) else [sets]
    assert [one["id1"].strip() for one in sets] == names
    for one, column in zip(sets, samples.T, strict=True):
        np.testing.assert_array_equal(one["data"], column)
        assert 1.0 / one["abscissa_inc"] == pytest.approx(rate, rel=1e-6)
        assert one["ordinate_axis_units_lab"].strip() == "m/s^2"
        assert one["id3"].strip() == str(START)


@pytest.mark.parametrize("ending", ["csv", "parquet", "uff"])
def test_what_was_exported_is_the_same_record(run, recording, ending):
    names, rate, samples = recording
    exported(run, f"r.{ending}")
    back = read_record(f"r.{ending}")
    assert back.channels == tuple(names)
    assert back.units == ("m/s^2",) * len(names)
    assert back.rate_hz == pytest.approx(rate, rel=1e-6)
    assert back.start_ns is not None
    assert abs(back.start_ns - START.astype(np.int64)) <= 1
    np.testing.assert_array_equal(back.samples, samples)


def test_missing_samples_show_in_the_clock_or_are_refused(run):
    times = np.delete(np.arange(300), [100, 101]) / 100.0
    np.savez("g.npz", t=times, a=np.random.default_rng(1).standard_normal(298))
    for ending in ("csv", "parquet"):
        done = run("export", "g.npz", "--out", f"g.{ending}")
        assert done.status == 0, done.err
        back = read_record(f"g.{ending}")
        assert [(gap.row, gap.missing) for gap in back.gaps] == [(100, 2)]
    done = run("export", "g.npz", "--out", "g.uff")
    assert done.status == 2
    assert "2 samples are missing within the record" in " ".join(done.err.split())

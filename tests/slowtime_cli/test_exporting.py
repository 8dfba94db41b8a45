"""`export`: what is written of a database is what its server gives."""

import csv
import json
import threading

import pyarrow.parquet
import pytest

from slowtime_services.bus import MemoryBus
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
        (("--out", "a.csv"), "database, or --server"),
        (("twin.sqlite", "--out", "a.csv"), "Say which twin with --asset"),
        (("twin.sqlite", "--asset", "lab.no", "--out", "a.csv"), "There is no twin lab.no"),
        (("twin.sqlite", "--out", "a.xlsx"), "does not end in"),
        (("twin.sqlite", "--out", "a.json", "--start", "slow:1"), "a graph is of now"),
        (
            ("twin.sqlite", "--asset", "lab.beam", "--start", "soon", "--out", "a.csv"),
            "no moment",
        ),
        ((__file__, "--out", "a.csv"), "file is not a database"),
        (("--server", "http://127.0.0.1:9", "--out", "a.json"), "did not answer"),
        (("--server", "localhost", "--out", "a.json"), "no address of a server"),
    ],
)
def test_what_cannot_be_written_is_said_and_leaves_no_file(
    run, database, tmp_path, arguments, says
):
    done = run("export", *arguments)
    assert done.status == 2
    assert says in " ".join(done.err.split())
    assert not list(tmp_path.glob("a.*"))

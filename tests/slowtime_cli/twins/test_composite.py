"""`composite`: registered from a file, looked at, exported and read back."""

import contextlib
import json
import threading

import pytest

from slowtime_services.bus import MemoryBus
from slowtime_services.client import Client
from twin_server.__main__ import run as run_server
from twin_server.settings import TwinSettings

YARD = """\
name: Yard
members: [lab.line, lab.mast]
tree: {series: [lab.mast, lab.line]}
"""
LINE = """\
kind: line
members: [lab.a, lab.b, lab.c]
tree: {k: 2, of: [lab.a, lab.b, lab.c]}
dependence:
  - {members: [lab.a, lab.b], beta: 0.1}
"""


@contextlib.contextmanager
def served(database):
    stop, ready, urls = threading.Event(), threading.Event(), []
    settings = TwinSettings(database=database, port=0)

    def told(url):
        urls.append(url)
        ready.set()

    work = {"bus": MemoryBus(), "stop": stop, "ready": told}
    thread = threading.Thread(target=run_server, args=[settings], kwargs=work)
    thread.start()
    assert ready.wait(60)
    try:
        with Client(urls[0]) as client:
            for name in ("a", "b", "c", "mast"):
                client.register(f"lab.{name}", {})
        yield urls[0]
    finally:
        stop.set()
        thread.join(60)


def test_a_yard_is_registered_shown_exported_and_read_back(run, tmp_path):
    files = {"line.yaml": LINE, "yard.yaml": YARD, "bad.yaml": "[]"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with served(tmp_path / "twin.sqlite") as url:
        server = ("--server", url)

        def said(*arguments, status=0):
            done = run("twin", "composite", *map(str, arguments), *server)
            assert done.status == status, done.err
            return done.out if status == 0 else done.err

        assert "There are no composites" in said("list")
        told = said("add", tmp_path / "line.yaml", "--id", "lab.line")
        assert "lab.line fails with probability not known (0 to 1)" in told
        said("add", tmp_path / "yard.yaml", "--id", "lab.yard")
        assert "lab.yard  site  4 twins, 0 valid, 0 alarms: lab.line, lab.mast" in said("list")
        shown = said("show", "lab.yard", "--horizon", "30")
        assert "0 of 4 twins valid" in shown
        assert "lab.mast has no failure threshold" in shown
        assert json.loads(said("show", "lab.yard", "--out", "-"))["id"] == "lab.yard"
        for name in ("g.json", "g.jsonld"):
            said("export", "--out", tmp_path / name)
        older = ("--setting", "dtdl=2", "--server", url, "--out", tmp_path / "g2.json")
        assert run("export", *older).status == 0
        with Client(url) as client:
            before = {
                name: client.composite(f"lab.{name}").registration for name in ("line", "yard")
            }
            assert client.memberships("lab.a") == ["lab.line"]
            for name in ("g.json", "g2.json", "g.jsonld"):
                client.delete_composite("lab.yard")
                client.delete_composite("lab.line")
                assert "2 composites would be registered" in said(
                    "import", tmp_path / name, "--dry-run"
                )
                assert client.composites() == []
                assert "2 composites are registered" in said("import", tmp_path / name)
                after = {n: client.composite(f"lab.{n}").registration for n in ("line", "yard")}
                assert after == before
        assert "holds no composite" in said(
            "add", tmp_path / "bad.yaml", "--id", "lab.x", status=2
        )
        assert "neither digitalTwinsGraph nor" in said(
            "import", tmp_path / "bad.yaml", status=2
        )
        (tmp_path / "strange.yaml").write_text("members: [lab.nobody]")
        strange = said("add", tmp_path / "strange.yaml", "--id", "lab.x", status=2)
        assert "lab.nobody is neither a twin nor a composite" in strange
    out = tmp_path / "file.json"
    done = run("export", tmp_path / "twin.sqlite", "--setting", "dtdl=2", "--out", out)
    assert done.status == 0, done.err
    whole = json.loads(out.read_text())
    assert whole["digitalTwinsModels"][0]["@context"] == "dtmi:dtdl:context;2"
    names = {twin["$dtId"] for twin in whole["digitalTwinsGraph"]["digitalTwins"]}
    assert {"lab.line", "lab.yard"} <= names


def test_without_a_server_it_is_said(run):
    done = run("twin", "composite", "list", "--server", "http://127.0.0.1:9")
    assert done.status == 2
    assert "127.0.0.1:9" in done.err


@pytest.mark.parametrize("verb", ["add", "list", "show", "import", "export"])
def test_each_verb_explains_itself(run, verb):
    assert run("twin", "composite", verb, "--help").status == 0

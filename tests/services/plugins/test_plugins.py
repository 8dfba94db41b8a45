"""A part of one's own is found by its name, and whatever it does costs itself only."""

import os
import threading
import time

import numpy as np
import pytest

from slowtime_services.files import RecordError, read_record
from slowtime_services.files.binary import reader_process
from slowtime_services.plugins import effect_kinds
from slowtime_services.plugins.discovery import PluginError, find, plugins
from slowtime_services.plugins.plugin_process import PluginProcess

BAD = """
import os, sys, time

def raises(*given):
    raise RuntimeError("no such luck")

def hangs(*given):
    time.sleep(600)

def nonsense(*given):
    print("this is no answer", flush=True)
    return [{"frequency_hz": "high"}]

def ends(*given):
    os._exit(7)

def echoes(*given):
    print("this is no answer", flush=True)
    return [len(given), str(given[0])[:10]]

def packets(url):
    yield b"one"
    yield bytearray(b"two")

def some_then_raises(url):
    yield b"one"
    raise RuntimeError("the device has gone")

def some_then_hangs(url):
    yield b"1"
    time.sleep(600)

def slowly(url):
    for number in range(100):
        yield b"1"
        time.sleep(0.5)

def not_bytes(url):
    yield "text"

nothing = 3
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install entry points of a distribution, without pip."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "bad_parts.py").write_text(BAD)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", str(site), prepend=os.pathsep)

    def install(group, name="own", target="bad_parts:raises", distribution="bad-parts"):
        info = site / f"{distribution.replace('-', '_')}-1.0.dist-info"
        info.mkdir(exist_ok=True)
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n"
        )
        with (info / "entry_points.txt").open("a") as file:
            file.write(f"[slowtime.{group}]\n{name} = {target}\n")
        return find(f"slowtime.{group}", name)

    return install


def test_a_part_is_listed_with_its_distribution_and_not_imported(installed):
    installed("readers", "rig", "nowhere:read")
    (one,) = plugins("slowtime.readers")
    assert (one.name, one.distribution, one.version) == ("rig", "bad-parts", "1.0")
    with pytest.raises(
        PluginError, match=r"'rig' of bad-parts 1.0 cannot be imported: ModuleNotFoundError"
    ):
        one.load()


def test_what_is_no_function_is_refused(installed):
    with pytest.raises(PluginError, match=r"is a int, not a function. Point its entry at"):
        installed("alarms", target="bad_parts:nothing").load()


def test_two_distributions_with_one_name_are_told_apart_by_nobody(installed):
    installed("alarms")
    with pytest.raises(
        PluginError, match=r"bad-parts and worse-parts each bring a alarm 'own'"
    ):
        installed("alarms", distribution="worse-parts")


def test_a_name_that_is_not_installed_is_told_with_those_that_are(installed):
    installed("alarms", "book")
    with pytest.raises(PluginError, match=r"No alarm 'bok' is installed. Installed: book"):
        find("slowtime.alarms", "bok")


def test_an_answer_is_what_the_part_returns_and_not_what_it_prints(installed):
    process = PluginProcess(installed("identifiers", target="bad_parts:echoes"))
    big = np.zeros(300_000)
    assert process.ask(big, 1, timeout_s=30.0)[0] == 2
    assert process.ask("again", timeout_s=30.0) == [1, "again"]
    process.close()


@pytest.mark.parametrize(
    ("target", "told"),
    [
        ("raises", r"'own' of bad-parts 1.0 failed: RuntimeError: no such luck\."),
        ("hangs", r"did not answer within 0.5 s, and was ended\."),
        ("ends", r"ended its process with exit status 7\."),
    ],
)
def test_a_fault_is_told_and_the_next_question_is_asked_again(installed, target, told):
    process = PluginProcess(installed("identifiers", target=f"bad_parts:{target}"))
    for _ in range(2):
        with pytest.raises(PluginError, match=told):
            process.ask(1, timeout_s=0.5 if target == "hangs" else 30.0)
    process.close()


def test_a_stream_gives_the_packets_and_ends(installed):
    process = PluginProcess(installed("sources", target="bad_parts:packets"))
    given = [x for x in process.stream("own:", stop=threading.Event()) if x is not None]
    assert given == [b"one", b"two"]


@pytest.mark.parametrize(
    ("target", "told"),
    [("some_then_raises", "the device has gone"), ("not_bytes", "TypeError")],
)
def test_a_stream_tells_what_was_raised(installed, target, told):
    process = PluginProcess(installed("sources", target=f"bad_parts:{target}"))
    with pytest.raises(PluginError, match=told):
        list(process.stream("own:", stop=threading.Event()))


def test_a_stream_that_hangs_is_ended_with_who_reads_it(installed):
    process = PluginProcess(installed("sources", target="bad_parts:hangs"))
    stop = threading.Event()
    given = process.stream("own:", stop=stop)
    assert next(given) is None
    child = process._process
    assert child is not None
    stop.set()
    assert list(given) == []
    assert child.poll() is not None


@pytest.mark.parametrize(
    ("target", "told"),
    [
        ("raises", "reader 'rig' of bad-parts 1.0.* cannot be read: no such luck"),
        ("hangs", "kept its reader busy"),
        ("nonsense", "it gave a list"),
        ("ends", "broke its reader"),
    ],
)
def test_a_reader_costs_its_own_file_only(installed, target, told, tmp_path, monkeypatch):
    monkeypatch.setattr(reader_process, "PATIENCE_S", 4.0 if target == "hangs" else 120.0)
    installed("readers", "rig", f"bad_parts:{target}")
    (tmp_path / "a.rig").write_bytes(b"\x00\x01")
    with pytest.raises(RecordError, match=told):
        read_record(tmp_path / "a.rig", rate_hz=1.0)


def test_files_that_slowtime_reads_are_given_to_nobody(installed, tmp_path):
    installed("readers", "csv", "bad_parts:raises")
    (tmp_path / "a.csv").write_text("1\n2\n4\n")
    assert len(read_record(tmp_path / "a.csv", rate_hz=1.0).samples) == 3


def test_an_effect_that_is_none_is_refused(installed):
    installed("effects", "odd", "bad_parts:nothing")
    with pytest.raises(
        effect_kinds.EffectFileError, match=r"'odd' of bad-parts 1.0 holds no kind"
    ):
        effect_kinds.known(["odd"])


def test_the_process_ends_with_who_asked(installed):
    process = PluginProcess(installed("identifiers", target="bad_parts:hangs"))
    with pytest.raises(PluginError):
        process.ask(1, timeout_s=0.2)
    process._start()
    child = process._process
    assert child is not None
    assert child.stdin is not None
    assert child.stdout is not None
    assert process._send((1,), time.monotonic() + 10.0)
    child.stdin.close()
    assert child.wait(30.0) == 0
    child.stdout.close()
    process._process = None

import io
import json
import signal
from typing import Any

import pytest
from rich.console import Console

from slowtime_cli.shared import terminal

ROWS = [("1.0 ± 0.1", "ambient"), ("2.0 ± 0.2", "")]
PLAIN: list[dict[str, Any]] = [
    {"frequency_hz": 1.0, "sd": 1 / 3, "valid": True, "flags": "a,b"},
    {"frequency_hz": 2.0, "sd": None, "valid": False, "flags": ""},
]


def test_a_pipe_gets_lines_of_fields_and_nothing_else(capsys):
    terminal.show("title", ("frequency [Hz]", "method"), ROWS, plain=PLAIN)
    assert capsys.readouterr().out.splitlines() == [
        "frequency_hz\tsd\tvalid\tflags",
        "1\t0.333333333\tyes\ta,b",
        "2\t\tno\t",
    ]


def test_no_cell_holds_a_mapping_or_a_list(capsys):
    nested = {"sum": {"median": 0.5, "by": {"dirlik 1": 2.0}}, "reasons": ["short", "noisy"]}
    terminal.show("", (), (), plain=[nested])
    assert capsys.readouterr().out.splitlines() == [
        "sum_median\tsum_by_dirlik_1\treasons",
        "0.5\t2\tshort; noisy",
    ]


def test_a_terminal_gets_a_table(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    terminal.show("title", ("frequency [Hz]", "method"), ROWS, plain=PLAIN)
    said = capsys.readouterr().out
    assert "1.0 ± 0.1" in said
    assert "title" in said
    assert "\t" not in said


def test_progress_is_for_terminals_only(capsys):
    with terminal.bar("Importing", 2) as tell:
        tell(1)
    with terminal.counting("Recording") as say:
        say("3 features")
    assert capsys.readouterr() == ("", "")


def test_progress_on_a_terminal_goes_to_stderr(capsys, monkeypatch):
    stream = io.StringIO()
    shown = Console(file=stream, force_terminal=True, width=80)
    monkeypatch.setattr(terminal, "ERR", shown)
    with terminal.bar("Importing", 2) as tell:
        tell(2)
    with terminal.counting("Recording") as say:
        say("3 features")
    assert "Importing" in stream.getvalue()
    assert "3 features" in stream.getvalue()
    assert capsys.readouterr().out == ""


def test_json_that_is_none_is_never_written(tmp_path):
    out = tmp_path / "a.json"
    terminal.write_json(out, {"value": 1.5})
    assert json.loads(out.read_text()) == {"value": 1.5}
    with pytest.raises(ValueError, match="JSON compliant"):
        terminal.write_json(out, {"value": float("nan")})
    assert json.loads(out.read_text()) == {"value": 1.5}


def test_half_a_file_is_removed_and_an_older_one_is_kept(tmp_path):
    out, old = tmp_path / "new", tmp_path / "old"
    old.write_text("kept")

    @terminal.removed_unless_finished(out)
    def interrupted():
        out.write_text("half")
        raise KeyboardInterrupt

    @terminal.removed_unless_finished(old)
    def refused():
        raise FileExistsError

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with pytest.raises(FileExistsError):
        refused()
    assert not out.exists()
    assert old.read_text() == "kept"
    with terminal.removed_unless_finished(out):
        out.write_text("whole")
    assert out.read_text() == "whole"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_wait_and_the_former_handler_comes_back(number):
    before = signal.getsignal(number)
    with terminal.until_signalled() as stop:
        signal.raise_signal(number)
        signal.raise_signal(number)
        assert stop.wait(60)
        assert stop.interrupted == (number == signal.SIGINT)
    assert signal.getsignal(number) is before


def test_the_end_of_a_duration_is_no_interruption():
    with terminal.until_signalled(0.01) as stop:
        assert stop.wait(60)
    assert not stop.interrupted

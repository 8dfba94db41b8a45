import os
import re
import signal
import subprocess
import sys

import click
import pytest

from slowtime_cli import __main__ as command
from slowtime_cli.__main__ import app
from slowtime_cli.verbs.suggestions import SYNONYMS
from slowtime_cli.verbs.tree import GROUPS, VERBS, paths


@pytest.mark.parametrize("verb", VERBS)
def test_the_list_of_verbs_says_what_each_verb_says_of_itself(verb):
    command = app.get_command(click.Context(app), verb)
    assert command is not None
    assert command.name == verb
    assert command.get_short_help_str(limit=1000) == VERBS[verb].help


def test_the_list_of_verbs_fits_a_terminal_of_80_columns(run):
    said = run("--help").out
    assert all(f"  {verb:12} {VERBS[verb].help}\n" in said for verb in VERBS)
    commands = said.partition("Analyse a record:")[2].partition("Examples:")[0]
    assert max(map(len, commands.splitlines())) < 80


def test_every_verb_is_in_one_group_of_the_help(run):
    grouped = [verb for verbs in GROUPS.values() for verb in verbs]
    assert sorted(grouped) == sorted(VERBS)
    said = run("--help").out
    places = [said.index(f"\n{heading}:\n") for heading in GROUPS]
    assert places == sorted(places)


def test_a_bare_command_shows_its_help(run):
    assert "Analyse a record:" in "".join(run()[1:])


def test_an_unknown_verb_or_flag_is_refused(refused):
    said = refused("frobnicate")
    assert "No such command 'frobnicate'. `slowtime --help` lists the commands." in said
    assert "No such option" in refused("--frobnicate")


@pytest.mark.parametrize(
    ("word", "verb"),
    [
        ("identfy", "identify"),
        ("modal", "identify"),
        ("forcast", "twin forecast"),
        ("server", "twin"),
        ("broker", "router"),
    ],
)
def test_a_word_that_is_no_verb_names_the_verb_that_it_means(refused, word, verb):
    assert re.search(rf"Did you mean .*`slowtime {verb}`", refused(word))


def test_every_synonym_names_verbs_and_is_none():
    known = {words.split()[-1] for words, _ in paths()}
    assert not set(SYNONYMS) & set(VERBS)
    meant = {verb for verbs in SYNONYMS.values() for verb in verbs}
    assert meant <= known | {"--help", "--version"}


def fails_with(error):
    @click.command()
    def failing() -> None:
        raise error

    return failing


@pytest.mark.parametrize(
    ("error", "status", "says"),
    [
        (ValueError("Give a number."), 2, r"^slowtime: Give a number\.\n$"),
        (FileNotFoundError(2, "No such file", "x"), 2, r"^slowtime: x: No such file\.\n$"),
        (click.UsageError("Give one of them."), 2, r"Error: Give one of them\.\n$"),
        (click.FileError("x.json", "is a folder"), 2, r"^slowtime: .*x\.json.*is a folder"),
        (KeyboardInterrupt(), 130, r"^\n?slowtime: Ended by Ctrl-C\.\n$"),
        (click.Abort(), 130, r"^\n?slowtime: Ended by Ctrl-C\.\n$"),
        (KeyError("boot"), 1, r"^slowtime: Internal error in slowtime: KeyError: 'boot'\."),
        (MemoryError("much"), 2, r"^slowtime: .*\. Give a smaller file, or more memory\.\n$"),
    ],
)
def test_every_error_has_its_exit_status_and_no_traceback(
    run, monkeypatch, error, status, says
):
    monkeypatch.setattr(app, "get_command", lambda _ctx, _name: fails_with(error))
    done = run("demo")
    assert (done.status, done.out) == (status, "")
    assert re.search(says, done.err), done.err


def test_what_failed_of_ours_can_be_seen_in_full(monkeypatch):
    monkeypatch.setattr(app, "get_command", lambda _ctx, _name: fails_with(KeyError("boot")))
    monkeypatch.setenv("SLOWTIME_DEBUG", "1")
    with pytest.raises(KeyError, match="boot"):
        command.main(["demo"])


@pytest.mark.long
def test_the_installed_command_leaves_with_the_same_statuses(start, record):
    refused = start("identify", "missing.csv")
    out, err = refused.communicate(timeout=300)
    assert (refused.returncode, out) == (2, "")
    assert "File 'missing.csv' does not exist" in err
    good = start("identify", record, "--out", "-")
    out, err = good.communicate(timeout=300)
    assert (good.returncode, err.count("\n")) == (0, 1)
    assert err.startswith("note: assumed: time from column 'time' in seconds")
    assert out.startswith("{")


@pytest.mark.long
def test_ctrl_c_ends_a_job_with_130_and_one_sentence(start, tmp_path):
    # Reading from a pipe that nobody writes to is work that does not end.
    os.mkfifo(tmp_path / "endless.csv")
    process = start("identify", "endless.csv")
    with (tmp_path / "endless.csv").open("w"):  # opens once the command reads
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=300)
    # The terminal's own ^C gets a line of its own.
    assert (process.returncode, out, err) == (130, "", "\nslowtime: Ended by Ctrl-C.\n")


@pytest.mark.long
def test_a_reader_that_leaves_early_is_no_error_to_speak_of(record):
    pipe = subprocess.run(
        f"{sys.executable} -m slowtime_cli identify {record} --out - | true",
        shell=True,
        capture_output=True,
        text=True,
    )
    assert pipe.returncode == 0
    assert pipe.stderr.startswith("note: assumed: time from column 'time'")
    assert pipe.stderr.count("\n") == 1  # and nothing of the pipe

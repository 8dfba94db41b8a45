import h5py
import numpy as np
import pytest
import scipy.io

from slowtime_services.replay import raw_blocks

SECONDS = "note: assumed: time from column 'time' in seconds, because no unit is stated.\n"
"""What is said of a clock whose name tells no unit."""


def modes(run, *arguments):
    done = run("identify", *arguments, "--method", "peak", "--out", "-")
    assert done.status == 0, done.err
    return done.json["modes"]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["csv", "npy", "npz", "v5.mat", "v73.mat"])
def test_what_is_imported_is_identified_as_the_file_itself(
    run, record, samples, clock, tmp_path, kind
):
    path = tmp_path / f"record.{kind}"
    flags = ("--rate-hz", 100) if kind == "npy" else ()
    columns = {"t": clock, "acc_x": samples[:, 0], "acc_y": samples[:, 1]}
    if kind == "npy":
        np.save(path, samples)
    elif kind == "npz":
        np.savez(path, **columns)
    elif kind == "v5.mat":
        scipy.io.savemat(path, columns)
    elif kind == "v73.mat":
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in columns.items():
                file[name] = values[None, :]
    done = run("import", path, *flags, "--out", "record.mcap")
    assert done.status == 0, done.err
    assert "6000 samples of" in done.out
    assert modes(run, "record.mcap") == modes(run, path, *flags)


def test_the_flags_are_those_of_identify(run, text, lines):
    path = text(["by hand", *(line.replace(",", ";") for line in lines[1:])], "Trial 1.txt")
    flags = ("--reading", "skip_lines=1", "--reading", "columns=when,north,east",
             "--reading", "time_column=when",
             "--channels", "east,north", "--rate-hz", 100)  # fmt: skip
    done = run("import", path, *flags, "--out", "trial.mcap")
    assert "samples of east, north at 100 Hz, 60.000 s, as import.trial-1" in done.out
    assert modes(run, "trial.mcap") == modes(run, path, *flags)


def test_the_same_file_gives_the_same_bytes(run, record, tmp_path):
    for name in ("a.mcap", "b.mcap"):
        assert run("import", record, "--asset", "x", "--out", name).status == 0
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_a_recording_says_when_it_began_and_whose_it_is(run, record):
    done = run("import", record, "--out", "a.mcap", "--site", "lab", "--asset", "beam",
               "--start", "2022-07-19T22:55:00Z", "--setting", "block_s=0.5")  # fmt: skip
    assert (done.status, done.err) == (0, SECONDS)
    blocks = list(raw_blocks("a.mcap"))
    header, block = blocks[0]
    assert (header.site, header.asset, header.boot) == ("lab", "beam", "import")
    assert block.start_ns == 1_658_271_300_000_000_000
    assert [len(block.samples) for _, block in blocks] == [50] * 120
    undated = run("import", record, "--out", "b.mcap")
    assert "does not state its start; 2000-01-01 is assumed. Give --start." in undated.err


def test_a_gap_stays_a_gap(run, text, lines):
    path = text(lines[:1000] + lines[1500:])
    assert run("import", path, "--out", "a.mcap").status == 0
    assert modes(run, "a.mcap") == modes(run, path)
    assert run("identify", "a.mcap", "--out", "-").json["duration_s"] == 60.0


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        ((), "Missing option '--out'"),
        (("--out", "a.txt"), "'a.txt' does not end in .mcap. Give one that does."),
        (
            ("--out", "nowhere/a.mcap"),
            "There is no folder nowhere for a.mcap. Create it first.",
        ),
        (
            ("--out", "a.mcap", "--site", "A B"),
            "'A B' is not a valid name. Allowed: at most 63 lower",
        ),
        (
            ("--out", "a.mcap", "--asset", "a/b"),
            "'a/b' is not a valid name. Allowed: at most 63 lower",
        ),
        (("--out", "a.mcap", "--start", "yesterday"), "Give one as 2022-07-19T22:55:00Z."),
        (("--out", "a.mcap", "--start", "1900-01-01"), "not between the years 1970 and 2262"),
        (("--out", "a.mcap", "--setting", "block_s=0"), "0.0 is not in the range x>0"),
        (("--out", "a.mcap", "--setting", "block_s=nan"), "nan is not a finite number"),
    ],
)
def test_what_cannot_be_written_is_refused_and_leaves_nothing(
    refused, record, tmp_path, flags, says
):
    assert says in refused("import", record, *flags)
    assert not list(tmp_path.glob("*.mcap"))


def test_a_recording_is_never_written_over(refused, record, tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"precious")
    assert "may be the only copy of a recording" in refused("import", record, "--out", "a.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"


def test_an_import_that_fails_leaves_no_half_of_a_recording(run, record, tmp_path, monkeypatch):
    from slowtime_services.exports import recordings

    def fails(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(recordings, "encode_raw", fails)
    assert run("import", record, "--out", "a.mcap").status == 130
    assert not (tmp_path / "a.mcap").exists()

import json

import numpy as np
import pytest
import scipy

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.response import free_response
from slowtime.dynamics.sdof.simulation import ambient_acceleration

SECONDS = "note: assumed: time from column 'time' in seconds, because no unit is stated.\n"
"""What is said of a clock whose name tells no unit."""


def sound(mode):
    """Whether a mode is as scripts expect it."""
    return all(
        set(mode[name]) == {"value", "sd"} and mode[name]["sd"] > 0
        for name in ("frequency_hz", "damping_ratio")
    )


@pytest.fixture
def decay(text):
    """A decay at 4 Hz, once each 10 s, without any noise."""
    times = np.arange(1000) / 100.0
    oscillator = Oscillator.from_modal(4.0, 0.01)
    once = np.asarray(free_response(oscillator, times, 1.0, 0.0)[0])
    return text([f"{x:.9f}" for x in np.tile(once, 3)], "decay.txt")


def test_a_whole_record_gives_its_modes(run, record):
    done = run("identify", record, "--out", "modes.json")
    assert (done.status, done.err) == (0, SECONDS)
    with open("modes.json") as file:
        found = json.load(file)
    (mode,) = found["modes"]
    assert sound(mode)
    error = mode["frequency_hz"]["value"] - 3.0
    assert abs(error) < 4 * mode["frequency_hz"]["sd"] < 0.2
    assert abs(mode["damping_ratio"]["value"] - 0.02) < 4 * mode["damping_ratio"]["sd"]
    assert set(mode) >= {"correlation", "snr_db", "method", "span_s", "flags"}
    assert {key: found[key] for key in ("record", "rate_hz", "channels", "duration_s")} == {
        "record": "record.csv",
        "rate_hz": 100.0,
        "channels": ["acc_x", "acc_y"],
        "duration_s": 60.0,
    }


def test_windows_give_epochs(run, decay):
    flags = ("--rate-hz", 100, "--window-s", 10, "--hop-s", 10, "--out", "-")
    found = run("identify", decay, *flags).json
    assert "modes" not in found
    assert found["window_s"] == 10.0
    assert [(e["start_s"], e["end_s"]) for e in found["epochs"]] == [
        (0, 10),
        (10, 20),
        (20, 30),
    ]
    for epoch in found["epochs"]:
        (mode,) = epoch["modes"]
        assert sound(mode)
        assert mode["frequency_hz"]["value"] == pytest.approx(4.0, abs=1e-3)


def test_windows_touch_unless_told_otherwise_and_overlapping_ones_are_marked(run, decay):
    flags = ("--rate-hz", 100, "--window-s", 10, "--method", "peak", "--out", "-")
    touching = run("identify", decay, *flags).json["epochs"]
    assert [epoch["start_s"] for epoch in touching] == [0.0, 10.0, 20.0]
    assert not any("overlapping" in m["flags"] for epoch in touching for m in epoch["modes"])
    several = run("identify", decay, *flags, "--hop-s", 5).json["epochs"]
    assert [epoch["start_s"] for epoch in several] == [0.0, 5.0, 10.0, 15.0, 20.0]
    assert all("overlapping" in m["flags"] for epoch in several for m in epoch["modes"])


def test_a_band_confines_the_search(run, record):
    above = run("identify", record, "--band-hz", 10, 40, "--out", "-")
    assert (above.status, above.json["modes"]) == (0, [])
    assert "no mode stands out from the noise" in above.err
    within = run("identify", record, "--band-hz", 2, 4, "--out", "-").json["modes"]
    assert within[0]["frequency_hz"]["value"] == pytest.approx(3.0, abs=0.1)


def test_a_record_of_less_than_four_cycles_is_told_where_its_motion_lies(run, tmp_path):
    t = np.arange(285) / 30.0
    slow = 0.4 * np.exp(-0.008 * t) * np.cos(2 * np.pi * 0.41 * t)
    slow += 0.002 * np.random.default_rng(5).standard_normal(len(t))
    path = tmp_path / "slow.csv"
    np.savetxt(path, np.column_stack([t, slow]), delimiter=",", header="t,x", comments="")
    found = run("identify", path, "--out", "-")
    assert (found.status, found.json["modes"]) == (0, [])
    assert "of the variance lies up to 0.421 Hz, four cycles in the record" in found.err
    assert "a slower mode" in found.err
    assert "--band-hz" in found.err
    ripple = slow + 0.004 * np.cos(2 * np.pi * 5.0 * t)
    np.savetxt(path, np.column_stack([t, ripple]), delimiter=",", header="t,x", comments="")
    both = run("identify", path, "--method", "peak", "--out", "-")
    assert both.json["modes"]
    assert "of the variance lies up to 0.421 Hz" in both.err


def test_a_pipe_gets_the_same_numbers_as_the_json_in_lines_of_fields(run, record):
    head, line = run("identify", record, "--out", "modes.json").out.splitlines()
    fields = dict(zip(head.split("\t"), line.split("\t"), strict=True))
    with open("modes.json") as file:
        (mode,) = json.load(file)["modes"]
    assert float(fields["frequency_hz"]) == pytest.approx(mode["frequency_hz"]["value"])
    assert float(fields["damping_sd"]) == pytest.approx(mode["damping_ratio"]["sd"])
    assert fields["method"] == mode["method"]


def test_a_terminal_gets_a_table_with_errors(run, record, monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert "±" in run("identify", record, "--method", "peak").out
    said = run("identify", record, "--method", "peak", "--window-s", 40).out
    assert "0 – 40" in said


def test_what_is_no_acceleration_is_left_out_where_others_are(run, text, lines):
    path = text(["time,acc_x,roller", *lines[1:]])
    found = run("identify", path, "--method", "peak", "--out", "-")
    assert found.json["channels"] == ["acc_x"]
    assert "roller left out, because name and unit do not show an acceleration" in found.err
    chosen = run("identify", path, "--method", "peak", "--channels", "roller", "--out", "-")
    assert chosen.json["channels"] == ["roller"]


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--band-hz", "1", "80"), "is not a band between 0 and 50 Hz, half the sampling rate"),
        (("--band-hz", "60", "80"), "is not a band between 0 and 50 Hz. Give"),
        (("--band-hz", "20", "2"), "Hz, or sample faster."),
        (("--band-hz", "-1", "2"), "Give 0 < low < high < "),
        (("--band-hz", "nan", "2"), "nan is not a finite number"),
        (("--band-hz", "3"), "requires 2 arguments"),
        (("--band-hz", "1", "80", "--window-s", "20"), "is not a band between 0 and 50 Hz"),
        (("--window-s", "100"), "without a gap, 60 s. Give a shorter window."),
        (("--window-s", "0.1"), "a window holds at least 32 samples (0.32 s) and at most"),
        (("--window-s", "0"), "0.0 is not in the range x>0"),
        (("--window-s", "inf"), "inf is not a finite number. Give one such as"),
        (("--window-s", "nan"), "nan is not a finite number. Give one such as"),
        (("--hop-s", "1"), "--hop-s goes with --window-s."),
        (("--window-s", "10", "--hop-s", "0.001"), "is less than one sample. Give at least"),
        (("--method", "magic"), "'magic' is not one of 'auto'"),
        (
            ("--out", "nowhere/modes.json"),
            "There is no folder nowhere for modes.json. Create it",
        ),
        (("--out", "."), "is a directory"),
    ],
)
def test_flags_that_cannot_be_met_are_refused(refused, record, flags, says):
    said = refused("identify", record, *flags)
    assert says.partition(". Give")[0] in said, said


def test_a_record_of_an_event_says_so_instead_of_listing_its_spectrum(run, text):
    rng = np.random.default_rng(7)
    shaking = rng.standard_normal(3000)
    shaking[:1500] *= 1e-3
    shaking[1500:] *= np.exp(-np.arange(1500) / 200.0)
    path = text([f"{x:.9f}" for x in shaking], "event.txt")
    done = run("identify", path, "--rate-hz", 100, "--out", "-")
    assert (done.status, done.json["modes"]) == (0, [])
    assert "the force was not steady and random" in done.err
    assert "No modes are reported" in done.err


@pytest.mark.long
def test_a_multisine_says_so_instead_of_listing_its_lines(run, text):
    rng = np.random.default_rng(8)
    times = np.arange(4000) / 100.0
    lines = [np.cos(2 * np.pi * k * times / 5.0 + rng.uniform(0, 7)) for k in range(1, 60)]
    path = text([f"{x:.9f}" for x in np.sum(lines, axis=0)], "multisine.txt")
    done = run("identify", path, "--rate-hz", 100, "--out", "-")
    assert (done.status, done.json["modes"]) == (0, [])
    assert "it repeats itself after 5 s, as a multisine does" in done.err


def record_with_gaps(text, seed):
    """Ten minutes of a mode at 3 Hz, 6 % lost in gaps of ten samples and more."""
    rng, count, rate = np.random.default_rng(seed), 15_000, 25.0
    sway = ambient_acceleration(Oscillator.from_modal(3.0, 0.02), count, rate, rng)
    present = np.ones(count, dtype=bool)
    while present.mean() > 0.94:
        first = rng.integers(1, count - 50)
        present[first : first + rng.integers(10, 41)] = False
    cells = [f"{x:.6f}" if there else "" for x, there in zip(sway, present, strict=True)]
    return text(["time,a", *(f"{k / rate:.2f},{x}" for k, x in enumerate(cells))], "lossy.csv")


@pytest.fixture
def lossy(text):
    return record_with_gaps(text, 11)


def test_all_samples_count_where_some_are_missing(run, text):
    squares = []
    for seed in (11, 12, 13, 14):
        done = run("identify", record_with_gaps(text, seed), "--out", "-")
        (mode,) = done.json["modes"]
        for name, true in (("frequency_hz", 3.0), ("damping_ratio", 0.02)):
            squares.append(((mode[name]["value"] - true) / mode[name]["sd"]) ** 2)
        assert mode["damping_ratio"]["sd"] < 0.004
        assert mode["span_s"][1] - mode["span_s"][0] == pytest.approx(600.0, abs=1.0)
        assert "bridged" in mode["flags"]
        assert "All others are used" in done.err
    # Eight errors as large as stated, those of one unlucky record among them.
    assert sum(squares) < scipy.stats.chi2.isf(0.01, len(squares))


def test_advice_on_gaps_works_when_it_is_followed(run, refused, lossy):
    done = run("identify", lossy, "--gaps", "split", "--out", "-")
    assert "only the longest part without a gap is used" in done.err
    assert "--gaps use takes all samples" in done.err
    assert run("identify", lossy, "--gaps", "use", "--out", "-").json["modes"]
    said = refused("identify", lossy, "--gaps", "split", "--window-s", "60")
    assert "Give a shorter window or --gaps use." in said
    followed = run("identify", lossy, "--gaps", "use", "--window-s", "60", "--out", "-")
    assert [epoch["start_s"] for epoch in followed.json["epochs"]] == [
        60.0 * k for k in range(10)
    ]
    assert sum(bool(epoch["modes"]) for epoch in followed.json["epochs"]) >= 9


def test_ways_with_gaps_that_do_not_fit_are_refused(refused, lossy):
    assert "Leave out" in refused("identify", lossy, "--stream", "--gaps", "split")
    assert "'guess' is not one of 'use'" in refused("identify", lossy, "--gaps", "guess")


def test_a_recording_of_a_polled_sensor_is_thinned_as_other_files_are(run, tmp_path):
    values = np.round(np.cumsum(np.random.default_rng(5).standard_normal((600, 2)), axis=0), 3)
    rows = np.repeat(np.arange(600), np.resize([2, 1], 600))
    table = np.column_stack([np.arange(len(rows)) / 150.0, values[rows]])
    np.savetxt(tmp_path / "poll.csv", table, delimiter=",", header="time_s,ax,ay", comments="")
    told = (
        "--reading",
        "repeated=keep",
        "--start",
        "2024-01-01T00:00:00Z",
        "--out",
        "poll.mcap",
    )
    assert run("import", "poll.csv", *told).status == 0
    done = run("identify", "poll.mcap")
    assert "600 rows at " in done.err

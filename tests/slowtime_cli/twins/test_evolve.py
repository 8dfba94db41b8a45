import json
import re

import numpy as np
import pytest

HEADER = "slow_time,frequency_hz,frequency_sd"


@pytest.fixture
def softening(text):
    """Sixty epochs at 5 Hz with an error of 1e-3, the last of them a tenth less stiff."""
    change = np.linspace(0.0, -0.1, 60)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(60)
    frequency = 5.0 * np.sqrt(1 + change) + noise
    return text([HEADER] + [f"{i},{f:.6f},0.001" for i, f in enumerate(frequency)])


def states(run, *arguments):
    done = run("twin", "evolve", *arguments, "--out", "-")
    assert done.status == 0, done.err
    return done.json["points"]


def epochs(*frequencies):
    mode = {"damping_ratio": {"value": 0.01, "sd": 1e-3}, "correlation": 0.0, "flags": []}
    return {
        "epochs": [
            {"start_s": 60.0 * i, "end_s": 60.0 * (i + 1), "modes": [
                mode | {"frequency_hz": {"value": f, "sd": 1e-3}}] if f else []}
            for i, f in enumerate(frequencies)
        ]
    }  # fmt: skip


@pytest.mark.parametrize("changes", ["stiffness", "mass"])
def test_text_gives_states_with_bands(run, softening, changes):
    found = states(run, softening, "--nominal-hz", 5, "--changes", changes)
    assert [state["slow_time"] for state in found] == list(range(60))
    last = found[-1][f"{changes}_change"]
    assert set(last) >= {"value", "sd", "lo", "hi"}
    expected = -0.1 if changes == "stiffness" else 1 / 0.9 - 1
    assert abs(last["value"] - expected) < 4 * last["sd"] < 0.01
    assert last["lo"] < last["value"] < last["hi"]
    assert found[-1]["valid"] is True


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_fields_may_be_divided_otherwise(run, softening, text, delimiter):
    rows = softening.read_text().splitlines()
    other = text(["\ufeff" + rows[0].replace(",", delimiter)]
                 + [row.replace(",", delimiter) for row in rows[1:]], "other.txt")  # fmt: skip
    expected = states(run, softening, "--nominal-hz", 5)
    assert states(run, other, "--nominal-hz", 5) == expected


def test_damping_is_used_where_it_is_known(run, text):
    rows = [f"{i},5,0.001,0.01,0.0001" for i in range(30)]
    path = text([HEADER + ",damping_ratio,damping_sd", *rows])
    found = states(run, path, "--changes", "both", "--nominal-hz", 5, "--nominal-damping", 0.01)
    assert found[-1]["damping_ratio"]["value"] == 0.01
    assert found[-1]["mass_change"]["sd"] > 0


def test_what_identify_wrote_is_taken(run, tmp_path):
    (tmp_path / "modes.json").write_text(json.dumps(epochs(5.0, None, 4.9)))
    found = states(run, "modes.json", "--nominal-hz", 5)
    assert [state["slow_time"] for state in found] == [30.0, 90.0, 150.0]
    assert [state["valid"] for state in found] == [True, False, True]
    assert found[2]["stiffness_change"]["value"] == pytest.approx((4.9 / 5) ** 2 - 1, abs=5e-3)


def test_the_nominal_is_learnt_where_it_is_not_given(run, softening):
    done = run(
        "twin", "evolve", softening, "--setting", "learn_epochs=10", "--out", "states.json"
    )
    assert done.status == 0
    assert re.search(
        r"note: not valid in \d+ of 60: The nominal model is still being", done.err
    )
    with open("states.json") as file:
        assert json.load(file)["points"][-1]["valid"]


def test_a_pipe_gets_every_epoch_in_lines_of_fields(run, softening):
    done = run("twin", "evolve", softening, "--nominal-hz", 5)
    head, *rows = done.out.splitlines()
    assert head.split("\t") == [
        "slow_time", "frequency_hz", "frequency_sd", "frequency_lo", "frequency_hi",
        "stiffness_change", "stiffness_change_sd", "stiffness_change_lo",
        "stiffness_change_hi", "valid", "reasons",
    ]  # fmt: skip
    assert len(rows) == 60
    assert {len(row.split("\t")) for row in rows} == {11}


def test_a_terminal_gets_a_table_of_some(run, softening, monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setattr("slowtime_cli.twins.evolve.MAX_ROWS", 20)
    done = run("twin", "evolve", softening, "--nominal-hz", 5)
    assert done.out.count("±") == 40
    assert "every 3th of 60 epochs is shown; --out writes all of them." in done.err


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([], "lacks the columns frequency_hz, frequency_sd, slow_time; its first line is ''"),
        ([HEADER], "holds no epoch. Give a source with at least one."),
        (["slow_time,frequency_hz", "0,5"], "lacks the columns frequency_sd; its first line"),
        (
            [HEADER, "0,5,x"],
            "line 2: frequency_sd is 'x', which is not a number. Correct or remove",
        ),
        ([HEADER, "0,5"], "line 2: frequency_sd is missing. Correct or remove that line."),
        ([HEADER, "0,nan,1"], "line 2: value=nan: Input should be a finite number. Correct"),
        (
            [HEADER, "inf,5,1"],
            "line 2: slow_time=inf: Input should be a finite number. Correct",
        ),
        ([HEADER, "0,5,-1"], "line 2: sd=-1.0: Input should be greater than or equal to 0."),
        (
            [HEADER, "0,-5,1"],
            "A frequency of -5.0 Hz is not positive. Correct or remove that line",
        ),
        ([HEADER, "5,5,1", "3,5,1"], "line 3: slow time goes from 5 to 3. Put the lines in"),
        ([HEADER, "5,5,1", "5,5,1"], "line 3: slow time goes from 5 to 5. Put the lines in"),
    ],
)
def test_text_that_is_wrong_is_refused_by_its_line(refused, text, rows, says):
    assert says in refused("twin", "evolve", text(rows, "epochs.csv"))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"{", "is not JSON: Expecting property name"),
        (b"\xff\xfe\x00", "is not text"),
        (b"[]", "has no epochs. Run `slowtime identify` with --window-s W"),
        (b'{"modes": []}', "has no epochs, but the modes of a whole record. Run `slowtime"),
        (b'{"epochs": []}', "holds no epoch. Give a source with at least one."),
        (b'{"epochs": [{"start_s": 0, "end_s": 1}]}', "epoch 0: 'modes' is missing. Give what"),
        (b'{"epochs": [3]}', "epoch 0: "),
        (
            json.dumps(epochs(5.0, -3.0)).encode(),
            "epoch 1: frequency_hz=Quantity(value=-3.0, sd=0.001): A frequency of -3.0 Hz is",
        ),
        (json.dumps(epochs(float("nan"))).encode(), "epoch 0: value=nan: Input should be a fi"),
    ],
)
def test_json_that_is_wrong_is_refused_by_its_epoch(refused, tmp_path, content, says):
    (tmp_path / "modes.json").write_bytes(content)
    assert says in refused("twin", "evolve", "modes.json")


def test_binary_that_is_called_text_is_refused(refused, tmp_path):
    (tmp_path / "a.csv").write_bytes(bytes(range(256)))
    assert "is not text (byte 128). Give a file in UTF-8" in refused("twin", "evolve", "a.csv")


def test_flags_that_do_not_go_together_are_refused(refused, softening):
    for flags, says in [
        (("--nominal-damping", 0.1), "--nominal-damping goes with --nominal-hz."),
        (("--nominal-hz", "nan"), "nan is not a finite number. Give one such as 1.5."),
        (("--nominal-hz", 5, "--nominal-damping", 1), "1.0 is not in the range 0<=x<1."),
        (("--asset", "demo.tower"), "--asset goes with an MCAP recording."),
        (("--asset", "tower"), "'tower' is not a valid name. Allowed: SITE.ASSET"),
        (
            ("--out", "nowhere/a.json"),
            "There is no folder nowhere for a.json. Create it first.",
        ),
        (("--changes", "colour"), "'colour' is not one of 'stiffness', 'mass', 'both'"),
    ]:
        assert says in refused("twin", "evolve", softening, *flags)


def test_a_recording_without_features_says_what_to_do_first(run, refused):
    assert run("simulate", "--structure", "tower", "--epochs", 1, "--out", "a.mcap").status == 0
    said = refused("twin", "evolve", "a.mcap")
    assert "holds no features. If it holds raw blocks, run `slowtime identify a.mcap" in said


def test_windows_that_overlap_count_for_what_their_samples_are_worth(run, tmp_path):
    body = epochs(*[5.0] * 12)
    touching = tmp_path / "touching.json"
    touching.write_text(json.dumps(body))
    for number, epoch in enumerate(body["epochs"]):
        epoch["start_s"], epoch["end_s"] = 15.0 * number, 15.0 * number + 60.0
    overlapping = tmp_path / "overlapping.json"
    overlapping.write_text(json.dumps(body))
    found = [
        run("twin", "evolve", path, "--nominal-hz", 5, "--out", "-")
        for path in (touching, overlapping)
    ]
    assert "windows overlap: each counts as 0.25 of an independent one" in found[1].err
    assert "overlap" not in found[0].err
    one, other = (done.json["points"][5]["frequency_hz"]["sd"] for done in found)
    assert other == pytest.approx(2 * one, rel=1e-6)

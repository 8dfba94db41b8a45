"""Scores and the page, from results that are made."""

import json
from typing import Any

import numpy as np
import pytest

from benchmarks.real_rigs.page import page_text, percent, write_page
from benchmarks.real_rigs.pictures import MOST_DRAWN, window
from benchmarks.real_rigs.scores import judge, outcome_of, relative_error
from benchmarks.real_rigs.sets import chosen
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import Campaign, Trial
from slowtime_services.models import read_description

TIMES = np.arange(3000) / 100
MEASURED = np.sin(TIMES)[:, None]
SENTENCE = "Dry friction (coulomb) at element guide: 20 N."


def effect(kind, family, *rivals):
    return {
        "effect": kind, "family": family, "alternatives": [{"effect": name} for name in rivals],
    }  # fmt: skip


def report(verdict, *effects, undecided=()):
    return {
        "verdict": verdict, "effects": list(effects), "sentence": SENTENCE,
        "undecided": [{"effect": name} for name in undecided], "notes": [],
    }  # fmt: skip


FRICTION, BIAS = effect("coulomb", "friction"), effect("input_bias", "input")


def write_result(folder, name, answers, told=None, exit_=0, seconds=12.0):
    result = folder / name
    result.mkdir(parents=True)
    (result / "run.json").write_text(
        json.dumps({
            "command": "slowtime_cli diagnose model.yaml", "exit": exit_, "load": 1.5,
            "cpu_seconds": seconds, "last_words": "Traceback\nValueError: no",
        })
    )  # fmt: skip
    if exit_:
        return
    np.savez(
        result / "holdout.npz", channels=np.array(["x"]), t=TIMES,
        record=np.zeros(len(TIMES), int), measured=MEASURED,
        **{key: MEASURED * (1 + share) for key, share in answers.items()},
    )  # fmt: skip
    if told is not None:
        (result / "report.json").write_text(json.dumps(told))
    else:
        (result / "answer.json").write_text(json.dumps({"readable": "1 e1 | 2 v1"}))


@pytest.fixture
def emps():
    return chosen(("emps",))[0]


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "out/emps"
    write_result(
        folder, "slowtime", {"nominal": 0.5, "refitted_nominal": 0.3, "augmented": 0.04},
        report("missing_effect", FRICTION, BIAS),
    )  # fmt: skip
    write_result(folder, "pysindy", {"augmented": 0.02})
    write_result(folder, "jax_sysid", {"augmented": 30.0})
    return folder


def test_the_error_is_that_of_the_run_over_the_scatter_by_channel():
    rng = np.random.default_rng(1)
    measured = rng.standard_normal((5000, 2)) * [1.0, 100.0] + [50.0, 0.0]
    run = measured + rng.standard_normal((5000, 2)) * [0.1, 30.0]
    assert relative_error(measured, run) == pytest.approx(0.2, rel=0.05)
    assert relative_error(measured, measured * [1, np.nan]) == float("inf")
    with pytest.raises(ValueError, match=r"is compared with a record of"):
        relative_error(measured, run[:-1])


@pytest.mark.parametrize(
    ("told", "verdict"),
    [
        (report("missing_effect", FRICTION, BIAS), "as known"),
        (report("missing_effect", FRICTION), "in part"),
        (
            report("missing_effect", FRICTION, BIAS, effect("cubic_hardening", "hardening")),
            "as known, and more",
        ),
        (report("missing_effect", effect("parametric", "parametric")), "another answer"),
        (report("nothing_missing"), "nothing found"),
        (report("unknown_effect"), "said to be unknown"),
        (
            report("undecided", BIAS, undecided=("stribeck", "cubic_softening")),
            "undecided, the known answer among what may be",
        ),
        (report("undecided", BIAS, undecided=("cubic_softening",)), "in part"),
    ],
)
def test_an_answer_is_judged_by_what_is_known(emps, told, verdict):
    assert judge(emps, told) == verdict


def test_nothing_missing_is_right_where_nothing_is():
    (frame,) = chosen(("frame",))
    assert judge(frame, report("nothing_missing")) == "as known"
    assert judge(frame, report("missing_effect", FRICTION)) == "claims what is not there"
    assert judge(frame, report("unknown_effect")) == "said to be unknown"
    (mount,) = chosen(("mount",))
    assert judge(mount, report("unknown_effect")) == "as known"


def test_a_diagnosis_by_spectra_alone_is_no_right_answer():
    """The words are those of the diagnosis itself: a record of noise, without an input."""
    (wheel,) = chosen(("wheel_radial",))
    model = read_description(wheel.model)
    noise = np.random.default_rng(1).standard_normal((2000, 1))
    trial = Trial(inputs=np.zeros((2000, 0)), outputs=noise, rate_hz=50.0)
    notes = diagnose(Campaign(description=model, trials=(trial,))).notes
    told = report("nothing_missing") | {"notes": list(notes)}
    assert judge(wheel, told) == "no free run: only spectra were compared"


def test_an_effect_named_by_spectra_alone_is_judged_as_any_other(emps):
    told = report("missing_effect", FRICTION) | {"notes": ["Spectra were compared."]}
    assert judge(emps, told) == judge(emps, report("missing_effect", FRICTION))


def test_every_contestant_has_its_error_time_and_words(emps, folder):
    outcome = outcome_of(emps, folder)
    assert outcome is not None
    found: dict[str, Any] = {row.name: (row.error, row.cpu_s) for row in outcome.rows}
    assert found["model as written"] == (pytest.approx(0.5, rel=0.01), None)
    assert found["model refitted"] == (pytest.approx(0.3, rel=0.01), None)
    assert found["slowtime"] == (pytest.approx(0.04, rel=0.01), 12.0)
    assert found["PySINDy"] == (pytest.approx(0.02, rel=0.01), 12.0)
    ours, matrices = outcome.row("slowtime"), outcome.row("jax-sysid")
    assert ours is not None
    assert matrices is not None
    assert ours.readable == "yes: coulomb, input_bias"
    assert matrices.readable.startswith("no: ")
    assert outcome.behind == "PySINDy"


def test_the_page_holds_the_sentence_the_least_error_and_who_is_ahead(emps, folder, tmp_path):
    page = tmp_path / "docs/rigs.md"
    write_page(page, tmp_path / "out", {"rub": "rub.npz is not there"})
    text = page.read_text()
    (row,) = [line for line in text.splitlines() if line.startswith("| [emps](#emps)")]
    cells = [cell.strip() for cell in row.split("|")[2:8]]
    assert cells == ["50 %", "30 %", "4 %", "**2 %**", "diverged", "–"]
    assert f"> {SENTENCE}" in text
    assert "in: emps (PySINDy)." in text
    assert "`rub` (rub.npz is not there)" in text
    assert "an equation: 1 e1 \\| 2 v1" in text
    assert "`slowtime diagnose model.yaml`" in text
    assert "![measured and simulated](rigs/emps.png)" in text
    picture = tmp_path / "docs/rigs/emps.png"
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert picture.stat().st_size < 120_000
    again = picture.read_bytes()
    write_page(page, tmp_path / "out", {"rub": "rub.npz is not there"})
    assert (page.read_text(), picture.read_bytes()) == (text, again)


def test_a_contestant_that_failed_is_told_with_its_last_words(emps, tmp_path):
    folder = tmp_path / "emps"
    write_result(folder, "slowtime", {}, exit_=2)
    write_result(folder, "pysindy", {"augmented": 0.1})
    outcome = outcome_of(emps, folder)
    assert outcome is not None
    assert outcome.verdict == "failed"
    ours = outcome.row("slowtime")
    assert ours is not None
    assert "ValueError: no" in ours.readable
    text = page_text([outcome], {}, "pictures")
    assert "| – | – | – | **10 %** | – | – | failed |" in text


@pytest.mark.parametrize(
    ("error", "words"),
    [(None, "–"), (0.00123, "0.12 %"), (0.0994, "9.9 %"), (0.304, "30 %"), (11.0, "diverged")],
)
def test_errors_are_written_with_two_digits(error, words):
    assert percent(error) == words


def test_the_largest_motion_is_drawn_of_a_long_record():
    values = np.zeros(9000)
    values[8990] = -3.0
    shown = window(values)
    assert 8990 in range(9000)[shown]
    assert len(values[shown]) == MOST_DRAWN
    assert window(values[:MOST_DRAWN]) == slice(None)

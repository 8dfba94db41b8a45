"""Answers about laws that are in no list: sorted, and the sure of a wrong family found."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.blind.laws import UNLISTED
from tests.blind.outside.cases import draw
from tests.blind.outside.verdicts import tabulate, text_of, verdict_row

LIKE = "Of the laws known here, it is most like Hysteresis (bouc_wen) (96 %) along the motion."


def row_of(verdict, named=(), undecided=(), probability=0.95, error=1.0, tmp=None, notes=()):
    """Figures of a Preisach law that was answered in one way, its free run off by `error`."""
    noise = np.array([0.1])
    measured = np.zeros((400, 1))
    np.savez(tmp / "clean.npz", measured=measured, noise=noise, channels=["a1"])
    augmented = measured + error * noise
    np.savez(tmp / "holdout.npz", augmented=augmented, channels=["a1"])
    row = {
        "case": "c", "truth": ["preisach"], "verdict": verdict, "named": list(named),
        "undecided": list(undecided), "failed": verdict == "failed", "predictable": True,
        "stated": [{"probability": probability, "right": False}] * len(named),
        "effect_to_noise_db": 20.0, "seconds": 3.0,
    }  # fmt: skip
    truth = {"effects": [{"effect": "preisach"}]}
    return verdict_row(truth, {"verdict": verdict, "notes": list(notes)}, row, tmp, tmp)


ANSWERS: list[tuple[dict[str, Any], str, bool]] = [
    ({"verdict": "unknown_effect"}, "unknown", False),
    ({"verdict": "unknown_effect", "notes": [LIKE]}, "resembling", False),
    ({"verdict": "missing_effect", "named": ["bouc_wen_general"]}, "related name at the noise",
     False),
    ({"verdict": "missing_effect", "named": ["bouc_wen"], "error": 1.3},
     "related name above the noise", False),
    ({"verdict": "missing_effect", "named": ["cubic_softening"]}, "unrelated name", True),
    ({"verdict": "missing_effect", "named": ["cubic_softening"], "probability": 0.6},
     "unrelated name", False),
    ({"verdict": "missing_effect", "named": ["sensor_gain"]}, "unrelated name", True),
    ({"verdict": "undecided", "undecided": ["dahl", "bouc_wen"]}, "undecided among related",
     False),
    ({"verdict": "undecided", "undecided": ["dahl", "added_mass"]}, "undecided with unrelated",
     False),
    ({"verdict": "nothing_missing"}, "nothing said", False),
    ({"verdict": "failed"}, "failed", False),
]  # fmt: skip


@pytest.mark.parametrize(("answer", "said", "sure"), ANSWERS)
def test_an_answer_is_sorted_by_what_it_claims(answer, said, sure, tmp_path):
    row = row_of(tmp=tmp_path, **answer)
    assert (row["said"], row["sure_of_a_wrong_family"]) == (said, sure)
    assert row["error_over_floor"] == pytest.approx(answer.get("error", 1.0))


def test_tables_count_the_targets(tmp_path):
    rows = [row_of(tmp=tmp_path, **answer) for answer, _, _ in ANSWERS]
    rows += [row_of("unknown_effect", error=3.0, tmp=tmp_path)]
    tables = tabulate(rows)
    assert tables["unknown or resembling"]["right"] == 5
    assert tables["the same, undecided not counted"]["right"] == 4
    assert tables["sure of a wrong family"]["right"] == 2
    assert tables["held-out error at most twice the noise"]["right"] == len(rows) - 1
    assert "related name at the noise" in text_of(tables, rows)


def test_where_no_free_run_was_written_the_error_is_not_known(tmp_path):
    row = row_of("unknown_effect", tmp=tmp_path)
    Path(tmp_path / "holdout.npz").unlink()
    again = verdict_row({"effects": [{"effect": "preisach"}]}, None, row, tmp_path, tmp_path)
    assert again["error_over_floor"] is None
    assert tabulate([again])["held-out error at most twice the noise"]["right"] == 0


def test_every_law_comes_once_before_any_comes_again():
    drawn = draw(2 * len(UNLISTED), 3)
    assert draw(7, 3) == drawn[:7]
    kinds = [design.kinds[0] for _, design, _ in drawn]
    assert sorted(kinds[: len(UNLISTED)]) == sorted(kinds[len(UNLISTED) :]) == sorted(UNLISTED)
    assert {design.size for _, design, _ in drawn} <= {1, 2, 3}

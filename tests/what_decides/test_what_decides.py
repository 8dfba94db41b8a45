"""What can be left out is there, does not act once left out, and is put back."""

import importlib
import json

import pytest

from slowtime.discrepancy.search import search
from slowtime.discrepancy.search.settings import SearchSettings
from slowtime.discrepancy.thresholds import LIMITS
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, KINDS, TWO, records_of
from tests.what_decides import steps
from tests.what_decides.ablation import Ablation
from tests.what_decides.table import table
from tests.what_decides.thresholds import Change, changed, changes, with_changes


@pytest.mark.parametrize("guard", steps.GUARDS, ids=lambda guard: guard.label)
def test_each_guard_is_called_where_the_table_says(guard):
    module = importlib.import_module(f"{steps.PACKAGE}.{guard.module}")
    assert callable(getattr(module, guard.name))


def test_labels_are_unique():
    labels = [*steps.every_step(), *(one.label for one in changes())]
    assert len(set(labels)) == len(labels)


def test_the_library_acts_and_without_it_nothing_of_it_does():
    from slowtime.discrepancy.calibration import refit
    from slowtime.discrepancy.progress import Monitor
    from slowtime.dynamics.plant import Plant

    trials = records_of((CUBIC,))
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    told = {}
    for left_out in (None, "proposer: library"):
        acts: set[str] = set()
        with steps.without(left_out, acts) as options:
            search(fit, trials, SearchSettings(KINDS, Monitor(), options))
        told[left_out] = acts
    assert "proposer: library" in told[None]
    assert "proposer: library" not in told["proposer: library"]


@pytest.mark.parametrize(
    ("value", "factor", "other"),
    [
        (4.0, 0.5, 2.0), (4, 2.0, 8), (1, 0.5, 1), (0.9, 2.0, 0.8), (0.9, 0.5, 0.95),
        (1e-3, 2.0, 2e-3), ((0.5, 3), 2.0, (1.0, 6)),
    ],
)  # fmt: skip
def test_a_threshold_is_halved_and_doubled(value, factor, other):
    assert changed(value, factor) == pytest.approx(other)
    assert type(changed(value, factor)) is type(value)


def test_a_changed_threshold_is_seen_wherever_it_was_imported_and_is_put_back():
    from slowtime.discrepancy.search import lost_records

    own = Change(lost_records.__name__, "UNTRACKED_CHI2", 2.0)
    shared = Change(type(LIMITS).__module__, "LIMITS.least_log_evidence", 0.5)
    before = lost_records.UNTRACKED_CHI2, LIMITS.least_log_evidence
    with with_changes([own, shared]):
        assert lost_records.UNTRACKED_CHI2 == 2 * before[0]
        assert LIMITS.least_log_evidence == before[1] / 2
    assert (lost_records.UNTRACKED_CHI2, LIMITS.least_log_evidence) == before


class Pretended:
    """A case of which one threshold and one step decide."""

    name, package = "pretended", steps.PACKAGE

    def __init__(self, deciding: str) -> None:
        self.deciding, self.count = deciding, 0

    def diagnosed(self, options, out):
        self.count += 1
        wrong = LIMITS.least_log_evidence != 6.0 or len(options.proposers) == 0
        named = [] if wrong else ["coulomb at element j1"]
        return {
            "verdict": "v",
            "named": named,
            "undecided": [],
            "left": 1.0,
            "right": not wrong,
        }


def test_the_threshold_that_decides_is_found_among_hundreds_and_work_is_kept(tmp_path):
    case = Pretended("least_log_evidence")
    first = Ablation(case, tmp_path / "one.json", lambda: case.count < 20)
    with pytest.raises(TimeoutError):
        first.run()
    again = Ablation(case, tmp_path / "one.json", lambda: True)
    again.run()
    names = {label.partition(" x ")[0] for label in again.known["deciding"]}
    assert names == {"thresholds: LIMITS.least_log_evidence"}
    assert case.count < 80
    done = case.count
    Ablation(case, tmp_path / "one.json", lambda: True).run()
    assert case.count == done
    text = table([json.loads((tmp_path / "one.json").read_text())])
    assert "| thresholds: LIMITS.least_log_evidence x 2 | 1 | 1 | 0 |" in text

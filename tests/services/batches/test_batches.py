"""Folders of cases, runs that are interrupted, and the table of all."""

import csv
import dataclasses
import json
import sys
import threading

import pytest

from slowtime_services.batches import CaseBatch, cases_of, run_batch, write_summary
from slowtime_services.engines import JobEnd, LocalEngine

REPORT = {
    "verdict": "missing_effect",
    "sentence": "Dry friction.",
    "effects": [
        {"effect": "coulomb", "where": {"kind": "element", "id": "j1"}, "probability": 0.98}
    ],
    "undecided": [],
    "gap": {"nominal": 0.5, "refitted_nominal": 0.4, "augmented": 0.02, "noise_floor": 0.01},
}


@pytest.fixture
def rigs(tmp_path):
    folder = tmp_path / "rigs"
    for name in ("b", "a"):
        (folder / name).mkdir(parents=True)
        for record in ("low.csv", "high.csv", "holdout_1.csv"):
            (folder / name / record).write_text(f"{name} {record}")
    (folder / "model.yaml").write_text("above")
    (folder / "b" / "own.yml").write_text("own")
    return folder


def names(paths):
    return [path.name for path in paths]


def test_each_subfolder_with_records_is_a_case(rigs):
    (rigs / "empty").mkdir()
    one, other = cases_of(rigs)
    assert (one.name, one.model.name) == ("a", "model.yaml")
    assert (other.name, other.model.name) == ("b", "own.yml")
    assert names(one.records) == ["high.csv", "low.csv"]
    assert names(one.holdout) == ["holdout_1.csv"]


def test_a_table_lists_the_cases(rigs):
    (rigs / "cases.csv").write_text(
        "name,model,records,holdout\n"
        "second,model.yaml,a/low.csv; a/high.csv,\n"
        "first,b/own.yml,b/low.csv,b/holdout_1.csv\n"
    )
    second, first = cases_of(rigs)
    assert (second.name, names(second.records), second.holdout) == (
        "second", ["low.csv", "high.csv"], (),
    )  # fmt: skip
    assert names(first.holdout) == ["holdout_1.csv"]


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ("name,model\n", "has no column 'records'"),
        ("name,model,records\nx,model.yaml,absent.csv\n", "line 2: there is no file"),
        ("name,model,records\nx,model.yaml,\n", "line 2: case 'x' has no records"),
        ("name,model,records\n../x,model.yaml,a/low.csv\n", "names no case"),
        ("name,model,records\n" + 2 * "x,model.yaml,a/low.csv\n", "are called 'x'"),
        ("name,model,records\n", "There are no cases"),
    ],
)
def test_a_wrong_table_is_told_with_its_line(rigs, table, told):
    (rigs / "cases.csv").write_text(table)
    with pytest.raises(ValueError, match=told):
        cases_of(rigs)


def test_a_case_without_a_model_is_told(rigs):
    (rigs / "model.yaml").unlink()
    with pytest.raises(ValueError, match="has 0 model files"):
        cases_of(rigs)


CODE = """
import json, pathlib, sys
name, out = sys.argv[1:]
with open({log!r}, "a") as log:
    print(name, file=log)
if name == "b":
    sys.exit("no such channel")
pathlib.Path(out, "report.json").write_text({report!r})
"""


@pytest.fixture
def batch(rigs, tmp_path):
    log = tmp_path / "begun.txt"
    log.touch()
    code = CODE.format(log=str(log), report=json.dumps(REPORT))

    def command(case, into):
        return (sys.executable, "-c", code, case.name, str(into))

    return CaseBatch(cases=cases_of(rigs), out=tmp_path / "out", command=command), log


def run(batch, stop=None):
    return sorted(
        run_batch(batch, LocalEngine(1), stop or threading.Event()), key=lambda o: o.name
    )


def test_what_is_finished_is_not_run_again(batch, rigs):
    made, log = batch
    first = run(made)
    assert [one.status for one in first] == ["done", "failed"]
    assert run(made) == first
    assert sorted(log.read_text().split()) == ["a", "b"]
    (rigs / "a" / "low.csv").write_text("measured again")
    assert [one.status for one in run(made)] == ["done", "failed"]
    assert sorted(log.read_text().split()) == ["a", "a", "b"]


def test_another_command_runs_all_cases_again(batch):
    made, log = batch
    run(made)
    quick = dataclasses.replace(
        made, command=lambda case, into: (*made.command(case, into)[:4], str(into) + "/.")
    )
    run(quick)
    assert sorted(log.read_text().split()) == ["a", "a", "b", "b"]


def test_a_report_that_is_gone_is_made_again(batch):
    made, log = batch
    run(made)
    (made.out / "a" / "report.json").unlink()
    run(made)
    assert sorted(log.read_text().split()) == ["a", "a", "b"]


def test_a_stopped_batch_goes_on_later(batch):
    made, log = batch
    stop = threading.Event()
    stop.set()
    assert run(made, stop) == []
    assert log.read_text() == ""
    assert len(run(made)) == 2


def test_the_table_has_a_row_for_each_case(batch):
    made, _ = batch
    path = write_summary(made.out, run(made))
    good, bad = csv.DictReader(path.read_text().splitlines())
    assert good["verdict"] == "missing_effect"
    assert good["effects"] == "coulomb@j1"
    assert float(good["error_augmented"]) == 0.02
    assert (bad["status"], bad["sentence"]) == ("failed", "no such channel")


def test_a_case_without_a_diagnosis_has_its_status(tmp_path):
    path = write_summary(tmp_path, [JobEnd("x", "too_slow", 60.0, 1)])
    (row,) = csv.DictReader(path.read_text().splitlines())
    assert (row["status"], row["verdict"]) == ("too_slow", "")

"""The verb `reliability` and the files it reads."""

import json
from pathlib import Path

import numpy as np
import pytest

from slowtime.reliability import METHODS
from slowtime_cli.verbs.models import reliability
from slowtime_services.problem_files.reliability import read_stated_problem

EXAMPLE = Path(__file__).parents[3] / "docs/examples/column.yaml"
BEAM = """slowtime_reliability: 1
inputs:
  r: {marginal: normal, mean: 10, sd: 1.2}
  s: {marginal: normal, mean: 5, sd: 0.9}
"""


def write(tmp_path, text, name="beam.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def results(run, *arguments):
    done = run("reliability", *map(str, arguments), "--out", "-")
    assert done.status == 0, done.err
    return {one["method"]: one for one in json.loads(done.out)["results"]}


def test_the_verb_knows_every_method():
    assert tuple(METHODS) == reliability.METHODS


def test_methods_stand_side_by_side_with_design_points(run, tmp_path):
    path = write(tmp_path, BEAM + "limit_state: r - s\n")
    done = run("reliability", str(path), "--method", "form", "--method", "mean-value")
    assert done.status == 0
    table, points = done.out.split("\n\n")
    assert [line.split("\t")[0] for line in table.splitlines()] == [
        "method",
        "form",
        "mean-value",
    ]
    assert points.splitlines()[0].startswith("design_point\tbeta\tinput")
    assert "mean-value: Mean-value index: it depends" in done.err


def test_json_holds_what_each_method_found_and_the_seed_decides(run, tmp_path):
    path = write(tmp_path, BEAM + "limit_state: r - s\n")
    found = results(
        run, path, "--method", "form", "--method", "importance", "--setting", "seed=4"
    )
    assert found["form"]["beta"] == pytest.approx(10.0 / 3.0)
    assert found["form"]["interval"] is None
    assert found["form"]["design_points"][0]["x"]["r"] == pytest.approx(6.8, abs=1e-3)
    lo, hi = found["importance"]["interval"]
    assert lo < 4.29e-4 < hi
    again = results(run, path, "--method", "importance", "--setting", "seed=4")
    assert again["importance"] == found["importance"]


def test_the_example_has_dependent_inputs_and_an_index_between_2_and_3(run):
    found = results(run, EXAMPLE, "--method", "form")
    assert 2.3 < found["form"]["beta"] < 2.8


def test_a_python_function_is_given_inputs_by_name_or_all_at_once(run, tmp_path):
    path = write(tmp_path, BEAM)
    named = write(tmp_path, "def g(s, r):\n    return r - s\n", "named.py")
    whole = write(tmp_path, "def g(x):\n    return x[:, 0] - x[:, 1]\n", "whole.py")
    for own in (named, whole):
        found = results(run, path, "--limit-state", own, "--method", "form")
        assert found["form"]["beta"] == pytest.approx(10.0 / 3.0)


def test_a_python_file_may_hold_the_whole_problem(run, tmp_path):
    text = (
        "from slowtime.reliability import Problem, unknowns\n"
        "problem = Problem(unknowns(2), lambda u: 3.0 - u[:, 0])\n"
    )
    found = results(run, write(tmp_path, text, "problem.py"), "--method", "form")
    assert found["form"]["beta"] == pytest.approx(3.0, abs=1e-4)


def test_a_system_of_parts_has_bounds(run, tmp_path):
    text = BEAM + "system: series\nparts:\n  slip: r - s\n  crush: 12 - s - 0.1 * r\n"
    found = results(run, write(tmp_path, text), "--method", "system")
    lo, hi = found["system"]["bounds"]
    assert lo <= found["system"]["probability"] <= hi


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BEAM, "has no limit state"),
        (BEAM + "limit_state: r - t\n", r"line 5: 't' is not an input. Inputs: r, s"),
        (BEAM + "limit_state: __import__('os').system('true')\n", "is not allowed|no function"),
        (BEAM + "limit_state: r.real - s\n", "'r.real' is not allowed"),
        (BEAM + "limit_state: (r\n", "is not a valid formula|line"),
        (BEAM + "limit_sate: r - s\n", "line 5: unknown key `limit_sate`"),
        (
            "slowtime_reliability: 1\ninputs:\n  r: {marginal: norm, mean: 1, sd: 1}\n"
            "limit_state: r\n",
            "line 3: Marginal 'norm' is not known",
        ),
        (
            BEAM + "limit_state: r - s\ncorrelations:\n  - {between: [r, s]}\n",
            "line 7: .*exactly one of linear",
        ),
        (
            BEAM + "limit_state: r - s\ncopulas:\n  - {of: [r, s], copula: clayton}\n",
            "line 7: A clayton copula takes theta alone",
        ),
        ("- 1\n", "Begin it with `slowtime_reliability: 1`"),
        ("", "is empty. Begin it with `slowtime_reliability: 1`"),
        ("# nothing yet\n", "is empty. Begin it with `slowtime_reliability: 1`"),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_line_and_cure(refused, tmp_path, text, said):
    import re

    path = write(tmp_path, text)
    assert re.search(said, refused("reliability", str(path)))


def test_a_file_may_add_many_inputs(tmp_path):
    laws = "".join(f"  x{k}: {{marginal: normal, mean: 1, sd: 1}}\n" for k in range(200))
    total = " - ".join(f"x{k} + x{k + 1}" for k in range(0, 200, 2))
    path = write(tmp_path, f"slowtime_reliability: 1\ninputs:\n{laws}limit_state: {total}\n")
    limit_state = read_stated_problem(path)[0].limit_state
    x = np.random.default_rng(1).standard_normal((5, 200))
    signs = np.array([1.0, *[s for _ in range(99) for s in (1.0, -1.0)], 1.0])
    assert limit_state(x) == pytest.approx(x @ signs)


def test_nan_is_refused_unless_told_to_count_as_failed(run, refused, tmp_path):
    text = BEAM + "limit_state: sqrt(r - 9) - s + 6\n"
    path = write(tmp_path, text)
    assert "returned NaN at" in refused("reliability", str(path), "--method", "monte-carlo")
    told = write(tmp_path, text + "invalid: fails\n", "told.yaml")
    found = results(run, told, "--method", "monte-carlo", "--setting", "cov=0.2")
    assert 0.1 < found["monte-carlo"]["probability"] < 0.5

"""The verb `surrogate`: a quick function of runs, and tables of numbers."""

import numpy as np
import pytest

from slowtime.surrogate.choice import defaults
from slowtime_cli.verbs.models.surrogate import KINDS


@pytest.fixture
def runs(tmp_path):
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, size=(60, 2))
    table = np.column_stack([x, 1.0 + x[:, 0] + 0.5 * x[:, 1] ** 2])
    path = tmp_path / "runs.csv"
    np.savetxt(path, table, delimiter=",", header="a,b,y", comments="")
    (tmp_path / "points.csv").write_text("b;a\n0.5;0.25\n0;9\n")
    return path


def test_each_kind_has_a_name():
    assert len(KINDS) == len(defaults())


def test_points_are_predicted_and_those_beyond_the_runs_are_told(run, runs):
    points = runs.parent / "points.csv"
    done = run(
        "surrogate", str(runs), "--output", "y", "--kind", "chaos", "--kind", "matern",
        "--at", str(points), "--out", "-",
    )  # fmt: skip
    assert done.status == 0, done.err
    found = done.json
    assert found["chosen"] == "chaos"
    near, far = found["predictions"]
    assert near["value"] == pytest.approx(1.375, abs=1e-6)
    assert not near["extrapolated"]
    assert far["extrapolated"]
    assert "1 of 2 points lie outside the range of the runs" in done.err
    # Var(a) = 1/3; Var(b^2 / 2) = 1/45: shares 15/16 and 1/16.
    assert [one["first"] for one in found["sobol"]] == pytest.approx(
        [15 / 16, 1 / 16], abs=1e-3
    )


@pytest.mark.parametrize(
    ("text", "more", "said"),
    [
        ("a,b,y\n1,2,x\n", (), "'x' of y is not a finite number"),
        ("a,b,y\n1,2\n", (), "2 fields under 3 names"),
        ("a,a,y\n1,2,3\n", (), "Give each a name, once"),
        ("a,b,z\n1,2,3\n", (), "y cannot be used so"),
        ("a,b,y\n1,2,3\n", ("--inputs", "a,c"), "c cannot be used so"),
        ("a,b,y\n", (), "no rows below a heading"),
    ],
)
def test_a_table_that_cannot_be_used_says_why(run, tmp_path, text, more, said):
    path = tmp_path / "runs.csv"
    path.write_text(text)
    done = run("surrogate", str(path), "--output", "y", *more)
    assert done.status != 0
    assert said in done.err

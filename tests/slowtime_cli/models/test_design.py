"""The verb `design` and the files it reads."""

from pathlib import Path

import pytest

from slowtime_schemas.files.model import SpringElement
from slowtime_services.models import read_model

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
ROD = """slowtime_design: 1
variables:
  area: {lower: 1, upper: 9, unit_cost: 2}
inputs:
  load: {marginal: normal, mean: 5, sd: 1}
objective: {formula: cost}
limit_states:
  yielding: {formula: 3 * area - load, probability: 0.01}
"""


def write(tmp_path, text, name="rod.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def designs(run, *arguments):
    done = run("design", *map(str, arguments), "--out", "-")
    assert done.status == 0, done.err
    return done.json["designs"]


def refused(run, *arguments):
    done = run("design", *map(str, arguments))
    assert done.status != 0
    assert "Traceback" not in done.err
    return done.err


def test_a_rod_is_as_thick_as_the_quantile_of_its_load(run, tmp_path):
    found = designs(run, write(tmp_path, ROD), "--setting", "cov=0.01")[0]
    exact = (5 + 2.3263) / 3
    assert found["best"]["variables"]["area"] == pytest.approx(exact, rel=0.003)
    assert found["best"]["mean"] == pytest.approx(2 * exact, rel=0.003)
    constraint = found["best"]["constraints"]["yielding"]
    assert constraint["probability"] == pytest.approx(0.01, rel=0.1)
    assert constraint["met"] is not False
    assert found["feasible"] is True


def test_a_damper_is_chosen_and_built_into_the_model(run, tmp_path):
    out = tmp_path / "built.yaml"
    best = designs(run, EXAMPLES / "damper.yaml", "--out", out)[0]["best"]
    before, after = read_model(EXAMPLES / "frame.yaml"), read_model(out)
    assert len(after.elements) == len(before.elements) + 1
    damper = after.elements[-1]
    assert damper.id == "damper"
    assert isinstance(damper, SpringElement)
    assert damper.damping_n_s_per_m == pytest.approx(best["variables"]["damper"])
    assert all(one["met"] is not False for one in best["constraints"].values())


@pytest.mark.long
def test_less_weight_on_the_mean_gives_less_spread(run):
    found = designs(
        run, EXAMPLES / "damper.yaml", *("--alpha", 1, "--alpha", 0.5, "--alpha", 0)
    )
    best = [one["best"] for one in found]
    assert best[0]["mean"] < best[1]["mean"] < best[2]["mean"]
    assert best[0]["sd"] > best[1]["sd"] > best[2]["sd"]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("lower: 1, upper: 9", "lower: 9, upper: 1", "line 3: Bounds 9 to 1 were given"),
        ("3 * area", "3 * aria", "line 8: 'aria' is not an input"),
        ("mean: 5, sd: 1", "mean: 5", "line 5"),
        ("probability: 0.01", "probability: 2", "line 8: `probability`"),
        ("unit_cost: 2", "adds: mass, node: roof", "give `model`"),
        ("slowtime_design: 1", "slowtime_design: 7", "line 1"),
        ("inputs:", "model: nowhere.yaml\nload: {kind: noise, psd: 1}\nresponses: "
         "{r: {quantity: displacement, node: roof}}\ninputs:", "no file"),
        ("inputs:", "load: {kind: noise}\ninputs:", "needs psd"),
        ("  load: {marginal", "  cost: {marginal", "`cost` is taken"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_says_where_and_why(run, tmp_path, old, new, text):
    assert old in ROD
    assert text in refused(run, write(tmp_path, ROD.replace(old, new)))


def test_models_may_be_written_of_one_design_only(run, tmp_path):
    said = refused(
        run, EXAMPLES / "damper.yaml", "--alpha", 1, "--alpha", 0,
        "--out", tmp_path / "x.yaml",
    )  # fmt: skip
    assert "Give one --alpha" in said

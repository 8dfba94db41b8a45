"""The bench of forecasts: its histories, its oracle and its scores."""

import numpy as np
import pytest
from scipy.special import ndtr

from benchmarks.methods.calibration import bench, histories, oracle
from benchmarks.methods.calibration.histories import CURVES, LAWS, case


@pytest.mark.parametrize("law", LAWS)
def test_a_history_is_the_same_each_time_and_its_question_is_open_at_first(law):
    one, again = case(law, 4, seed=3), case(law, 4, seed=3)
    np.testing.assert_array_equal(one.value, again.value)
    assert one.threshold == again.threshold
    before = one.truth[one.fine < histories.INSTANTS[0]]
    assert one.threshold < before.min()
    read = np.interp(one.time, one.fine, one.truth)
    assert np.std(one.value - read) == pytest.approx(one.sd, rel=0.35)


def test_the_oracle_of_lines_says_what_integration_says():
    one = case("linear", 5, seed=3)
    readings = len(one.time) // 2
    futures = oracle.futures(one, readings, np.random.default_rng(0))
    level, slope = (grid.ravel() for grid in np.meshgrid(*2 * [np.linspace(-4, 4, 401)]))
    u = np.column_stack([level, slope])
    away = (one.value[:readings] - CURVES["linear"].curve(u, one.time[:readings])) / one.sd
    log = -0.5 * (away**2).sum(axis=1) - 0.5 * (u**2).sum(axis=1)
    weight = np.exp(log - log.max())
    end = CURVES["linear"].curve(u, np.array([1.0]))[:, 0]
    mean = float(weight @ end / weight.sum())
    sd = float(np.sqrt(weight @ (end - mean) ** 2 / weight.sum()))
    assert futures.paths[:, -1].mean() == pytest.approx(mean, abs=0.2 * sd)
    assert futures.paths[:, -1].std() == pytest.approx(sd, rel=0.15)
    # The line falls: it is below the threshold before the end if it is so at the end.
    exact = float(weight @ (end <= one.threshold) / weight.sum())
    assert futures.probability(one.threshold) == pytest.approx(exact, abs=0.05)


def test_a_walk_that_is_bridged_passes_as_often_as_reflection_says():
    step, count = 0.01, 4000
    steps = np.sqrt(step) * np.random.default_rng(1).standard_normal((count, 100))
    paths = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, axis=1)], axis=1)
    futures = oracle.Futures(np.linspace(0.0, 1.0, 101), paths, np.ones(count))
    assert futures.probability(-1.0) == pytest.approx(2.0 * ndtr(-1.0), abs=0.02)


def test_probabilities_that_follow_evidence_do_not_flicker_and_others_do():
    """Draws from an urn: the posterior of what it holds is a martingale."""
    rng = np.random.default_rng(2)
    honest, restless = [], []
    fixed: dict[str, list[float]] = {"honest": [], "restless": []}
    for _ in range(4000):
        truth = rng.random() < 0.5
        odds, told = 0.0, []
        for _ in range(4):
            red = rng.random() < (0.7 if truth else 0.3)
            odds += np.log(7 / 3) if red else -np.log(7 / 3)
            told.append(1.0 / (1.0 + np.exp(-odds)))
        rows = [{"crossed": False, "p": p} for p in told]
        honest.append(bench._flicker({"happened": truth, "rows": rows}))
        nervous = [{"crossed": False, "p": 1.0 / (1.0 + (1 / p - 1) ** 2)} for p in told]
        restless.append(bench._flicker({"happened": truth, "rows": nervous}))
        fixed["honest"].append(bench._movement({"rows": rows}))
        # From 0.7 and 0.3 on: what is too sure at first has to come back.
        fixed["restless"].append(bench._movement({"rows": nervous}))
    assert abs(np.mean(honest)) < 4.0 * np.std(honest) / np.sqrt(4000)
    assert np.mean(restless) > 4.0 * np.std(restless) / np.sqrt(4000)
    found = {name: np.mean(each) / np.std(each) * 4000**0.5 for name, each in fixed.items()}
    assert abs(found["honest"]) < 4.0 < found["restless"]


@pytest.mark.parametrize("low", [0.0, 0.05, 0.4, 0.95, 1.0])
def test_shares_of_a_remaining_life_beyond_the_end_add_up(low):
    assert sum(bench._place(low, 1.0)) == pytest.approx(1.0)
    assert sum(bench._place(low, low)) == 1.0


def test_a_bench_goes_on_where_its_results_end(tmp_path, capsys):
    file = tmp_path / "results.jsonl"
    asked = ["--results", str(file), "--histories", "1", "--laws", "linear"]
    assert bench.main(asked) == 0
    first = file.read_text()
    file.write_text(first + '{"law": "cut sh')
    assert bench.main(asked) == 0
    assert file.read_text() == first + '{"law": "cut sh'
    bench.keep({**bench.read(file)["linear", 0], "number": 1}, file)
    assert list(bench.read(file)) == [("linear", 0), ("linear", 1)]
    printed = capsys.readouterr().out
    assert printed.count("| linear |") == 2

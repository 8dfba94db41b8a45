import numpy as np
import pytest

from slowtime.surrogate import GaussianProcess, PolynomialChaos, SupportVectors, choose

CANDIDATES = {"chaos": PolynomialChaos(), "process": GaussianProcess(starts=1, folds=1)}


def test_a_polynomial_is_given_to_polynomials_and_kinks_to_a_process():
    rng = np.random.default_rng(0)
    x = rng.uniform(size=(40, 2))
    smooth = choose(x, x[:, 0] ** 2 - 3.0 * x[:, 0] * x[:, 1], CANDIDATES)
    assert smooth.name == "chaos"
    assert isinstance(smooth.surrogate, PolynomialChaos)
    line = np.sort(rng.uniform(size=(40, 1)), axis=0)
    kinked = choose(line, np.abs((5.0 * line[:, 0]) % 1.0 - 0.5), CANDIDATES)
    assert kinked.name == "process"
    assert kinked.candidates[0].rmse < kinked.candidates[1].rmse


# What is noise is no function of anything, and the chaos that is chosen says so too.
@pytest.mark.filterwarnings("ignore::slowtime.surrogate.SurrogateWarning")
def test_it_says_why_in_words_with_numbers():
    rng = np.random.default_rng(1)
    x = rng.uniform(size=(40, 2))
    chosen = choose(x, x[:, 0] ** 2 - x[:, 1], CANDIDATES)
    assert "chaos foretells points left out best: its error is" in chosen.why
    assert "process comes next, with" in chosen.why
    noise = choose(x, rng.standard_normal(40), CANDIDATES)
    assert "is no worse than chance allows" in noise.why
    assert "Even so it explains little" in noise.why


def test_a_candidate_that_fails_is_told_and_the_others_go_on():
    x = np.random.default_rng(2).uniform(size=(12, 3))
    chosen = choose(x, x[:, 0], {**CANDIDATES, "machine": SupportVectors()}, folds=3)
    assert chosen.candidates[-1].name == "machine"
    assert "machine failed: 8 points say nothing of a 95 % band" in chosen.why
    with pytest.raises(ValueError, match=r"No candidate could be fitted\. machine: 8 points"):
        choose(x, x[:, 0], {"machine": SupportVectors()}, folds=3)
    with pytest.raises(ValueError, match="There is nothing to choose from"):
        choose(x, x[:, 0], {})


def test_what_it_compares_is_left_as_it_was():
    x = np.random.default_rng(3).uniform(size=(20, 1))
    given = {"process": GaussianProcess(starts=1, folds=1)}
    choose(x, np.sin(x[:, 0]), given, folds=3)
    assert not hasattr(given["process"], "process_")

import numpy as np
import pytest
from scipy import stats

from slowtime.evolution import stiffness_from_frequency
from slowtime.evolution.reasons import Reason
from slowtime.evolution.stiffness_mass.surrogate_inversion import changes_from_frequencies
from slowtime.surrogate import GaussianProcess, PolynomialChaos
from slowtime.surrogate.problems import PROBLEMS


class Exact:
    """A frequency that is known as a function, to a standard deviation."""

    def __init__(self, function, sd=0.0):
        self.function, self.sd = function, sd

    def predict(self, X, return_std=False):
        return self.function(X), np.full(len(X), self.sd)


ROOT = Exact(lambda x: np.sqrt(1.0 + x[:, 0]))
UNIFORM = [stats.uniform(-0.5, 0.7)]


def column(*values):
    return np.array(values, dtype=float)[:, None]


def test_of_one_stiffness_it_is_the_answer_of_the_formula():
    readings = column(1.0, 0.95, 0.9, 0.8)
    for sd in (0.02, 0.002, 2e-5):
        found = changes_from_frequencies(
            [ROOT], readings, np.full_like(readings, sd), prior=UNIFORM
        ).each[0]
        formula = stiffness_from_frequency(
            readings[:, 0], sd, bounds=(-0.5, 0.2), flat_in="change"
        )
        np.testing.assert_allclose(found.value, formula.value, atol=0.1 * sd)
        np.testing.assert_allclose(found.sd, formula.sd, rtol=0.05)
        np.testing.assert_allclose(found.lo, formula.lo, atol=0.25 * sd)
        np.testing.assert_allclose(found.hi, formula.hi, atol=0.25 * sd)
        assert found.valid.all()


def test_what_the_surrogate_does_not_know_widens_the_answer_like_a_reading():
    readings = column(0.9)
    unsure = Exact(ROOT.function, sd=0.03)
    by_surrogate = changes_from_frequencies([unsure], readings, column(0.0), prior=UNIFORM)
    by_reading = changes_from_frequencies([ROOT], readings, column(0.03), prior=UNIFORM)
    np.testing.assert_allclose(by_surrogate.each[0].sd, by_reading.each[0].sd, rtol=1e-9)


def test_stiffness_and_mass_from_one_frequency_are_one_line_and_said_not_separable():
    one = Exact(lambda x: np.sqrt((1.0 + x[:, 0]) / (1.0 + x[:, 1])))
    prior = [stats.norm(0.0, 0.1)] * 2
    found = changes_from_frequencies([one], column(1.0), column(0.001), prior=prior)
    assert found.correlation[0, 0, 1] > 0.99
    np.testing.assert_allclose(found.posterior_to_prior, np.sqrt(0.5), atol=0.05)
    blind = Exact(lambda x: 1.0 + x[:, 0] + 0.0 * x[:, 1])
    found = changes_from_frequencies([blind], column(1.05), column(0.01), prior=prior)
    assert found.each[0].valid[0]
    assert found.each[1].reasons[0] == Reason.NOT_SEPARABLE


def test_two_modes_tell_two_changes():
    first = Exact(lambda x: 2.0 + x[:, 0] + 0.2 * x[:, 1])
    second = Exact(lambda x: 5.0 + 0.5 * x[:, 0] - 1.0 * x[:, 1])
    truth = np.array([[-0.12, 0.05]])
    readings = np.stack([first.function(truth), second.function(truth)], axis=1)
    found = changes_from_frequencies(
        [first, second], readings, np.full((1, 2), 0.001), prior=[stats.norm(0.0, 0.2)] * 2
    )
    slopes = np.array([[1.0, 0.2], [0.5, -1.0]])
    exact = np.linalg.inv(slopes.T @ slopes / 1e-6 + np.eye(2) / 0.04)
    for k in range(2):
        assert found.each[k].value[0] == pytest.approx(truth[0, k], abs=2e-4)
        assert found.each[k].sd[0] == pytest.approx(np.sqrt(exact[k, k]), rel=0.05)


def test_a_mode_that_was_not_seen_says_nothing_and_nonsense_is_flagged():
    both = [ROOT, ROOT]
    half = changes_from_frequencies(
        both, np.array([[0.9, np.nan]]), np.array([[0.01, np.nan]]), prior=UNIFORM
    )
    alone = changes_from_frequencies([ROOT], column(0.9), column(0.01), prior=UNIFORM)
    assert half.each[0].value[0] == pytest.approx(alone.each[0].value[0])
    odd = changes_from_frequencies(
        [ROOT], column(np.nan, 0.9, 1.5, 0.9), column(0.01, -1.0, 0.01, np.nan), prior=UNIFORM
    ).each[0]
    assert odd.reasons.tolist() == [
        Reason.NOT_FINITE,
        Reason.NEGATIVE_SD,
        Reason.OUTSIDE_BOUNDS,
        Reason.NOT_FINITE,
    ]
    with pytest.raises(ValueError, match=r"1 surrogates for 2 modes"):
        changes_from_frequencies([ROOT], np.ones((1, 2)), np.ones((1, 2)), prior=UNIFORM)


@pytest.mark.parametrize("kind", [GaussianProcess(starts=1, folds=1), PolynomialChaos()])
def test_bands_through_a_surrogate_of_a_frame_hold_the_truth(kind):
    problem = PROBLEMS["frame"]
    rng = np.random.default_rng(0)
    change = np.linspace(-0.4, 0.1, 9)
    points = np.zeros((9, 10))
    points[:, 0] = change
    surrogate = kind.fit(change[:, None], problem.function(points))
    truth = rng.uniform(-0.35, 0.05, 120)
    asked = np.zeros((120, 10))
    asked[:, 0] = truth
    sd = np.full((120, 1), 0.004)
    readings = problem.function(asked)[:, None] + sd * rng.standard_normal((120, 1))
    prior = [stats.uniform(-0.4, 0.5)]
    found = changes_from_frequencies([surrogate], readings, sd, prior=prior, draws=512).each[0]
    assert np.mean((found.lo <= truth) & (truth <= found.hi)) == pytest.approx(0.95, abs=0.05)
    assert np.sqrt(np.mean(((found.value - truth) / found.sd) ** 2)) == pytest.approx(
        1.0, abs=0.15
    )

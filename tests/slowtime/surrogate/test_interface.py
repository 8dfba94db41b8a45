import subprocess
import sys

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from slowtime.surrogate import (
    ExtrapolationWarning,
    FewPointsWarning,
    GaussianProcess,
    GeneralisedAnova,
    HybridExpansion,
    IllConditionedWarning,
    NetworkEnsemble,
    PlainProcess,
    PolynomialChaos,
    SupportVectors,
    SurrogateWarning,
)
from slowtime.surrogate.problems import PROBLEMS

MEMBERS = [
    PolynomialChaos(degree=1, method="least squares"),
    PolynomialChaos(),
    GaussianProcess(starts=1, folds=1),
    HybridExpansion(degree=2, interaction=1, starts=1, folds=1),
    GeneralisedAnova(degree=2, interaction=1, starts=1, folds=1),
    SupportVectors(grid={"C": [10.0], "gamma": [0.1], "epsilon": [0.01]}),
    NetworkEnsemble(hidden=(5,), iterations=60),
    PlainProcess(),
]
ODD = "check_do_not_raise_errors_in_init_or_set_params"
members = pytest.mark.parametrize("member", MEMBERS, ids=lambda one: type(one).__name__)


@pytest.fixture
def plane():
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (30, 2))
    return x, 3.0 + x[:, 0] - 2.0 * x[:, 1] + 0.5 * x[:, 0] * x[:, 1]


# scikit-learn's checks ask for the impossible on purpose; that it is warned of is tested below.
@pytest.mark.filterwarnings("ignore::slowtime.surrogate.SurrogateWarning")
@parametrize_with_checks(
    MEMBERS[:1],
    expected_failed_checks=lambda one: {ODD: "beartype checks types first; see below"},
)
def test_scikit_learn_finds_its_own_conventions(estimator, check):
    check(estimator)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::slowtime.surrogate.SurrogateWarning")
@parametrize_with_checks(
    MEMBERS[1:],
    expected_failed_checks=lambda one: {ODD: "beartype checks types first; see below"},
)
def test_scikit_learn_finds_its_own_conventions_in_the_others_too(estimator, check):
    check(estimator)


@pytest.mark.slow
def test_settings_are_checked_when_they_are_used_and_not_before():
    names = ", ".join(sorted({type(one).__name__ for one in MEMBERS}))
    code = (
        f"from slowtime.surrogate import {names}\n"
        f"from sklearn.utils.estimator_checks import {ODD} as check\n"
        f"for one in ({names}): check(one.__name__, one())"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@members
def test_units_of_inputs_and_outputs_do_not_matter(member, plane):
    x, y = plane
    mean, sd = clone(member).fit(x, y).predict(x[:5], return_std=True)
    scaled = clone(member).fit(1e4 * x + 7.0, 1e-6 * y)
    other, its = scaled.predict(1e4 * x[:5] + 7.0, return_std=True)
    np.testing.assert_allclose(1e6 * other, mean, rtol=1e-5, atol=5e-4)
    np.testing.assert_allclose(1e6 * its, sd, rtol=0.05, atol=1e-4)


@members
def test_a_band_is_as_wide_as_its_level(member, plane):
    x, y = plane
    fitted = clone(member).fit(x, y + 0.1 * np.random.default_rng(1).standard_normal(30))
    narrow, wide = fitted.predict_interval(x, 0.5), fitted.predict_interval(x, 0.95)
    assert (wide[0] < narrow[0]).all()
    assert (narrow[1] < wide[1]).all()
    with pytest.raises(ValueError, match=r"level=95.0 is outside \(0, 1\)\. Give 0\.95"):
        fitted.predict_interval(x, 95.0)


@members
def test_constant_outputs_are_refused(member):
    with pytest.raises(ValueError, match=r"All 20 outputs are 5: there is nothing to learn"):
        clone(member).fit(np.random.default_rng(0).uniform(size=(20, 2)), np.full(20, 5.0))


@members
def test_too_few_points_are_warned_of(member, plane):
    x, y = plane
    with pytest.warns(FewPointsWarning, match=r"5 points in 2 inputs.*Give 6 or more"):
        clone(member).fit(x[:5], y[:5])
    with pytest.raises(ValueError, match="minimum of 3"):
        clone(member).fit(x[:2], y[:2])


@members
def test_points_beyond_the_box_are_flagged_where_they_are(member, plane):
    fitted = clone(member).fit(*plane)
    asked = [[0.0, 0.0], [0.1, 1.7]]
    assert fitted.extrapolates(asked).tolist() == [False, True]
    with pytest.warns(ExtrapolationWarning, match=r"1 of 2 points.*point 1: input 1 is 1\.7"):
        fitted.predict(asked)
    with pytest.raises(ValueError, match=r"1 of 2 points"):
        fitted.set_params(extrapolation="raise").predict(asked)
    fitted.set_params(extrapolation="ignore").predict(asked)
    with pytest.raises(ValueError, match=r"extrapolation='hide' is not known"):
        fitted.set_params(extrapolation="hide").fit(*plane)


def test_points_within_the_box_but_off_the_design_are_flagged():
    rng = np.random.default_rng(2)
    for inputs in (2, 3, 6):
        common = rng.uniform(size=(80, 1))
        x = common + 0.02 * rng.standard_normal((80, inputs))
        fitted = GaussianProcess(starts=1, folds=1).fit(x, np.sin(3.0 * x[:, 0]))
        corner = np.full((1, inputs), 0.1)
        corner[0, 0] = 0.9
        assert fitted.extrapolates(corner)[0]
        assert not fitted.extrapolates(x.mean(axis=0, keepdims=True))[0]
        with pytest.warns(ExtrapolationWarning, match="within the box, off the design"):
            fitted.predict(corner)


def test_of_a_designs_own_law_next_to_nothing_is_flagged():
    for name, problem in PROBLEMS.items():
        x, _ = problem.design(100, np.random.default_rng(4))
        fitted = PolynomialChaos(degree=1).fit(x, x[:, 0])
        share = fitted.extrapolates(problem.draws(300, np.random.default_rng(5))[0]).mean()
        assert share < 0.05, name


def test_inputs_that_cannot_be_told_apart_are_named(plane):
    x, y = plane
    twice = np.column_stack([x, 2.0 * x[:, 1] - 1.0])
    with pytest.warns(IllConditionedWarning, match=r"Inputs \[1, 2\] vary together"):
        GaussianProcess(starts=1, folds=1).fit(twice, y)
    still = np.column_stack([x, np.ones(30)])
    with pytest.warns(IllConditionedWarning, match=r"Input 2 is 1 at every point"):
        GaussianProcess(starts=1, folds=1).fit(still, y)


def test_pipelines_and_searches_take_them(plane):
    x, y = plane
    scores = cross_val_score(
        make_pipeline(
            StandardScaler(), GaussianProcess(starts=1, folds=1, extrapolation="ignore")
        ),
        x,
        y,
        cv=3,
    )
    assert scores.min() > 0.95
    search = GridSearchCV(
        PolynomialChaos(extrapolation="ignore"), {"degree": [1, 2]}, cv=3
    ).fit(x, y)
    assert search.best_params_ == {"degree": 2}


def test_every_warning_is_of_one_family():
    for one in (ExtrapolationWarning, FewPointsWarning, IllConditionedWarning):
        assert issubclass(one, SurrogateWarning)


@pytest.mark.long
def test_a_process_that_needs_no_surrogate_does_without_scikit_learn_or_says_what_to_install():
    code = (
        "import sys, slowtime.surrogate, edge_agent.__main__\n"
        "assert 'sklearn' not in sys.modules\n"
        "sys.modules['sklearn'] = None\n"
        "try: slowtime.surrogate.GaussianProcess\n"
        "except ModuleNotFoundError as error: print(error)"
    )
    said = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    )
    assert "pip install 'slowtime[surrogate]'" in said.stdout

import numpy as np
from scipy.integrate import solve_ivp

from slowtime.history_diagnosis.laws import regressors


def test_a_lagging_covariate_solves_the_equation_of_a_body_of_heat(rng):
    time = np.sort(rng.uniform(0.0, 1.0, 30))
    values = rng.standard_normal(30)
    solution = solve_ivp(
        lambda t, z: (np.interp(t, time, values) - z) / 0.07,
        (time[0], time[-1]),
        values[:1],
        t_eval=time,
        max_step=1e-3,
        rtol=1e-8,
    )
    np.testing.assert_allclose(
        regressors.lagged(time, values, 0.07), solution.y[0], atol=1e-4, rtol=0
    )


def test_a_lag_as_good_as_none_follows_at_once(rng):
    time, values = np.arange(20.0), rng.standard_normal(20)
    np.testing.assert_allclose(regressors.lagged(time, values, 1e-6), values, atol=1e-5)


def test_equal_times_do_not_upset_a_lag():
    lagged = regressors.lagged(
        np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0, 1.0]), 0.5
    )
    assert np.isfinite(lagged).all()
    assert lagged[1] == lagged[2]


def test_both_sides_of_a_bend_make_up_the_line():
    values = np.linspace(-2.0, 3.0, 11)
    np.testing.assert_allclose(regressors.bilinear(values, 0.4).sum(axis=1), values - 0.4)


def test_an_exponential_grows_from_0_to_1_over_the_history():
    for rate in (-5.0, 0.5, 8.0):
        np.testing.assert_allclose(
            regressors.exponential(np.array([0.0, 1.0]), rate)[:, 0], [0.0, 1.0]
        )


def test_time_since_a_fall_starts_anew_at_each_and_the_first_tooth_has_a_level_of_its_own():
    since = regressors.irregular_sawtooth(np.array([0.0, 0.2, 0.3, 0.6, 0.9, 1.4]), [0.8, 0.25])
    np.testing.assert_allclose(since[:, 0], [0.0, 0.2, 0.05, 0.35, 0.1, 0.6])
    np.testing.assert_array_equal(since[:, 1], [1, 1, 0, 0, 0, 0])


def test_a_sawtooth_falls_back_as_often_as_it_has_cycles():
    time = np.linspace(0.0, 1.0, 2001)
    teeth = regressors.sawtooth(time, 4.0, 0.3)[:, 0]
    assert (np.diff(teeth) < -0.9).sum() == 4
    assert np.ptp(teeth) <= 1.0

import numpy as np
import pytest
import scipy.optimize
import scipy.signal as sps
from scipy.integrate import solve_ivp

from slowtime.discrepancy.noise import (
    estimate,
    estimate_noise,
    response_limit_hz,
)
from slowtime.discrepancy.noise import (
    fisher_scoring as climb,
)
from slowtime.discrepancy.noise.colour import Colour, white_noise
from slowtime.discrepancy.noise.incoherent_power import incoherent_power
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, Node, Spring

RATE, SAMPLES = 200.0, 6000
PROBES = np.array([0.5, 2.0, 5.0, 10.0, 30.0, 80.0])


def coloured(rng, pole, trials=3):
    """Autoregressive noise of unit innovations, a column a sensor."""
    white = rng.standard_normal((trials, SAMPLES + 500, 2))
    return sps.lfilter([1.0], [1.0, -pole], white, axis=1)[:, 500:]


def truth(pole):
    return 2 / RATE / np.abs(1 - pole * np.exp(-2j * np.pi * PROBES / RATE)) ** 2


def estimated(residuals, silent_hz, inputs=None):
    pushed = np.zeros((SAMPLES, 0)) if inputs is None else inputs
    trials = tuple(Trial(inputs=pushed, outputs=r, rate_hz=RATE) for r in residuals)
    return estimate_noise(trials, tuple(residuals), silent_above_hz=silent_hz)


@pytest.mark.parametrize("pole", [0.0, 0.6, 0.9, 0.97])
def test_noise_alone_is_found_with_its_colour(pole):
    noise = estimated(coloured(np.random.default_rng(1), pole), 0.0)
    ratio = noise.density(1, PROBES) / truth(pole)[:, None]
    assert np.all(np.abs(np.log(ratio)) < 0.25)
    for row in zip(*noise.colours, strict=True):
        assert all(colour.coloured == 0 for colour in row) is (pole == 0.0)


def test_strength_is_each_trials_own_and_has_an_honest_error():
    errors = []
    for seed in range(20):
        residuals = (
            coloured(np.random.default_rng(seed), 0.0) * np.array([1, 2, 4])[:, None, None]
        )
        noise = estimated(residuals, 20.0)
        for trial, factor in enumerate([1, 4, 16]):
            found = noise.density(trial, PROBES[:1])[0] / truth(0.0)[0] / factor
            errors.append(np.log(found) / np.array(noise.relative_sd[trial]))
    assert 0.75 < np.std(errors) < 1.3


@pytest.mark.parametrize(("pole", "factor"), [(0.0, 4.0), (0.9, 6.0)])
def test_a_resonance_in_the_residual_hardly_lifts_the_floor(pole, factor):
    rng = np.random.default_rng(2)
    residuals = coloured(rng, pole)
    for i, residual in enumerate(residuals):
        shaken = rng.standard_normal((SAMPLES, 1))
        for frequency in (3.0, 8.0):
            b, a = sps.iirpeak(frequency, 25, fs=RATE)
            residual += 30 * (i + 1) * sps.lfilter(b, a, shaken, axis=0) * [1.0, 2.0]
    assert np.median(residuals[2].std(axis=0)) > 4 * np.median(coloured(rng, pole).std(axis=1))
    noise = estimated(residuals, 14.0)
    ratio = noise.density(2, PROBES) / truth(pole)[:, None]
    assert np.all(np.abs(np.log(ratio)) < np.log(factor))


def test_tones_in_the_silent_band_are_not_noise():
    residuals = coloured(np.random.default_rng(3), 0.0)
    times = np.arange(SAMPLES) / RATE
    residuals += 3 * np.sin(2 * np.pi * 50 * times)[:, None]
    ratio = estimated(residuals, 20.0).density(0, PROBES) / truth(0.0)[:, None]
    assert np.all(np.abs(ratio - 1) < 0.1)


def test_what_rises_above_the_structure_tells_of_no_quiet_among_its_answers():
    # Harmonics of a strong spring, sampled as they are: they grow towards half the rate.
    rng = np.random.default_rng(8)
    residuals = coloured(rng, 0.0)
    b, a = sps.butter(2, 60.0, "high", fs=RATE)
    residuals = residuals + 30 * sps.lfilter(b, a, rng.standard_normal(residuals.shape), axis=1)
    for frequency in (3.0, 8.0, 15.0):
        b, a = sps.iirpeak(frequency, 8, fs=RATE)
        residuals += 30 * sps.lfilter(b, a, rng.standard_normal(residuals.shape), axis=1)
    low = estimated(residuals, 20.0).density(0, PROBES[:1]) / truth(0.0)[0]
    assert np.all(low > 0.3)
    assert np.all(low < 10.0)


def test_linear_misfit_to_an_input_is_not_noise():
    rng = np.random.default_rng(4)
    inputs, noise = rng.standard_normal((SAMPLES, 1)), rng.standard_normal((SAMPLES, 1))
    late = np.concatenate([np.zeros((2, 1)), inputs[:-2]])
    _, power, spare = incoherent_power(
        noise + 5 * late, inputs, RATE, np.ones((SAMPLES, 1), dtype=bool)
    )
    assert np.mean(power) == pytest.approx(2 / RATE, rel=0.05)
    assert spare == 1 - 4 / 24


HOLES = {
    "first": lambda at: at < 0.07 * SAMPLES,
    "few": lambda at: at < 60,
    "scattered": lambda at: (at * 7919) % 101 < 7,
    "crossings": lambda at: np.abs(np.sin(at / 9)) < 0.1,
    "gap": lambda at: np.abs(at - SAMPLES // 2) > 100,
}


@pytest.mark.parametrize("name", HOLES)
def test_noise_is_as_loud_whichever_samples_are_left_of_it(name):
    """Lines of a few moments go together, and a smooth curve takes nearly all of them."""
    used = HOLES[name](np.arange(SAMPLES))[:, None]
    loud = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        inputs, noise = rng.standard_normal((SAMPLES, 1)), rng.standard_normal((SAMPLES, 1))
        _, power, spare = incoherent_power(np.where(used, noise, 0.0), inputs, RATE, used)
        loud.append(power.mean() / used.mean())
        assert 0 < spare[0] <= 1
    assert np.mean(loud) == pytest.approx(2 / RATE, rel=0.1)


def test_masked_samples_do_not_lower_the_floor():
    residuals = coloured(np.random.default_rng(5), 0.0)
    residuals[:, :1500] = 0.0
    use = np.arange(SAMPLES)[:, None] >= np.array([1500, 1500])
    trials = tuple(
        Trial(inputs=np.zeros((SAMPLES, 0)), outputs=r, rate_hz=RATE, use=use)
        for r in residuals
    )
    noise = estimate_noise(trials, tuple(residuals), silent_above_hz=20.0)
    assert noise.density(0, PROBES) / truth(0.0)[:, None] == pytest.approx(1, rel=0.08)


def test_the_integral_of_a_density_is_the_variance():
    assert white_noise([[0.02, 0.08]]).sd(0, 100.0) == pytest.approx([1.0, 2.0])
    colour = Colour(white=0.0, coloured=1.0, corner_hz=1.0, slope=2.0)
    grid = np.linspace(0, 100, 100001)
    assert np.trapezoid(colour.density(grid), grid) == pytest.approx(np.arctan(100.0), rel=1e-4)


def test_a_density_must_be_positive():
    with pytest.raises(ValueError, match="must be positive"):
        white_noise([[0.0]])


def test_a_structure_is_silent_well_above_its_highest_mode():
    spring = Spring(id="j", between=("base", "m"), stiffness_n_per_m=(2 * np.pi * 5) ** 2)
    one = Description(name="one", nodes=(Node(id="m", mass_kg=1.0),), elements=(spring,))
    assert response_limit_hz(one) == pytest.approx(8.5)


@pytest.mark.parametrize("inputs", [0, 1])
@pytest.mark.parametrize(("tone_hz", "most"), [(20.0, 34.0), (0.0, 8.5)])
def test_what_nothing_drives_is_silent_above_what_is_heard(inputs, tone_hz, most):
    """As where it was let go, in pieces of too few periods for a mode to tell itself."""
    spring = Spring(id="j", between=("base", "m"), stiffness_n_per_m=(2 * np.pi * 5) ** 2)
    one = Description(name="one", nodes=(Node(id="m", mass_kg=1.0),), elements=(spring,))
    tone = np.sin(2 * np.pi * tone_hz * np.arange(100) / 200.0)[:, None]
    trial = Trial(inputs=np.zeros((100, inputs)), outputs=tone, rate_hz=200.0)
    assert response_limit_hz(one, (trial,)) == pytest.approx(most, rel=0.1)


def _blocks(rng):
    suspect = np.where(rng.random(80) < 0.5, 0.5, 0.01)
    power = rng.gamma(8.0, 1 / 8.0, 80) * np.where(rng.random(80) < 0.1, 30.0, 1.0)
    lines = rng.integers(4, 30, 80).astype(float)
    odds = np.log1p(-suspect), np.log(suspect)
    return np.stack([np.linspace(0.5, 49.0, 80), power, lines, *odds])


@pytest.mark.parametrize(
    ("family", "at"),
    [
        (climb.POWER_LAW, [-1.0, 0.3, 2.0, 1.4]),
        (climb.POWER_LAW, [-1.0, 0.3, 1.0, -1.7]),
        (climb.POLE_PAIR, [-1.0, 0.5, 1.2, 0.7]),
    ],
)
def test_slopes_of_the_likelihood_of_a_colour_are_those_of_differences(family, at):
    blocks, at, found = _blocks(np.random.default_rng(3)), np.array(at), np.zeros((4, 6))

    def likelihood(numbers):
        return climb._likelihood_and_information(blocks, numbers, family, 100.0, found)

    likelihood(at)
    slopes = found[:, 4].copy()
    for k in range(4):
        step = 1e-6 * np.eye(4)[k]
        ahead, behind = (likelihood(at + sign * step) for sign in (1, -1))
        assert slopes[k] == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize(
    ("family", "truth", "start"),
    [
        (climb.POWER_LAW, [-1.0, 2.3, 2.0, 1.4], [-1.0, 0.0, 1.6, 2.0]),
        (climb.POLE_PAIR, [-1.0, 0.5, 1.2, 0.7], [-1.0, 0.0, 2.0, 0.3]),
    ],
)
def test_a_climb_ends_at_the_top(family, truth, start):
    blocks, found = _blocks(np.random.default_rng(3)), np.zeros((4, 6))
    colour = estimate._colour_at(np.array(truth), family, 100.0)
    blocks[1] *= colour.density(blocks[0])
    low, high = np.array([-14.0, -14.0, -2.0, -4.0]), np.array([6.0, 14.0, 6.0, 4.0])
    top = climb.maximise_likelihood(blocks, np.array(start), low, high, family, 100.0)
    likelihood = climb._likelihood_and_information(blocks, top, family, 100.0, found)
    for k in range(4):
        for sign in (-0.05, 0.05):
            beside = top + sign * np.eye(4)[k]
            higher = (
                climb._likelihood_and_information(blocks, beside, family, 100.0, found)
                - likelihood
            )
            assert higher < 10 * climb.MIN_GAIN
    assert (
        climb._likelihood_and_information(blocks, np.array(truth), family, 100.0, found)
        < likelihood
    )


def test_each_record_has_a_colour_of_its_own_where_one_for_all_does_not_pass():
    rng = np.random.default_rng(6)
    poles = (0.0, 0.9, 0.6)
    residuals = [coloured(rng, pole, trials=1)[0] for pole in poles]
    noise = estimated(residuals, 0.0)
    for trial, pole in enumerate(poles):
        ratio = noise.density(trial, PROBES) / truth(pole)[:, None]
        assert np.all(np.abs(np.log(ratio)) < 0.35)


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_records_of_one_colour_share_it(pole):
    noise = estimated(coloured(np.random.default_rng(8), pole), 0.0)
    density = [noise.density(trial, PROBES) for trial in range(3)]
    for other in density[1:]:
        ratio = other / density[0]
        assert np.allclose(ratio, ratio[:1])


def test_some_trials_have_their_own_noise_as_often_as_they_are_named():
    noise = white_noise([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    some = noise.for_trials([2, 0, 2])
    assert [[c.white for c in trial] for trial in some.colours] == [
        [c.white for c in noise.colours[i]] for i in (2, 0, 2)
    ]
    assert some.relative_sd == tuple(noise.relative_sd[i] for i in (2, 0, 2))


def swinging(seconds=9.1, rate=29.6):
    """Swings of a pendulum from 80°, and what the best linear oscillator leaves of them."""
    t = np.arange(int(seconds * rate)) / rate

    def pulled(_, x):
        return [x[1], -14.6 * np.sin(x[0]) - 0.06 * x[1]]

    angle = solve_ivp(pulled, (0, t[-1]), [1.4, 0.3], t_eval=t, rtol=1e-8, atol=1e-9).y[0]
    angle = angle + 0.008 * np.random.default_rng(3).standard_normal(len(t))

    def left(constants):
        omega, decay = constants
        fall = np.exp(-decay * t)
        basis = np.stack([fall * np.cos(omega * t), fall * np.sin(omega * t)], axis=1)
        return angle - basis @ np.linalg.lstsq(basis, angle, rcond=None)[0]

    fitted = scipy.optimize.least_squares(left, [3.5, 0.03])
    trial = Trial(inputs=np.zeros((len(t), 0)), outputs=angle[:, None], rate_hz=rate)
    return trial, left(fitted.x)[:, None]


def test_what_a_free_decay_leaves_at_its_own_resonance_is_motion_and_no_noise():
    trial, residual = swinging()
    assert residual.std() > 5 * 0.008
    noise = estimate_noise((trial,), (residual,), silent_above_hz=1.0, lacking=True)
    assert noise.sd(0, trial.rate_hz)[0] < 3 * 0.008
    # Of a structure that may be driven, the same residual can be its noise.
    driven = Trial(
        inputs=np.ones((len(residual), 1)), outputs=trial.outputs, rate_hz=trial.rate_hz
    )
    heard = estimate_noise((driven,), (residual,), silent_above_hz=1.0, lacking=True)
    assert heard.sd(0, trial.rate_hz)[0] > 5 * 0.008

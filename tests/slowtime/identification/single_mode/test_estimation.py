import numpy as np
import pytest
from scipy.signal import lfilter

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration, simulate
from slowtime.identification import all_modes, first_mode

SLOW = pytest.mark.slow
RATE = 500.0


def colours(kind, noise):
    filters = {
        "white": ([1.0], [1.0]),
        "red": ([1.0], [1.0, -0.98]),
        "blue": ([1.0, -0.95], [1.0]),
        "pink": (
            [0.049922035, -0.095993537, 0.050612699, -0.004408786],
            [1.0, -2.494956002, 2.017265875, -0.522189400],
        ),
    }
    return lfilter(*filters[kind], noise, axis=0)[500:]


def false_alarms(kind, runs, count, channels, rate):
    rng = np.random.default_rng(1)
    claimed = 0
    for _ in range(runs):
        record = colours(kind, rng.standard_normal((count + 500, channels)))
        claimed += first_mode(record, rate) is not None
    return claimed


@pytest.mark.parametrize("kind", ["white", "red", "blue", "pink"])
def test_noise_has_no_mode(kind):
    assert false_alarms(kind, 60, 1000, 2, 100.0) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("count", [500, 5000, 30_000])
@pytest.mark.parametrize("kind", ["white", "red", "blue", "pink"])
def test_false_alarms_stay_under_half_a_percent(kind, count):
    assert false_alarms(kind, 600, count, 1, 1000.0) <= 3


def struck(rng, f, z, at, count):
    """A blow at sample `at`, and the decay after it."""
    force = np.zeros(count)
    force[at : at + 2] = 1.0
    acceleration = simulate(Oscillator.from_modal(f, z), force, RATE)[2]
    return acceleration / np.abs(acceleration).max() + 1e-3 * rng.standard_normal(count)


@pytest.mark.long
@pytest.mark.parametrize("at", [0, 100, 200])
def test_a_blow_anywhere_in_the_first_half_is_read_from_where_it_rings(at):
    rng = np.random.default_rng(2)
    for _ in range(10):
        found = first_mode(struck(rng, 30.0, 0.01, at, 500), RATE)
        assert found is not None
        assert found.method == "free_decay"
        assert abs(found.frequency_hz.value - 30.0) < 5 * found.frequency_hz.sd
        assert found.frequency_hz.sd < 0.1


@pytest.mark.long
@pytest.mark.parametrize(
    ("f", "z", "at", "snr"), [(26.0, 0.009, 100, 1e4), (30.0, 0.003, 0, 300.0)]
)
def test_the_stretch_that_was_chosen_for_its_small_error_does_not_understate_it(f, z, at, snr):
    rng = np.random.default_rng(11)
    scores = []
    for _ in range(40):
        noise = rng.standard_normal(500) / np.sqrt(2 * snr)
        found = first_mode(struck(rng, f, z, at, 500) + noise, RATE)
        assert found is not None
        frequency, damping = found.frequency_hz, found.damping_ratio
        scores.append([(frequency.value - f) / frequency.sd, (damping.value - z) / damping.sd])
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert np.all((spread > 0.7) & (spread < 1.3))


@pytest.mark.long
def test_a_steady_response_is_read_as_ambient():
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(12):
        record = ambient_acceleration(Oscillator.from_modal(12.0, 0.02), 7500, RATE, rng)
        record = record + 2.0 * rng.standard_normal(len(record))
        found = first_mode(record, RATE)
        assert found is not None
        assert found.method == "ambient"
        scores.append((found.frequency_hz.value - 12.0) / found.frequency_hz.sd)
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.5


@pytest.mark.long
def test_a_stronger_second_mode_is_not_taken_for_the_first():
    rng = np.random.default_rng(4)
    for _ in range(10):
        record = struck(rng, 30.0, 0.005, 20, 500) + 10 * struck(rng, 187.0, 0.005, 20, 500)
        found = first_mode(record, RATE)
        assert found is not None
        assert found.frequency_hz.value == pytest.approx(30.0, abs=0.3)
        modes = all_modes(record, RATE)
        near = [mode.frequency_hz.value for mode in modes]
        assert near == pytest.approx([30.0, 187.0], abs=0.5)


def test_the_weak_companion_of_a_close_stronger_mode_is_not_the_first():
    rng = np.random.default_rng(5)
    record = struck(rng, 28.2, 0.004, 0, 500) + 0.2 * struck(rng, 24.6, 0.004, 0, 500)
    found = first_mode(record, RATE)
    assert found is not None
    assert found.frequency_hz.value == pytest.approx(28.2, abs=0.1)


def test_a_frequency_that_moves_within_the_record_widens_its_error():
    rng = np.random.default_rng(6)
    times = np.arange(1000) / RATE
    chirp = np.exp(-0.5 * times) * np.cos(2 * np.pi * (30.0 * times + 0.75 * times**2))
    found = first_mode(chirp + 1e-3 * rng.standard_normal(1000), RATE)
    assert found is not None
    assert found.frequency_hz.sd > 0.1
    assert 30.0 < found.frequency_hz.value < 33.0
    assert "changes_within_record" in found.flags


def test_mains_hum_is_not_a_mode_and_a_mode_at_its_frequency_is():
    rng = np.random.default_rng(7)
    times = np.arange(5000) / RATE
    hum = np.sin(2 * np.pi * 50.0 * times) + 0.05 * rng.standard_normal(5000)
    assert first_mode(hum, RATE) is None
    beside = hum + struck(rng, 80.0, 0.01, 0, 5000)
    found = first_mode(beside, RATE)
    assert found is None or found.frequency_hz.value == pytest.approx(80.0, abs=0.5)
    real = first_mode(struck(rng, 50.0, 0.01, 0, 1000), RATE)
    assert real is not None
    assert real.frequency_hz.value == pytest.approx(50.0, abs=0.05)


def test_a_burst_at_the_end_is_left_unclear_rather_than_given_to_a_higher_mode():
    rng = np.random.default_rng(8)
    record = 1e-3 * rng.standard_normal(500)
    record[460:] += lfilter([1.0], [1.0, -1.2, 0.9], rng.standard_normal(40))
    assert first_mode(record, RATE) is None


def test_the_expected_frequency_decides_between_candidates_but_does_not_hold_them():
    rng = np.random.default_rng(9)
    record = struck(rng, 30.0, 0.005, 0, 500) + struck(rng, 90.0, 0.005, 0, 500)
    for expected, truth in (((88.0, 3.0), 90.0), ((31.0, 2.0), 30.0), ((200.0, 2.0), 30.0)):
        found = first_mode(record, RATE, expected_hz=expected)
        assert found is not None
        assert found.frequency_hz.value == pytest.approx(truth, abs=0.2)
    with pytest.raises(ValueError, match="Give two positive numbers in Hz"):
        first_mode(record, RATE, expected_hz=(30.0, 0.0))


@pytest.mark.parametrize("method", ["auto", "ambient", "free_decay", "peak"])
def test_every_method_answers_alike_and_changes_nothing(method):
    record = struck(np.random.default_rng(10), 30.0, 0.02, 0, 1000)[:, None] * [1.0, -0.4]
    before = record.copy()
    one, other = (first_mode(record, RATE, method=method) for _ in range(2))
    assert one == other
    assert one is not None
    assert one.frequency_hz.value == pytest.approx(30.0, rel=0.03)
    np.testing.assert_array_equal(record, before)


@pytest.mark.long
@pytest.mark.parametrize(
    ("epochs", "low", "high"), [(100, 0.9, 0.99), pytest.param(400, 0.92, 0.98, marks=SLOW)]
)
def test_of_many_epochs_none_is_lost_and_none_is_a_bump_on_the_skirt(epochs, low, high):
    rng = np.random.default_rng(2)
    off = []
    for _ in range(epochs):
        record = ambient_acceleration(Oscillator.from_modal(4.0, 0.015), 3000, 50.0, rng)
        record += 0.1 * np.std(record) * rng.standard_normal(len(record))
        found = first_mode(record, 50.0, method="ambient")
        assert found is not None
        off.append((found.frequency_hz.value - 4.0) / found.frequency_hz.sd)
    assert np.abs(off).max() < 5.0
    assert low < np.mean(np.abs(off) < 1.96) < high

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.harmonics.detection import classify_peaks, find_harmonics
from slowtime.identification.harmonics.narrowband import (
    draw_envelopes,
    fourier_spectra,
    narrow_band,
    residual_share,
    steadiness,
)

RATE = 50.0


def mode(rng, f, z, seconds, snr=1e3):
    """Unit peak density over a floor 1 / snr."""
    oscillator = Oscillator.from_modal(f, z)
    count = round(seconds * RATE)
    ringing = ambient_acceleration(oscillator, count, RATE, rng, force_psd=4 * z * z)
    return ringing + rng.standard_normal(count) * np.sqrt(RATE / 2 / snr)


def tone(rng, f, seconds, *, wander=0.0, swell=0.0):
    """Unit rms; the frequency wanders relatively by a process of 10 s memory."""
    count = round(seconds * RATE)
    keep = np.exp(-0.1 / RATE)
    drift = sps.lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.standard_normal(count))
    phase = 2 * np.pi * f * np.cumsum(1 + wander * drift) / RATE + rng.uniform(0, 6)
    slow = np.sin(2 * np.pi * 1.7 * np.arange(count) / count + rng.uniform(0, 6))
    return np.sqrt(2) * (1 + swell * slow) * np.sin(phase)


def kind(record, f, **settings):
    return classify_peaks(record, RATE, np.array([f]), **settings)[0].kind


@pytest.mark.long
@pytest.mark.parametrize(("f", "z", "seconds"), [(8.0, 0.002, 120.0), (3.0, 0.0005, 400.0)])
def test_drawn_envelopes_are_scattered_like_those_of_simulated_records(f, z, seconds):
    rng = np.random.default_rng(1)
    width = z * f * seconds
    shares, moments = [], []
    for _ in range(150):
        spectra = fourier_spectra(mode(rng, f, z, seconds, snr=1e6)[:, None], RATE)
        centre = round(f * seconds)
        seen = narrow_band(spectra, centre, 8).envelope[None]
        shares.append(residual_share(seen)[0])
        moments.append(steadiness(seen)[0])
    drawn = draw_envelopes(width, 1e4, 17, 4000, rng)
    for found, law in ((shares, residual_share(drawn)), (moments, steadiness(drawn))):
        quantiles = np.quantile(law, [0.1, 0.5, 0.9])
        below = np.mean(np.array(found)[:, None] < quantiles, axis=0)
        # A share of 150 scatters by 0.025 to 0.04.
        np.testing.assert_allclose(below, [0.1, 0.5, 0.9], atol=0.11)


def test_a_mode_just_as_lightly_damped_as_allowed_is_rare_as_often_as_stated():
    rng = np.random.default_rng(2)
    p = [
        classify_peaks(mode(rng, 8.0, 5e-4, 300.0), RATE, np.array([8.0]))[0].p_structural
        for _ in range(40)
    ]
    assert np.mean(np.array(p) < 0.1) < 0.25
    assert np.min(p) > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("z", [5e-4, 2e-3, 1e-2])
@pytest.mark.parametrize(("f", "seconds"), [(1.3, 240.0), (8.0, 100.0), (8.0, 1000.0)])
def test_the_false_alarm_rate_holds_over_hundreds_of_modes(f, z, seconds):
    rng = np.random.default_rng(3)
    p = np.array(
        [
            classify_peaks(mode(rng, f, z, seconds), RATE, np.array([f]))[0].p_structural
            for _ in range(300)
        ]
    )
    assert np.mean(p < 0.1) < 0.16
    assert np.mean(p < 0.01) < 0.03
    assert np.mean(p < 1e-3) < 0.01


@pytest.mark.parametrize(("f", "seconds"), [(1.3, 240.0), (8.0, 60.0), (12.0, 600.0)])
def test_a_lightly_damped_mode_is_no_harmonic(f, seconds):
    rng = np.random.default_rng(4)
    assert {kind(mode(rng, f, 0.002, seconds), f) for _ in range(15)} == {"structural"}


@pytest.mark.long
@pytest.mark.parametrize(
    "line", [{}, {"swell": 0.3}, {"wander": 1e-3}, {"wander": 5e-3}], ids=str
)
@pytest.mark.parametrize("seconds", [300.0, 1000.0])
def test_a_line_is_one_whether_steady_swelling_or_wandering(line, seconds):
    rng = np.random.default_rng(5)
    for _ in range(4 if seconds < 500 else 2):
        noise = rng.standard_normal(round(seconds * RATE))
        found = classify_peaks(tone(rng, 8.1, seconds, **line) + noise, RATE, np.array([8.1]))[
            0
        ]
        assert found.kind == "harmonic"
        assert found.amplitude == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("beside", [0.01, 0.03, 0.1])
def test_a_line_as_loud_as_the_mode_it_sits_beside_is_told_from_it(beside):
    rng = np.random.default_rng(6)
    ringing = mode(rng, 8.0, 0.01, 300.0)
    record = ringing / ringing.std() + tone(rng, 8.0 * (1 + beside), 300.0)
    line, own = classify_peaks(record, RATE, np.array([8.0 * (1 + beside), 7.96]))
    assert (line.kind, own.kind) == ("harmonic", "structural")


@pytest.mark.long
def test_the_frequency_of_a_tone_is_as_good_as_it_says():
    rng = np.random.default_rng(7)
    scores = []
    for _ in range(40):
        f = rng.uniform(5, 15)
        record = 0.5 * tone(rng, f, 200.0) + rng.standard_normal(10_000)
        found = classify_peaks(record, RATE, np.array([f]))[0].frequency_hz
        scores.append((found.value - f) / found.sd)
    # Of 40 scores the rms scatters by 11 %.
    assert 0.67 < np.sqrt(np.mean(np.square(scores))) < 1.33


def test_too_short_a_record_says_that_it_cannot_tell():
    rng = np.random.default_rng(8)
    record = tone(rng, 2.0, 60.0, swell=0.2) + 0.1 * rng.standard_normal(3000)
    found = classify_peaks(record, RATE, np.array([2.0]))[0]
    assert (found.kind, found.decidable) == ("structural", False)
    assert (
        classify_peaks(record, RATE, np.array([2.0]), least_damping=0.005)[0].kind == "harmonic"
    )


def test_at_a_known_speed_less_evidence_is_asked_for_but_a_mode_stays_one():
    rng = np.random.default_rng(9)
    found = [0, 0, 0]
    for _ in range(12):
        faint = 0.09 * tone(rng, 12.0, 200.0) + rng.standard_normal(10_000)
        found[0] += kind(faint, 12.0) == "harmonic"
        found[1] += kind(faint, 12.0, known_hz=(6.0,)) == "harmonic"
        found[2] += kind(mode(rng, 12.0, 0.005, 200.0), 12.0, known_hz=(6.0,)) == "harmonic"
    assert found[1] > found[0]
    assert found[2] <= 1


@pytest.mark.parametrize("gain", [1e-12, 1e9])
def test_units_of_channels_do_not_matter_and_their_deflections_are_found(gain):
    rng = np.random.default_rng(10)
    line, noise = tone(rng, 8.1, 300.0), 0.1 * rng.standard_normal((15_000, 2))
    still = np.full(15_000, 7.0)
    record = np.stack([line + noise[:, 0], still, -gain * (0.5 * line + noise[:, 1])], axis=1)
    found = classify_peaks(record, RATE, np.array([8.1]))[0]
    ratio = found.shape[2] / found.shape[0]
    assert found.kind == "harmonic"
    assert found.shape[1] == 0
    assert ratio == pytest.approx(-0.5 * gain, rel=0.02)


def test_a_fan_and_its_multiples_are_found_among_the_modes_of_a_structure():
    rng = np.random.default_rng(11)
    record = sum(10 * mode(rng, f, 0.004, 600.0) for f in (3.1, 7.9, 15.2))
    speed = 4.87
    for order, level in ((1, 1.0), (2, 0.7), (4, 0.5)):
        record = record + 3 * level * tone(rng, order * speed, 600.0)
    lines, speeds = find_harmonics(record, RATE)
    found = np.array([line.frequency_hz.value for line in lines])
    np.testing.assert_allclose(found, speed * np.array([1, 2, 4]), atol=1e-3)
    assert speeds[0].orders == (1, 2, 4)
    assert speeds[0].base_hz.value == pytest.approx(speed, abs=1e-3)


@pytest.mark.parametrize("modes", [(), (2.0, 2.1, 9.0)])
def test_structures_and_noise_have_no_harmonics(modes):
    rng = np.random.default_rng(12)
    for _ in range(6):
        record = rng.standard_normal(15_000)
        for f in modes:
            record = record + 10 * mode(rng, f, 0.002, 300.0)
        assert find_harmonics(record, RATE) == ((), ())


@pytest.mark.long
def test_the_highest_peaks_of_long_noise_in_many_channels_are_no_lines():
    rng = np.random.default_rng(15)
    for _ in range(4):
        assert find_harmonics(rng.standard_normal((60_000, 4)), RATE) == ((), ())


def test_the_record_stays_as_it_was_and_the_answer_the_same():
    record = tone(np.random.default_rng(13), 8.0, 100.0)[:, None]
    kept = record.copy()
    first, second = (classify_peaks(record, RATE, np.array([8.0]))[0] for _ in range(2))
    np.testing.assert_array_equal(record, kept)
    assert first.p_structural == second.p_structural


def test_senseless_settings_say_what_to_give():
    record = np.random.default_rng(14).standard_normal(5000)
    with pytest.raises(ValueError, match=r"least damping ratio that a mode.*not a percentage"):
        classify_peaks(record, RATE, np.array([8.0]), least_damping=0.5)
    with pytest.raises(ValueError, match="that you can bear"):
        classify_peaks(record, RATE, np.array([8.0]), false_alarm=0.5)
    with pytest.raises(ValueError, match=r"A peak at 30 Hz was given\. Allowed"):
        classify_peaks(record, RATE, np.array([30.0]))


@pytest.mark.data
@pytest.mark.parametrize("number", [1, 2])
def test_no_mode_of_a_real_steel_frame_is_taken_for_a_machine(data, number):
    record = np.load(data / "steel_frame" / f"measurement_{number}.npy").astype(float)
    published = np.array(
        [1.2283, 1.4358, 2.1, 4.0175, 4.7704, 6.6824, 7.6157, 9.6653, 12.1663, 12.5979]
    )
    verdicts = classify_peaks(record, 256.0, published)
    assert {verdict.kind for verdict in verdicts} == {"structural"}
    lines, _ = find_harmonics(record, 256.0, band_hz=(0.5, 16.0))
    assert lines == ()

"""Work that is left out changes nothing, and windows do not depend on those before."""

import numpy as np
import pytest

from slowtime.identification import Tracker, first_mode
from slowtime.identification.ambient import estimation as ambient
from slowtime.identification.ambient.damping_posterior import damping_posterior
from slowtime.identification.free_decay import segments
from slowtime.identification.free_decay.estimation import fit_spanned
from tests.slowtime.identification.oscillators import record

RATE = 24.0


def window(seed, *, f=4.0, z=0.02, after=None, seconds=30.0):
    """Response of one mode, whose frequency jumps in the middle where `after` is given."""
    rng = np.random.default_rng(seed)
    case = {"z": z, "rate": RATE, "seconds": seconds, "noise": 0.05}
    before = record(rng, f=f, **case)
    middle = len(before) // 2
    return np.concatenate([before[:middle], record(rng, f=after or f, **case)[middle:]])


@pytest.fixture
def posteriors(monkeypatch):
    """Posteriors of the damping that were worked out."""
    calls = []
    complete = damping_posterior

    def counted(*given):
        calls.append(given)
        return complete(*given)

    monkeypatch.setattr(ambient, "damping_posterior", counted)
    return calls


def test_the_posteriors_of_halves_are_left_out_where_they_would_add_nothing(
    posteriors, monkeypatch
):
    samples = window(1)
    lean = first_mode(samples, RATE)
    assert len(posteriors) == 1
    monkeypatch.setattr(ambient, "may_change", lambda *_: True)
    assert first_mode(samples, RATE) == lean
    assert len(posteriors) == 4


def test_a_frequency_that_jumps_within_the_window_still_widens_its_error(posteriors):
    found = first_mode(window(2, after=4.2, seconds=90.0), RATE)
    assert found is not None
    assert "changes_within_record" in found.flags
    assert len(posteriors) == 3


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_fits_to_what_is_no_decay_are_left_out_and_would_have_changed_nothing(
    seed, monkeypatch
):
    samples, fits = window(seed, z=0.03), []
    complete = fit_spanned

    def counted(*given):
        fits.append(given)
        return complete(*given)

    monkeypatch.setattr(segments, "fit_spanned", counted)
    monkeypatch.setattr("slowtime.identification.single_mode.estimation.is_random", _never)
    lean = first_mode(samples, RATE)
    assert lean is not None
    assert not fits
    monkeypatch.setattr(segments, "ADDED_BY_FIT", np.inf)
    assert first_mode(samples, RATE) == lean
    assert len(fits) == segments.FINALISTS


def _never(*_):
    return False


def test_a_window_after_others_is_read_as_from_a_cold_start():
    """Frequencies jump from window to window by more than their bandwidth, up and down."""
    tracker = Tracker(rate_hz=RATE)
    state = tracker.start()
    for seed, hertz in enumerate((4.0, 4.7, 3.1, 4.0)):
        samples = window(10 + seed, f=hertz)
        state, warm = tracker.step(state, samples)
        assert warm == first_mode(samples, RATE)
        assert warm is not None

import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.detection import classify_peaks
from slowtime.identification.harmonics.tones import remove_lines

RATE, COUNT = 50.0, 20_000
SECONDS = np.arange(COUNT) / RATE


@pytest.mark.parametrize("lines", [(8.1234,), (8.1234, 8.1301, 15.7)])
def test_what_is_left_is_the_record_as_it_would_be_without_the_machine(lines):
    rng = np.random.default_rng(1)
    quiet = ambient_acceleration(Oscillator.from_modal(9.0, 0.01), COUNT, RATE, rng)
    loud = sum(30 * quiet.std() * np.cos(2 * np.pi * f * SECONDS + f) for f in lines)
    found = tuple(
        v.frequency_hz for v in classify_peaks(quiet + loud, RATE, np.array(lines[-1:]))
    )
    given = tuple(Measured(f, 0.0) for f in lines[:-1]) + found
    left = remove_lines((quiet + loud)[:, None], RATE, given)[:, 0]
    assert np.std(left - quiet) < 0.03 * np.std(quiet)


def test_a_line_that_wanders_takes_its_band_with_it():
    rng = np.random.default_rng(2)
    phase = 2 * np.pi * 8.0 * SECONDS + np.cumsum(0.05 * rng.standard_normal(COUNT))
    record = np.sin(phase)[:, None]
    left = remove_lines(record, RATE, (Measured(8.0, 0.05),))
    assert np.std(left) < 0.4 * np.std(record)
    assert np.std(left) < 0.5 * np.std(remove_lines(record, RATE, (Measured(8.0, 0.0),)))


def test_the_record_given_is_not_touched():
    record = np.sin(2 * np.pi * 3.0 * SECONDS)[:, None]
    kept = record.copy()
    remove_lines(record, RATE, (Measured(3.0, 0.0),))
    np.testing.assert_array_equal(record, kept)

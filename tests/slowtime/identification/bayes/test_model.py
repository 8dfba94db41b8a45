"""Predicted cross-periodograms against Fejér's kernel, and bands that leave nothing out."""

import numpy as np
import pytest

from slowtime.identification.bayes.band import Band, band_from
from slowtime.identification.bayes.band_layout import group_modes
from slowtime.identification.bayes.initial_estimates import InitialEstimate
from slowtime.identification.bayes.resonances import cross_periodograms


def transfer(hz, natural_hz, damping, derivatives):
    s, omega = 2j * np.pi * hz, 2 * np.pi * natural_hz
    below = s**2 + 2 * damping * omega * s + omega**2
    return 2 * damping * (s / omega) ** derivatives * omega**2 / below


@pytest.mark.long
@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_cross_periodograms_are_spectra_smoothed_by_the_length_of_the_record(derivatives):
    duration, natural, damping = 60.0, (3.0, 3.04), (0.004, 0.008)
    places = np.arange(170, 192) / duration
    empty = np.zeros((len(places), 1, 1), dtype=complex)
    band = Band(places, empty, np.ones(len(places)), duration, derivatives)
    found = cross_periodograms(band, np.log(natural), np.log(damping))
    fine = np.linspace(-30.0, 30.0, 1_200_001)
    fine = fine[np.abs(fine) > 1e-9]
    curves = [transfer(fine, f, z, derivatives) for f, z in zip(natural, damping, strict=True)]
    step = 60.0 / 1_200_000
    for k, place in enumerate(places):
        kernel = duration * np.sinc((fine - place) * duration) ** 2
        for i in (0, 1):
            for j in (0, 1):
                expected = np.sum(curves[i] * curves[j].conj() * kernel) * step
                # What leaks from the other half-axis is left out of the prediction.
                assert abs(found[k, i, j] - expected) < 2e-3


def test_bins_taken_together_keep_power_and_number():
    rng = np.random.default_rng(1)
    frequency = np.arange(100, 900) / 100.0
    columns = rng.standard_normal((800, 2)) + 1j * rng.standard_normal((800, 2))
    band = band_from(frequency, columns, 100.0, 2, np.array([3.0, 7.0]))
    assert band.number.sum() == 800
    assert len(band.number) < 400
    np.testing.assert_allclose(band.scatter.sum(axis=0), columns.T @ columns.conj())
    np.testing.assert_allclose(band.number @ band.frequency_hz, frequency.sum())
    near = np.abs(band.frequency_hz - 3.0) < 0.1
    assert (band.number[near] == 1).all()


def chain_of(frequencies):
    return tuple(InitialEstimate(f, 0.01, np.ones(2)) for f in frequencies)


def test_modes_are_grouped_by_their_widths_and_parted_at_the_widest_gap():
    apart = chain_of([1.0, 1.05, 2.0, 2.02, 2.04])
    assert group_modes(apart, 1e4) == [(0, 1), (2, 3, 4)]
    assert group_modes(apart, 1e4, coherent=True) == [(0, 1, 2, 3, 4)]
    crowd = chain_of([1.0, 1.02, 1.04, 1.06, 1.15, 1.17, 1.19, 1.21, 1.23])
    assert group_modes(crowd, 1e4) == [(0, 1, 2, 3), (4, 5, 6, 7, 8)]
    assert group_modes((), 1e4) == []

import csv

import numpy as np
import pytest

from slowtime.identification.single_mode.bounds import (
    ambient_bound,
    ambient_law,
    free_decay_bound,
)


def numbers(table):
    with open(table, newline="") as file:
        for row in csv.DictReader(file):
            yield {key: float(value) for key, value in row.items()}


def relative_free_decay(frequency, damping, duration, rate, snr_db):
    omega = 2 * np.pi * frequency
    bound = free_decay_bound(
        decay_rate=damping * omega, duration_s=duration, rate_hz=rate, snr=10 ** (snr_db / 10)
    )
    return bound / omega


def test_printed_bounds_are_reproduced():
    # f = 10 Hz, 1 %, 1 kHz, 60 s, 20 dB at t = 0; ambient over 60 s.
    assert relative_free_decay(10.0, 0.01, 60.0, 1000.0, 20.0) == pytest.approx(
        7.1e-5, rel=0.01
    )
    assert ambient_law(0.01, 600.0) == pytest.approx((0.00163, 0.163), rel=0.005)


def test_every_row_of_the_reference_table_is_reproduced(tables):
    rows = list(numbers(tables / "T6_crb.csv"))
    for row in rows:
        f, z, duration = row["f_Hz"], row["zeta"], row["T_s"]
        free = relative_free_decay(f, z, duration, row["fs_Hz"], row["SNR0_dB_at_t0"])
        # The table marginalises over the phase between pole and samples; it agrees to O(zeta).
        assert free == pytest.approx(row["free_decay_cov_f"], rel=5e-3)
        assert ambient_law(z, f * duration) == pytest.approx(
            (row["ambient_cov_f_kappa_inf"], row["ambient_cov_zeta_kappa_inf"]), rel=1e-5
        )
        assert ambient_law(z, f * duration, reach=row["kappa"]) == pytest.approx(
            (row["ambient_cov_f_kappa"], row["ambient_cov_zeta_kappa"]), rel=1e-5
        )
    assert len(rows) > 100


def test_the_bound_with_a_floor_tends_to_the_law_without_one():
    floorless = ambient_bound(0.02, 900.0, snr=1e12, reach=5000.0)
    assert floorless == pytest.approx(ambient_law(0.02, 900.0), rel=5e-3)
    costly = ambient_bound(0.02, 900.0, snr=100.0, reach=20.0)
    assert costly[0] == pytest.approx(1.127 * ambient_law(0.02, 900.0, reach=20.0)[0], rel=5e-3)
    assert costly[1] == pytest.approx(1.249 * ambient_law(0.02, 900.0, reach=20.0)[1], rel=5e-3)

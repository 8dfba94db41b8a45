import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.identification.mode_shapes.criteria import (
    auto_mac,
    comac,
    mac,
    mac_matrix,
    mean_phase_deviation,
    mpc,
    mpcs,
    normalised,
    real_shape,
)

SEEDS = st.integers(0, 2**32 - 1)
FACTORS = st.tuples(st.floats(-150, 150), st.floats(-7, 7)).map(
    lambda parts: 10.0 ** parts[0] * np.exp(1j * parts[1])
)


def shape_of(seed, channels=6):
    rng = np.random.default_rng(seed)
    return rng.standard_normal(channels) + 1j * rng.standard_normal(channels)


@given(SEEDS, FACTORS)
def test_no_measure_sees_a_complex_factor(seed, factor):
    one, other = shape_of(seed), shape_of(seed + 1)
    assert mac(factor * one, other) == pytest.approx(mac(one, other), abs=1e-12)
    assert mpc(factor * one) == pytest.approx(mpc(one), abs=1e-12)
    assert mean_phase_deviation(factor * one) == pytest.approx(mean_phase_deviation(one))
    np.testing.assert_allclose(normalised(factor * one), normalised(one), atol=1e-12)
    assert mac(real_shape(factor * one), real_shape(one)) == pytest.approx(1.0)


@given(SEEDS)
def test_mac_is_the_share_that_a_least_squares_fit_explains(seed):
    one, other = shape_of(seed), shape_of(seed + 1)
    _, rest, *_ = np.linalg.lstsq(one[:, None], other, rcond=None)
    assert mac(one, other) == pytest.approx(1 - rest[0] / np.vdot(other, other).real)


@given(SEEDS)
def test_mpc_is_the_gap_between_the_principal_spreads_in_the_complex_plane(seed):
    shape = shape_of(seed)
    plane = np.stack([shape.real, shape.imag])
    least, most = np.linalg.eigvalsh(plane @ plane.T)
    assert mpc(shape) == pytest.approx(((most - least) / (most + least)) ** 2)


@given(SEEDS)
def test_the_phase_deviation_is_measured_from_the_principal_line(seed):
    shape = shape_of(seed)
    _, vectors = np.linalg.eigh(
        np.stack([shape.real, shape.imag]) @ np.stack([shape.real, shape.imag]).T
    )
    along = np.abs(shape.real * vectors[0, -1] + shape.imag * vectors[1, -1])
    angle = np.arccos(np.minimum(along / np.abs(shape), 1.0))
    expected = np.average(angle, weights=np.abs(shape))
    assert mean_phase_deviation(shape) == pytest.approx(expected, abs=1e-7)


@given(SEEDS)
def test_the_real_shape_is_the_real_one_of_greatest_mac(seed):
    shape = shape_of(seed)
    best = mac(real_shape(shape), shape)
    rng = np.random.default_rng(seed)
    rivals = real_shape(shape)[:, None] + 0.1 * rng.standard_normal((len(shape), 50))
    assert mac_matrix(rivals, shape[:, None]).max() <= best + 1e-12


def test_a_real_shape_is_collinear_and_a_travelling_wave_is_not():
    real = np.array([1.0, -2.0, 3.0]) * (1 + 2j)
    wave = np.exp(2j * np.pi * np.arange(8) / 8)
    assert mpc(real) == pytest.approx(1.0)
    assert mean_phase_deviation(real) == pytest.approx(0.0, abs=1e-7)
    assert mpc(wave) == pytest.approx(0.0, abs=1e-12)


def test_the_largest_component_is_real_and_positive_and_the_norm_one():
    found = normalised(shape_of(3))
    largest = found[np.argmax(np.abs(found))]
    assert largest.imag == pytest.approx(0.0, abs=1e-15)
    assert largest.real > 0
    assert np.linalg.norm(found) == pytest.approx(1.0)


def test_columns_are_measured_one_by_one():
    one = np.stack([shape_of(1), shape_of(2)], axis=1)
    other = np.stack([shape_of(3), shape_of(4), shape_of(5)], axis=1)
    for i in range(2):
        assert mpcs(one)[i] == pytest.approx(mpc(one[:, i]))
        for j in range(3):
            assert mac_matrix(one, other)[i, j] == pytest.approx(mac(one[:, i], other[:, j]))


@pytest.mark.parametrize("bad", [np.zeros(3), np.array([1.0, np.nan])])
def test_a_shape_that_no_channel_sees_is_refused(bad):
    with pytest.raises(ValueError, match="leave out modes that no channel sees"):
        mpc(bad)


def test_auto_mac_is_one_on_the_diagonal_and_shows_what_sensors_miss():
    shapes = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.02]])
    found = auto_mac(shapes)
    np.testing.assert_allclose(np.diag(found), 1.0)
    assert found[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert found[0, 2] > 0.99


def test_comac_names_the_channel_that_disagrees():
    rng = np.random.default_rng(1)
    one = rng.standard_normal((5, 4))
    other = one.copy()
    other[3] = rng.standard_normal(4)
    found = comac(one, other)
    assert int(np.argmin(found)) == 3
    np.testing.assert_allclose(comac(one, 2j * one), 1.0)
    with pytest.raises(ValueError, match="same channels and paired modes"):
        comac(one, other[:, :2])

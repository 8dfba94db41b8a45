import dataclasses

import numpy as np
import pytest
import scipy.linalg

from slowtime.dynamics.simulation import ambient_structure
from slowtime.dynamics.structure import Structure
from slowtime.identification.single_mode.bounds import ambient_law
from slowtime.identification.subspace.correlations import Correlations
from slowtime.identification.subspace.ssi import identify_poles, ssi_covariance

POLES = np.array([-0.3 + 7j, -0.2 + 11j, -0.5 + 16j])
SHAPES = np.array([[1.0, 1.0, 1.0], [2.0, -0.5, -1.0], [1.5, 1.2j, 0.7]])


def exact(rng, *, lags=24, draws=3, complex_valued=False):
    """Correlations of a known model, and small errors of them."""
    forces = rng.standard_normal((3, 3)) + 1j * rng.standard_normal((3, 3))
    decay = np.exp(np.arange(lags)[:, None] * POLES / 10.0)
    mean = np.einsum("cm,lm,rm->lcr", SHAPES, decay, forces)
    shape = (draws, lags, 3, 3)
    errors = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    if not complex_valued:
        mean, errors = mean.real, errors.real
    return Correlations(mean, errors, 10.0, 100.0)


def structure(frequencies_hz, damping_ratio):
    """Unit masses in a row with the frequencies given, all modes damped alike."""
    number = len(frequencies_hz)
    stiffness = 2 * np.eye(number) - np.eye(number, k=1) - np.eye(number, k=-1)
    stiffness[-1, -1] = 1.0
    shapes = scipy.linalg.eigh(stiffness)[1]
    omega = 2 * np.pi * np.asarray(frequencies_hz)
    whole = Structure(
        mass=np.eye(number),
        damping=shapes * (2 * damping_ratio * omega) @ shapes.T,
        stiffness=shapes * omega**2 @ shapes.T,
    )
    return whole, shapes


@pytest.mark.parametrize("complex_valued", [False, True])
def test_poles_and_shapes_of_exact_correlations_are_exact(complex_valued):
    given = exact(np.random.default_rng(1), complex_valued=complex_valued)
    order = 3 if complex_valued else 6
    found = identify_poles(given, block_rows=8, orders=[order])
    at = np.argsort(found.pole.imag)
    np.testing.assert_allclose(found.pole[at], POLES, rtol=1e-9)
    for shape, true in zip(found.shape[:, at].T, SHAPES.T, strict=True):
        overlap = np.abs(np.vdot(shape, true)) / np.linalg.norm(true)
        assert overlap == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("weighting", ["none", "past", "both"])
@pytest.mark.parametrize("complex_valued", [False, True])
def test_errors_are_the_derivatives_along_the_draws(complex_valued, weighting):
    given = exact(np.random.default_rng(2), complex_valued=complex_valued)
    if weighting != "none":
        # Whitening needs covariances: lags that decay, and noise that makes them positive.
        mean = given.mean.copy()
        mean[0] = 80.0 * np.eye(3)
        given = dataclasses.replace(given, mean=mean)
    order = 3 if complex_valued else 6
    options = {"block_rows": 8, "orders": [order], "weighting": weighting, "shapes": True}
    found = identify_poles(given, **options)
    step = 1e-5
    for k, error in enumerate(given.draws):
        error = error * (np.arange(len(error)) > 0)[:, None, None]  # of the whitening: none
        there = identify_poles(
            dataclasses.replace(given, mean=given.mean + step * error), **options
        )
        back = identify_poles(
            dataclasses.replace(given, mean=given.mean - step * error), **options
        )
        assert there.shape_draws is not None
        assert found.shape_draws is not None
        for i, pole in enumerate(found.pole):
            one, two = np.argmin(abs(there.pole - pole)), np.argmin(abs(back.pole - pole))
            slope = (there.pole[one] - back.pole[two]) / (2 * step)
            assert found.draws[k, i] == pytest.approx(slope, rel=2e-4)
            shape = found.shape[:, i]
            moved = [s / np.vdot(shape, s) for s in (there.shape[:, one], back.shape[:, two])]
            slopes = (moved[0] - moved[1]) / (2 * step)
            np.testing.assert_allclose(
                found.shape_draws[k, :, i], slopes, atol=3e-4 * np.abs(slopes).max()
            )


@pytest.mark.parametrize(("weighting", "most"), [("none", 1.9), ("past", 1.45)])
def test_errors_of_ambient_records_are_what_is_said_and_near_the_law(weighting, most):
    frequencies, damping = [1.0, 2.8, 4.05], 0.02
    whole, shapes = structure(frequencies, damping)
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(40):
        motion = ambient_structure(whole, 12_000, 12.0, rng)
        noisy = motion + 0.1 * motion.std(axis=0) * rng.standard_normal(motion.shape)
        found = ssi_covariance(noisy, 12.0, block_rows=15, orders=[6], weighting=weighting)
        sd, damping_sd, _ = found.standard_deviations()
        at = np.argsort(found.frequency_hz)
        assert len(at) == 3
        of_frequency = (found.frequency_hz[at] - frequencies) / sd[at]
        of_damping = (found.damping_ratio[at] - damping) / damping_sd[at]
        relative = found.frequency_hz[at] / frequencies - 1
        turned = np.einsum("cm,cm->m", shapes, found.shape[:, at])
        away = found.shape[:, at] / (turned / np.abs(turned)) - shapes
        ratio = np.sum(np.abs(away) ** 2, axis=0) / np.sum(found.shape_sd()[:, at] ** 2, axis=0)
        errors.append([of_frequency, of_damping, relative, ratio])
    of_frequency, of_damping, relative, ratio = np.transpose(errors, (1, 0, 2))
    assert np.mean(np.abs(of_frequency) < 1.96) > 0.88
    assert np.mean(np.abs(of_damping) < 1.96) > 0.88
    assert 0.75 < np.std(of_frequency) < 1.25
    assert 0.4 < np.median(ratio) < 1.6
    law = [ambient_law(damping, f * 1000.0)[0] for f in frequencies]
    # Without whitening a subspace does not make the most of modes that others outshine.
    assert (np.sqrt(np.mean(relative**2, axis=0)) < most * np.array(law)).all()


def test_poles_are_those_of_the_textbook():
    whole, _ = structure([1.0, 2.8, 4.05], 0.02)
    motion = ambient_structure(whole, 4_800, 12.0, np.random.default_rng(8))
    found = ssi_covariance(motion, 12.0, block_rows=8, orders=[6])
    scaled = (motion - motion.mean(axis=0)) / motion.std(axis=0)
    # No sample lies beyond the last of the 96 blocks, so that every pair counts.
    lags = [scaled[k:].T @ scaled[: len(scaled) - k] / (len(scaled) - k) for k in range(16)]
    hankel = np.block([[lags[1 + i + j] for j in range(8)] for i in range(8)])
    u, s, _ = np.linalg.svd(hankel)
    observability = u[:, :6] * np.sqrt(s[:6])
    system = np.linalg.lstsq(observability[:-3], observability[3:])[0]
    poles = np.log(np.linalg.eigvals(system)) * 12.0
    np.testing.assert_allclose(
        np.sort_complex(found.pole), np.sort_complex(poles[poles.imag > 0]), rtol=1e-9
    )


def test_lower_orders_are_part_of_the_same_answer():
    given = exact(np.random.default_rng(4))
    alone = identify_poles(given, block_rows=8, orders=[4])
    among = identify_poles(given, block_rows=8, orders=[2, 4, 6])
    np.testing.assert_allclose(among.pole[among.order == 4], alone.pole, rtol=1e-10)
    np.testing.assert_allclose(among.draws[:, among.order == 4], alone.draws, rtol=1e-7)


def test_shapes_come_in_the_units_of_the_channels():
    whole, _ = structure([1.0, 2.8], 0.02)
    motion = ambient_structure(whole, 12_000, 10.0, np.random.default_rng(5))
    units = np.array([1.0, 1e3])
    plain = ssi_covariance(motion, 10.0, block_rows=10, orders=[4])
    scaled = ssi_covariance(motion * units, 10.0, block_rows=10, orders=[4])
    np.testing.assert_allclose(scaled.pole, plain.pole, rtol=1e-9)
    ratio = np.abs(scaled.shape[1] / scaled.shape[0]) / np.abs(plain.shape[1] / plain.shape[0])
    np.testing.assert_allclose(ratio, 1e3, rtol=1e-6)


def test_too_few_lags_and_dead_channels_are_refused_with_the_cure():
    given = exact(np.random.default_rng(6))
    with pytest.raises(ValueError, match=r"block_rows=20.*need 40 lags, and 24 were given"):
        identify_poles(given, block_rows=20, orders=[2])
    moving = np.random.default_rng(7).standard_normal((500, 2))
    moving[:, 1] = 3.0
    with pytest.raises(ValueError, match=r"Of 2 channels 1 move. Leave the others out"):
        ssi_covariance(moving, 10.0, block_rows=5, orders=[2])

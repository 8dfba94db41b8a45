"""Shapes of many channels: errors of as many components as their standard deviations say."""

import numpy as np
import pytest

from slowtime.identification.spectral_likelihood.mode_selection import (
    FittedMode,
    InitialMode,
    fit_modes,
)
from slowtime.identification.spectral_likelihood.windows import Spectrum

CHANNELS = 8
SPACING_HZ = 1.0 / 1800.0
HERTZ, DAMPING = np.array([2.0, 2.3]), np.array([0.008, 0.012])
POLES = 2 * np.pi * HERTZ * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))


def drawn(rng, *shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def shapes_of(rng):
    return np.linalg.qr(rng.standard_normal((CHANNELS, 2)))[0]


def spectrum(rng, shapes, noise, *, correlated=False):
    """Two modes under white forces, and noise of another size in each channel."""
    omega = 2 * np.pi * SPACING_HZ * np.arange(7200)
    response = 1.0 / (1j * omega[:, None] - POLES)
    forces = drawn(rng, len(omega), 2)
    if correlated:
        forces = forces @ np.array([[1.0, 0.6], [0.0, 0.8]])
    level = noise * np.linspace(0.5, 2.0, CHANNELS)
    seen = (forces * response) @ shapes.T + level * drawn(rng, len(omega), CHANNELS)
    return Spectrum(seen, SPACING_HZ, np.zeros(len(omega), dtype=bool))


def fitted(spectrum: Spectrum, shapes: np.ndarray) -> list[FittedMode]:
    starts = [InitialMode(p, s.astype(complex)) for p, s in zip(POLES, shapes.T, strict=True)]
    return [one for _, one in fit_modes(spectrum, starts, low_hz=0.5, high_hz=3.9)]


def away(shape, truth):
    turned = shape * np.vdot(shape, truth) / abs(np.vdot(shape, truth))
    error = turned - truth / np.linalg.norm(truth)
    return error - truth * np.vdot(truth, error)


@pytest.mark.parametrize("correlated", [False, True])
@pytest.mark.parametrize("noise", [0.02, 0.5])
def test_errors_in_every_channel_are_as_large_as_stated(noise, correlated):
    rng = np.random.default_rng(7)
    ratio: list[np.ndarray] = []
    for _ in range(40):
        shapes = shapes_of(rng)
        start = shapes + 0.1 * rng.standard_normal(shapes.shape)
        modes = fitted(spectrum(rng, shapes, noise, correlated=correlated), start)
        assert len(modes) == 2
        ratio += [
            np.abs(away(m.shape, s)) ** 2 / m.shape_sd**2
            for m, s in zip(modes, shapes.T, strict=True)
        ]
    chi2 = np.mean(ratio, axis=0)
    assert 0.8 < chi2.mean() < 1.3
    assert chi2.min() > 0.55
    assert chi2.max() < 1.8


def test_the_fit_does_not_depend_on_the_errors_of_the_shapes_it_begins_with():
    rng = np.random.default_rng(3)
    shapes = shapes_of(rng)
    record = spectrum(rng, shapes, 0.02)
    near = fitted(record, shapes)
    far = fitted(record, shapes + 0.1 * rng.standard_normal(shapes.shape))
    for one, other in zip(near, far, strict=True):
        assert np.linalg.norm(away(one.shape, other.shape)) < np.linalg.norm(one.shape_sd)


def test_channels_that_say_the_same_have_the_same_component():
    rng = np.random.default_rng(4)
    shapes = shapes_of(rng)
    record = spectrum(rng, shapes, 0.1)
    twice = Spectrum(
        np.concatenate([record.coefficients, record.coefficients[:, :1]], axis=1),
        SPACING_HZ, record.spared,
    )  # fmt: skip
    for one in fitted(twice, np.concatenate([shapes, shapes[:1]])):
        assert one.shape[-1] == pytest.approx(one.shape[0], rel=1e-6, abs=1e-9)
        assert one.shape_sd[-1] == pytest.approx(one.shape_sd[0], rel=1e-6)

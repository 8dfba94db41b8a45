"""Scale of operational shapes by added masses, against the exact modal masses."""

import numpy as np
import pytest
import scipy.linalg

from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.mass_scaling import scale_by_masses
from slowtime.identification.modes import Mode

MASS = np.diag([5.0, 5.0, 4.0, 3.0])
STIFFNESS = 1e4 * np.array([[7, -3, 0, 0], [-3, 6, -3, 0], [0, -3, 5, -2], [0, 0, -2, 2.0]])
SETS = [np.array([0.1, 0, 0, 0.1]), np.array([0, 0.1, 0.1, 0])]


def modes(added=None, sd_hz=1e-6, sd=1e-9, rng=None):
    mass = MASS if added is None else MASS + np.diag(added)
    value, shapes = scipy.linalg.eigh(STIFFNESS, mass)
    found = []
    for square, shape in zip(value, shapes.T, strict=True):
        error = 0.0 if rng is None else sd_hz * rng.standard_normal()
        noise = 0.0 if rng is None else sd / np.sqrt(2) * rng.standard_normal(4)
        found.append(
            Mode(
                frequency_hz=Measured(np.sqrt(square) / (2 * np.pi) + error, sd_hz),
                damping_ratio=Measured(0.01, 0.001),
                correlation=0.0,
                shape=shape / np.linalg.norm(shape) + noise + 0j,
                shape_sd=np.full(4, sd),
            )
        )
    return found


def true_mass(k):
    _, shapes = scipy.linalg.eigh(STIFFNESS, MASS)
    return 1 / np.linalg.norm(shapes[:, k]) ** 2


@pytest.mark.parametrize("k", range(4))
def test_small_masses_give_the_modal_mass(k):
    found = scale_by_masses(modes()[k], [modes(one)[k] for one in SETS], SETS)
    assert found.modal_mass.value == pytest.approx(true_mass(k), rel=0.01)
    moved = found.shape @ MASS @ found.shape
    assert moved == pytest.approx(1.0, rel=0.02)


def test_the_error_is_that_seen_over_seeds():
    errors, told = [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        found = scale_by_masses(
            modes(None, 2e-3, 5e-3, rng)[0],
            [modes(one, 2e-3, 5e-3, rng)[0] for one in SETS],
            SETS,
        )
        errors.append(found.modal_mass.value)
        told.append(found.modal_mass.sd)
    assert np.std(errors) == pytest.approx(np.median(told), rel=0.3)


def test_a_changed_shape_and_disagreeing_masses_are_flagged():
    heavy = np.array([0.0, 0.0, 0.0, 30.0])
    after = [modes(heavy)[1], modes(SETS[0])[1]]
    found = scale_by_masses(modes()[1], after, [heavy, SETS[0]])
    assert "masses_disagree" in found.flags


def test_a_fall_within_the_error_is_refused():
    with pytest.raises(ValueError, match=r"not beyond 2 standard deviations.*Add more mass"):
        scale_by_masses(modes(sd_hz=1.0)[0], [modes(SETS[0], sd_hz=1.0)[0]], [SETS[0]])


def test_masses_of_another_size_are_refused():
    with pytest.raises(ValueError, match="for 4 channels"):
        scale_by_masses(modes()[0], [modes(SETS[0])[0]], [np.array([0.1])])

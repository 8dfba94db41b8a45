import dataclasses

import numpy as np
import pytest
import scipy.linalg

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.frame import Parameter
from slowtime.finite_elements.sparse_slopes import sparse_mode_slopes
from tests.slowtime.finite_elements.frames import line_of_beams, small_tower


def dense_modes(model, theta, rows, count):
    stiffness, mass = model.at(theta)
    values, shapes = scipy.linalg.eigh(stiffness.toarray(), mass.toarray())
    return values[:count], rows @ shapes[:, :count]


def models():
    beam = line_of_beams(15)
    heavier = Parameter(name="mass", groups=("g3", "g4"), acts_on="mass")
    thicker = Parameter(name="both", groups=("g9",), acts_on="both")
    yield assemble(dataclasses.replace(beam, parameters=(*beam.parameters, heavier, thicker)))
    yield assemble(dataclasses.replace(beam, supports=()))


@pytest.mark.parametrize("model", list(models()))
def test_slopes_are_the_quotients_of_differences(model):
    rng = np.random.default_rng(3)
    theta = rng.uniform(-0.2, 0.2, len(model.names))
    rows = rng.standard_normal((4, model.size))
    modes, slopes = sparse_mode_slopes(model, theta, rows, 5)
    rigid = dense_modes(model, theta, rows, 8)[0] < 1e-6 * modes.eigenvalue[0]
    first, step = int(rigid.sum()), 1e-3
    for p in (0, 7, len(theta) - 1):
        change = step * np.eye(len(theta))[p]
        up, down = (dense_modes(model, theta + s * change, rows, first + 5) for s in (1, -1))
        expected = (up[0] - down[0])[first:] / (2 * step)
        scale = np.abs(slopes.eigenvalue).max(axis=1)
        np.testing.assert_allclose(slopes.eigenvalue[:, p] / scale, expected / scale, atol=2e-5)
        here = rows @ modes.shapes
        ends = [
            end[1][:, first:] * np.sign(np.sum(end[1][:, first:] * here, axis=0))
            for end in (up, down)
        ]
        quotient = (ends[0] - ends[1]) / (2 * step)
        size = np.abs(slopes.sensed).max(axis=(0, 2))
        np.testing.assert_allclose(slopes.sensed[:, :, p] / size, quotient / size, atol=2e-4)


def test_stiffness_and_mass_that_grow_alike_change_no_frequency():
    beam = line_of_beams(12)
    whole = Parameter(name="all", groups=tuple(f"g{i}" for i in range(12)), acts_on="both")
    model = assemble(dataclasses.replace(beam, parameters=(whole,)))
    rows = np.eye(model.size)[-2:]
    modes, slopes = sparse_mode_slopes(model, np.zeros(1), rows, 4)
    assert np.abs(slopes.eigenvalue[:, 0] / modes.eigenvalue).max() < 1e-8
    # Mass-normalised shapes fall with the root of the mass.
    np.testing.assert_allclose(
        slopes.sensed[:, :, 0], -0.5 * rows @ modes.shapes, rtol=1e-6, atol=1e-9
    )


def test_groups_share_the_slope_of_the_whole_stiffness():
    model = assemble(small_tower(6))
    modes, slopes = sparse_mode_slopes(model, np.zeros(6), np.zeros((0, model.size)), 5)
    np.testing.assert_allclose(slopes.eigenvalue.sum(axis=1), modes.eigenvalue, rtol=1e-7)

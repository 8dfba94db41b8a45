import dataclasses

import numpy as np
import pytest

from slowtime.identification.spectral_likelihood.evaluation import evaluate
from slowtime.identification.spectral_likelihood.fisher_information import (
    add_prior,
)
from slowtime.identification.spectral_likelihood.model import (
    BandData,
    BandModel,
    step_parameters,
)
from slowtime.identification.spectral_likelihood.score_test import AddedModeTest
from tests.slowtime.identification.spectral_likelihood.information import fisher_information

STEP = 1e-6


def drawn(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def band(*, modes, held=0, still=False, directions=3, groups=23):
    """Data of some modes in noise, averaged over groups of several widths, and a model near."""
    rng = np.random.default_rng(1)
    omega = np.linspace(-20.0, 20.0, groups)
    width = np.where(np.abs(omega) > 8, omega[1] - omega[0], 0.0)
    number = np.where(width > 0, 5.0, 1.0)
    pole = -rng.uniform(0.5, 2.0, modes) + 1j * np.linspace(-12.0, 12.0, modes)
    shape = drawn(rng, directions, modes)
    force = shape * (0.5 / -pole.real) + 0.05 * drawn(rng, directions, modes)
    level = np.eye(directions) * (0.3 + 0j)
    if directions > 1:
        level[0, -1], level[-1, 0] = 0.1j, -0.1j
    model = BandModel(
        pole, shape, force, level, 0.001 * level, pole * 1.1, held, still, 9.0, np.exp(0.4j)
    )
    root = np.linalg.cholesky(model.density(omega, width) + 0.2 * np.eye(directions))
    y = root @ drawn(rng, groups, directions, 7) / np.sqrt(14.0)
    density = y @ y.conj().transpose(0, 2, 1)
    return BandData(omega, density, number, 9.0, np.exp(0.4j), width), model


def derivatives(data, model):
    """Derivatives of the density by all free parameters, by central differences."""
    found = []
    for k in np.flatnonzero(model.free()):
        along = np.zeros(len(model.free()))
        along[k] = STEP
        there, back = (step_parameters(model, way).predicted(data) for way in (along, -along))
        found.append((there - back) / (2 * STEP))
    return np.array(found)


@pytest.mark.parametrize(
    "case",
    [
        {"modes": 3},
        {"modes": 3, "still": True},
        {"modes": 4, "held": 2},
        {"modes": 2, "directions": 1},
        {"modes": 0, "directions": 2},
    ],
)
def test_the_information_is_the_sum_of_traces_of_whitened_derivatives(case):
    data, model = band(**case)
    density = model.predicted(data)
    inverse, slopes = np.linalg.inv(density), derivatives(data, model)
    whitened = inverse @ slopes
    traces = np.einsum("g,pgij,qgji->pq", data.number, whitened, whitened).real
    surprise = inverse @ (data.density - density) @ inverse
    pulls = np.einsum("g,gij,pgji->p", data.number, surprise, slopes).real
    expected = add_prior(model, traces, pulls)
    for found, true in zip(fisher_information(data, model, density), expected, strict=True):
        np.testing.assert_allclose(found, true, rtol=1e-6, atol=1e-6 * np.abs(true).max())


def test_a_step_of_still_poles_takes_their_response_from_before():
    data, model = band(modes=3, still=True)
    before = evaluate(data, model)
    after = dataclasses.replace(model, force=1.1 * model.force)
    again, anew = evaluate(data, after, before), evaluate(data, after)
    assert again.gain is before.gain
    np.testing.assert_array_equal(again.density, anew.density)
    assert again.log_likelihood == anew.log_likelihood


def test_the_score_test_is_that_of_a_model_with_one_more_mode_of_no_force():
    data, model = band(modes=2)
    data = dataclasses.replace(data, length=np.inf, width=0.0)
    model = dataclasses.replace(model, length=np.inf)
    pole, shape = -1.0 + 3.0j, np.array([1.0, 0.5j, -0.3])
    more = model.with_modes(np.array([pole]), shape[:, None])
    information, score = fisher_information(data, more, more.predicted(data))
    # Of one more mode only the force counts: shape and pole make no difference yet.
    directions, modes = more.shape.shape
    of_poles = np.repeat([True, True, False], 2)
    of_shapes = np.repeat([True, True, False], 2 * directions)
    keep = np.concatenate([of_poles, of_shapes, np.ones(2 * directions * modes, dtype=bool)])
    keep = np.concatenate([keep, np.ones(2 * directions**2, dtype=bool)])
    information, score = information[np.ix_(keep, keep)], score[keep]
    gain = 0.5 * score @ np.linalg.pinv(information, rcond=1e-10) @ score
    own = np.ones(len(score), dtype=bool)
    first = 2 * 2 + 2 * directions * 2 + 2 * directions * 2
    own[first : first + 2 * directions] = False
    rest = information[np.ix_(own, own)]
    gain -= 0.5 * score[own] @ np.linalg.pinv(rest, rcond=1e-10) @ score[own]
    found, _ = AddedModeTest(data, model).gain(pole, shape)
    alone = AddedModeTest(data, model)._gain(pole, shape)
    assert alone == pytest.approx(gain, rel=1e-4)
    assert found >= alone

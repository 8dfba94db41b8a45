"""Modes of many channels are the same from one window to the next though their shapes err."""

import numpy as np
import pytest

from twin_server.estimate.elements.mode_matching import match, new_reference
from twin_server.estimate.elements.observed_modes import ObservedMode


def observed(place, frequency_hz, shape):
    return ObservedMode(
        place=place,
        frequency_hz=frequency_hz,
        relative_sd=1e-3,
        damping_ratio=0.01,
        damping_sd=0.001,
        shape=shape / np.linalg.norm(shape),
        shape_sd=np.full(len(shape), 1e-3),
        identity=None,
    )


@pytest.mark.parametrize("channels", [6, 24, 96])
def test_a_shape_that_holds_a_fifth_of_its_neighbour_is_still_the_same_mode(channels):
    rng = np.random.default_rng(4)
    shapes = np.linalg.qr(rng.standard_normal((channels, 3)))[0].T
    before = [observed(k, f, shapes[k]) for k, f in enumerate((2.0, 2.4, 2.9))]
    mixed = [shapes[0] + 0.2 * shapes[1], shapes[1] - 0.2 * shapes[0], shapes[2]]
    after = [observed(k, f, mixed[k]) for k, f in enumerate((2.002, 2.399, 2.903))]
    references = tuple(new_reference(mode, "b") for mode in before)
    assert match(references, after, "b") == {0: 0, 1: 1, 2: 2}


@pytest.mark.parametrize("channels", [6, 24, 96])
def test_another_shape_at_the_same_frequency_is_another_mode(channels):
    shapes = np.linalg.qr(np.random.default_rng(4).standard_normal((channels, 2)))[0].T
    references = (new_reference(observed(0, 2.0, shapes[0]), "b"),)
    assert match(references, [observed(0, 2.0, shapes[1])], "b") == {}

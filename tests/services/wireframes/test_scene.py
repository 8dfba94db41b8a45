"""Scenes: measured shapes at the scale of the model, mode by mode."""

import numpy as np
import pytest

from slowtime_services.wireframes import (
    MeasuredShapes,
    ModelShapes,
    SensorMark,
    Wireframe,
    scene_of,
)

WIRE = Wireframe(
    names=("foot", "middle", "top"),
    places=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]]),
    lines=np.array([[0, 1], [1, 2]]),
    groups=("lower", "upper"),
    sensors=(
        SensorMark("a", 1, (1.0, 0.0, 0.0)),
        SensorMark("b", 2, (1.0, 0.0, 0.0)),
        SensorMark("c", 2, (0.0, 1.0, 0.0)),
    ),
)
MODEL = ModelShapes(
    np.array([2.0, 5.0]),
    np.array(
        [
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.3], [4.0, 0.0, 0.0]],
            [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, -1.0, 0.0]],
        ]
    ),
)


def measured(shapes, numbers):
    count = len(shapes)
    return MeasuredShapes(
        channels=("a", "b", "c"),
        frequency_hz=np.array([2.1, 9.0])[:count],
        frequency_sd_hz=np.full(count, 0.01),
        shapes=np.array(shapes, dtype=complex),
        model_mode=numbers,
    )


def test_a_measured_shape_has_the_scale_and_sign_of_the_model_and_moves_across_as_it_does():
    turned = -7.0j * np.array([1.0, 4.0, 0.0])
    first, second = scene_of(WIRE, MODEL, measured([turned], (0,)))["modes"]
    assert (first["model_mode"], first["measured_hz"]) == (0, 2.1)
    assert first["mac"] == pytest.approx(1.0)
    assert first["points"]["nodes"] == [1, 2]
    # The middle has no sensor along z, where it moves as in the model.
    assert first["points"]["re"] == [[0.25, 0.0, 0.075], [1.0, 0.0, 0.0]]
    assert first["points"]["im"] is None
    assert first["wire"]["re"][2] == [1.0, 0.0, 0.0]
    assert (second["measured_hz"], second["points"], second["mac"]) == (None, None, None)


def test_a_measured_mode_that_is_none_of_the_models_is_drawn_by_itself():
    found = scene_of(WIRE, MODEL, measured([[1, 4, 0], [0.5, -1, 0]], (0, None)))["modes"]
    assert [mode["measured_hz"] for mode in found] == [2.1, None, 9.0]
    assert found[2]["model_hz"] is None
    assert found[2]["wire"]["re"] == [[0, 0, 0], [-0.5, 0, 0], [1, 0, 0]]


def test_phases_between_points_are_kept():
    (mode,) = scene_of(WIRE, None, measured([[1.0, 1.0j, 0.0]], (None,)))["modes"]
    motion = np.array(mode["wire"]["re"]) + 1j * np.array(mode["wire"]["im"])
    assert abs(motion[2, 0] / motion[1, 0] - 1j) < 1e-3


def test_a_mode_without_a_shape_has_frequencies_only():
    (mode, _) = scene_of(WIRE, MODEL, measured([[np.nan] * 3], (0,)))["modes"]
    assert (mode["measured_hz"], mode["mac"], mode["points"]) == (2.1, None, None)


def test_only_groups_that_are_drawn_can_have_changed():
    found = scene_of(WIRE, MODEL, changed=("upper", "deck"))
    assert found["changed"] == ["upper"]
    assert [found["groups"][k] for k in found["group_of_line"]] == ["lower", "upper"]

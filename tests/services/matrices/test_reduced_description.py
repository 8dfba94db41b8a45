"""Frames in model files, reduced: against beams on a line and full models."""

import copy
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from slowtime.dynamics.builders import beam
from slowtime.dynamics.description import BASE, assemble, assemble_parts
from slowtime.dynamics.structure import Structure
from slowtime.finite_elements.eigenvalues import nominal_modes
from slowtime_schemas.files.model_v2 import FiniteElementFile
from slowtime_services.matrices import (
    MatrixFileError,
    describe_reduced,
    matrix_model_of,
    read_any_description,
    read_matrix_model,
    write_matrix,
)
from slowtime_services.models import (
    ModelFileError,
    model_text,
    read_description,
    read_finite_elements,
    read_model,
)

GOLDEN = Path(__file__).parents[3] / "schemas/golden/model_file/v2.yaml"
LENGTH, WIDTH, DEPTH, COUNT = 2.0, 0.04, 0.03, 10
YOUNG, DENSITY = 2.1e11, 7850.0


def cantilever(**more: Any) -> FiniteElementFile:
    """Ten Euler beams along x that bend in the x-z plane; sensors on the way and at the tip."""
    values: dict[str, Any] = {
        "slowtime_model": 2,
        "frame": {
            "materials": [{"id": "steel", "young_pa": YOUNG, "density_kg_m3": DENSITY}],
            "sections": [
                {"id": "bar", "shape": "rectangle", "width_m": WIDTH, "height_m": DEPTH}
            ],
            "nodes": [
                {"id": f"n{k}", "at": [LENGTH * k / COUNT, 0.0, 0.0]} for k in range(COUNT + 1)
            ],
            "elements": [
                {
                    "id": f"e{k}",
                    "between": [f"n{k}", f"n{k + 1}"],
                    "section": "bar",
                    "material": "steel",
                    "theory": "euler",
                    "orientation": [0.0, 1.0, 0.0],
                }
                for k in range(COUNT)
            ],
            "supports": [{"node": "n0"}],
            "parameters": [
                {"name": "root", "elements": [f"e{k}" for k in range(5)]},
                {"name": "tip", "elements": [f"e{k}" for k in range(5, 10)], "prior_sd": 0.2},
            ],
        },
        "sensors": [
            {"channel": "a5", "node": "n5", "direction": "uz"},
            {"channel": "a10", "node": "n10", "direction": "uz"},
        ],
        "band_hz": 60.0,
    }
    return FiniteElementFile.model_validate(copy.deepcopy(values) | more)


def line(**more: Any) -> Structure:
    """The same beam by the elements of a model on a line."""
    described = beam(
        LENGTH,
        YOUNG * WIDTH * DEPTH**3 / 12,
        DENSITY * WIDTH * DEPTH,
        elements=COUNT,
        supports="cantilever",
    )
    return assemble(described)


def response(structure: Structure, frequency_hz: float, load: np.ndarray) -> np.ndarray:
    omega = 2 * np.pi * frequency_hz
    dynamic = structure.stiffness - omega**2 * structure.mass
    return np.linalg.solve(dynamic, load)


@pytest.mark.parametrize("frequency_hz", [3.0, 10.0, 40.0])
def test_a_reduced_frame_responds_to_a_force_as_the_beam_on_a_line(frequency_hz):
    force = {"channel": "f", "kind": "force", "node": "n7", "direction": "uz", "unit": "N"}
    found = describe_reduced(matrix_model_of(cantilever(inputs=[force]), Path()))
    own = assemble(found.description)
    assert own.names[:3] == ("n5 uz", "n10 uz", "n7 uz")
    moved = response(own, frequency_hz, np.eye(len(own.names))[2])[:2]
    other = line()
    places = [2 * (k - 1) for k in (5, 10, 7)]
    expected = response(other, frequency_hz, np.eye(len(other.names))[places[2]])
    np.testing.assert_allclose(moved, expected[places[:2]], rtol=1e-3)


@pytest.mark.parametrize("frequency_hz", [3.0, 40.0])
def test_a_moving_base_loads_a_reduced_frame_as_the_beam_on_a_line(frequency_hz):
    base = {
        "channel": "b", "kind": "base_acceleration", "direction": "uz", "unit": "m/s^2"
    }  # fmt: skip
    found = describe_reduced(matrix_model_of(cantilever(inputs=[base]), Path()))
    own, other = assemble(found.description), line()
    moved = [
        response(one, frequency_hz, one.mass @ one.influence + one.base_mass)[rows]
        for one, rows in ((own, [0, 1]), (other, [8, 18]))
    ]
    np.testing.assert_allclose(moved[0], moved[1], rtol=1e-3)


def test_each_parameter_is_an_element_whose_loss_moves_the_frequencies_as_in_the_full_model():
    model = matrix_model_of(cantilever(), Path())
    found = describe_reduced(model, trials=2)
    assert found.model.error is not None
    assert found.model.error.frequency < 1e-3
    parts = assemble_parts(found.description).stiffness_parts
    assert set(parts) == {"root", "tip"}
    whole = assemble(found.description)
    weaker = dataclasses.replace(whole, stiffness=whole.stiffness - 0.2 * parts["root"])
    own = np.linalg.eigvals(np.linalg.solve(weaker.mass, weaker.stiffness))
    stiffness, mass = model.matrices.at(np.array([-0.2, 0.0]))
    full = np.linalg.eigvals(np.linalg.solve(mass.toarray(), stiffness.toarray()))
    np.testing.assert_allclose(np.sort(own.real)[:4], np.sort(full.real)[:4], rtol=2e-3)


def test_a_reduced_model_written_as_a_model_file_reads_back_to_the_last_digit(tmp_path):
    found = describe_reduced(matrix_model_of(cantilever(), Path())).description
    text = model_text(found)
    assert text.startswith("slowtime_model: 2\n")
    (tmp_path / "small.yaml").write_text(text)
    assert read_description(tmp_path / "small.yaml") == found
    assert read_any_description(tmp_path / "small.yaml") == found


def test_the_golden_frame_reads_for_ever():
    model = read_matrix_model(GOLDEN)
    np.testing.assert_allclose(
        nominal_modes(model.matrices, 3).frequency_hz, [1.165268, 6.26928, 20.45468], rtol=1e-5
    )
    assert model.channels == ("a1", "a2", "e1")
    np.testing.assert_array_equal(model.prior_sd, [0.2, 0.3])
    dofs: Any = model.matrices.dofs
    # Mean strain of the girder of 4 m between the columns' heads.
    assert model.sensors[2, dofs.find("right", "ux")] == 0.25
    assert model.sensors[2, dofs.find("left", "ux")] == -0.25
    found = describe_reduced(model)
    assert found.left_out == ("e1",)
    joint = next(e for e in found.description.elements if e.id == "clamp")
    assert joint.between == ("left ux", "right ux")
    assert not assemble_parts(found.description).stiffness_parts.keys() & {"clamp"}


def test_a_strain_may_be_the_row_of_a_matrix(tmp_path):
    rows = np.zeros((2, 6 * (COUNT + 1)))
    rows[1, 3] = 0.5
    import scipy.io

    scipy.io.savemat(tmp_path / "rows.mat", {"S": rows})
    row = {"file": "rows.mat", "variable": "S", "row": 1}
    sensors = [{"channel": "e", "quantity": "strain", "row": row}]
    model = matrix_model_of(cantilever(sensors=sensors), tmp_path)
    np.testing.assert_array_equal(model.sensors[0], rows[1])
    write_matrix(tmp_path / "small.npz", model.matrices.stiffness[:3][:, :3])
    sensors[0]["row"] = {"file": "small.npz"}
    with pytest.raises(MatrixFileError, match=r"shape \(3, 3\). Allowed are rows .* of 66 col"):
        matrix_model_of(cantilever(sensors=sensors), tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("section: pipe, material: steel, group: c", "section: p, material: steel, group: c",
         "'c1' names the section 'p'. Allowed are pipe, flat, rod"),
        ("elements: [d1]", "elements: [d9]", "names the element 'd9', which does not exist"),
        ("elements: [d1]", "elements: [c1]", "which is in the group 'columns'"),
        ("groups: [columns]", "groups: [walls]", "names the group 'walls'"),
        ("node: right foot, dir", "node: foot, dir", "Node 'foot', direction 'ux' was given"),
        ("section: flat", "section: rod", "section 'rod' without inertias"),
        ("young_pa: 2.1e11", "young: 1", r"line 5: unknown key `young`.*you mean `young_pa`"),
        ("wall_m: 0.005", "wall_m: 0.5", "Section 'pipe': A wall of 0.5 m"),
        (", wall_m: 0.005", "", r"line 7.*lacks wall_m"),
        ("direction: ux}\nin", "direction: up}\nin", r"line 36: `direction`.*'ux', 'uy'"),
        ("quantity: strain, between", "quantity: velocity, between", "A strain is measured"),
        ("channel: a2", "channel: a1", "Two sensors have the channel 'a1'"),
        ("slowtime_model: 2", "slowtime_model: 1", "line 1: finite elements need version 2"),
        ("frame:\n", "frame:\n  nodes: []\n", "`nodes` stands here twice"),
    ],
)  # fmt: skip
def test_frames_that_cannot_be_read_say_what_to_do(tmp_path, old, new, words):
    text = GOLDEN.read_text()
    assert old in text
    path = tmp_path / "m.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(MatrixFileError, match=words):
        read_matrix_model(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensors": []}, "No sensors, inputs and joints"),
        ({"sensors": [{"channel": "a", "node": "n0", "direction": "uz"}]}, "some of them are"),
        (
            {"joints": [{"id": "tip", "between": ["base", "n4"], "direction": "uz"}]},
            "A parameter is called 'tip', as a joint",
        ),
        (
            {"joints": [{"id": "j", "between": ["base", "n44"], "direction": "uz"}]},
            "Node 'n44', direction 'uz' was given",
        ),
        ({"band_hz": 0.5}, "0 modes lie below"),
        (
            {
                "inputs": [
                    {
                        "channel": "b",
                        "kind": "base_acceleration",
                        "direction": "uz",
                        "unit": "g",
                    }
                ],
                "sensors": [{"channel": "a", "node": "n4", "line": [0.6, 0.0, 0.8]}],
            },
            "sees 0.8 of the motion of the base",
        ),
    ],
)
def test_models_that_cannot_be_reduced_say_what_to_do(change, words):
    with pytest.raises(MatrixFileError, match=words):
        describe_reduced(matrix_model_of(cantilever(**change), Path()))


def test_verbs_for_models_on_a_line_say_that_a_frame_is_to_be_reduced():
    with pytest.raises(ModelFileError, match="reduce it first: slowtime model reduce"):
        read_model(GOLDEN)
    assert read_finite_elements(GOLDEN.with_name("v1.yaml")) is None


def test_a_matrix_that_does_not_fit_its_coordinates_is_refused(tmp_path):
    found = describe_reduced(matrix_model_of(cantilever(), Path())).description
    values = yaml.safe_load(model_text(found))
    values["elements"][0]["coordinates"] = values["elements"][0]["coordinates"][:-1]
    (tmp_path / "m.json").write_text(json.dumps(values))
    with pytest.raises(ModelFileError, match=r"Allowed is none, or the \d+ of a triangle"):
        read_model(tmp_path / "m.json")
    values["elements"][0]["stiffness"] = "no base64!"
    (tmp_path / "m.json").write_text(json.dumps(values))
    with pytest.raises(ModelFileError, match="This is no base64"):
        read_model(tmp_path / "m.json")
    assert BASE not in found.dofs

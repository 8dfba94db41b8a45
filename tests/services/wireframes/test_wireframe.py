"""Wireframes of frames, matrices and geometry files: what is drawn, and how it moves."""

from pathlib import Path

import numpy as np
import pytest

from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime_schemas.files.model_v2 import FiniteElementFile, LineModelFile
from slowtime_services.matrices import (
    MatrixFileError,
    describe_reduced,
    matrix_model_of,
    read_matrix_model,
    write_matrix,
)
from slowtime_services.modal import Geometry, NodeAxis
from slowtime_services.models import model_file_of, read_model, write_model
from slowtime_services.wireframes import (
    geometry_of,
    measured_wireframe,
    stored_motions,
    wireframe_of,
    with_geometry,
)
from slowtime_services.wireframes.thinning import contracted, spread_nodes
from tests.services.matrices.written_files import write_dof_map

TOWER = Path(__file__).parents[3] / "docs/examples/lattice_tower.yaml"


@pytest.fixture(scope="module")
def tower():
    return read_matrix_model(TOWER)


def test_a_frame_has_a_line_for_each_element_with_the_parameter_that_scales_it(tower):
    wire = wireframe_of(tower)
    frame = tower.file.frame
    assert wire.names == tuple(node.id for node in frame.nodes)
    assert len(wire.lines) == len(frame.elements)
    names = {element.id: k for k, element in enumerate(frame.elements)}
    assert wire.groups[names["leg 0.0"]] == "lower legs"
    assert wire.groups[names["girt 1.0"]] == ""
    first = wire.sensors[0]
    assert (first.channel, wire.names[first.node], first.along) == ("a10x", "1.0", (1, 0, 0))


def test_matrices_of_the_same_frame_have_lines_where_the_stiffness_couples(tower, tmp_path):
    free = tower.file.model_dump(mode="json", exclude_defaults=True)
    del free["frame"]["supports"]
    whole = matrix_model_of(FiniteElementFile.model_validate(free), Path())
    write_matrix(tmp_path / "K.npz", whole.matrices.stiffness)
    write_matrix(tmp_path / "M.npz", whole.matrices.mass)
    assert whole.matrices.dofs is not None
    write_dof_map(tmp_path / "dofs.csv", whole.matrices.dofs)
    parts = []
    for name, part in zip(whole.matrices.names, whole.matrices.stiffness_parts, strict=True):
        assert part is not None
        write_matrix(tmp_path / f"{name}.npz", part)
        parts.append({"name": name, "stiffness": f"{name}.npz"})
    held = [{"node": f"0.{c}"} for c in range(4)]
    file = {
        "slowtime_model": 2,
        "matrices": {"stiffness": "K.npz", "mass": "M.npz", "dofs": "dofs.csv",
                     "parameters": parts, "held": held},
        "sensors": free["sensors"],
    }  # fmt: skip
    read = matrix_model_of(FiniteElementFile.model_validate(file), tmp_path)
    drawn, expected = wireframe_of(read), wireframe_of(tower)

    def by_pair(wire):
        pairs = [frozenset((wire.names[a], wire.names[b])) for a, b in wire.lines.tolist()]
        return dict(zip(pairs, wire.groups, strict=True))

    # Lines between two held nodes are gone: nothing moves there.
    feet = {f"0.{c}" for c in range(4)}
    wanted = {pair: group for pair, group in by_pair(expected).items() if not pair <= feet}
    assert by_pair(drawn) == wanted


def test_stored_motions_give_the_modes_of_the_full_model(tower, tmp_path):
    reduced = describe_reduced(tower)
    file = with_geometry(model_file_of(reduced.description), geometry_of(tower, reduced))
    write_model(tmp_path / "small.yaml", file)
    again = read_model(tmp_path / "small.yaml")
    assert isinstance(again, LineModelFile)
    assert isinstance(file, LineModelFile)
    assert again.geometry is not None
    assert again.geometry == file.geometry
    model = reduced.model
    shapes = model.modes(np.zeros(len(model.names)), 4).shapes
    moved = stored_motions(again.geometry, again.geometry.coordinates) @ shapes
    stiffness, mass = tower.matrices.at(np.zeros(len(tower.matrices.names)))
    full = lowest_modes(stiffness, mass, 4)
    wire = wireframe_of(tower)
    rows = wire.motion_rows(tower.matrices.dofs) @ tower.matrices.expansion
    exact = rows @ full.shapes
    signs = np.sign(np.sum(exact * moved, axis=0))
    np.testing.assert_allclose(moved * signs, exact, atol=1e-3 * np.abs(exact).max())
    # Other orders of coordinates are followed, and unknown ones do not move anything.
    turned = stored_motions(again.geometry, (*again.geometry.coordinates[::-1], "other"))
    np.testing.assert_array_equal(turned[:, -2::-1] @ shapes, moved)
    assert not turned[:, -1].any()


def test_of_many_nodes_those_of_sensors_and_distant_ones_are_drawn(tower):
    wire = wireframe_of(tower, most=16)
    assert len(wire.names) == 16
    assert {one.node for one in tower.file.sensors} <= set(wire.names)
    assert len(wire.sensors) == 24
    # All of it still hangs together.
    joined = {0}
    for _ in wire.names:
        joined |= {b for a, b in wire.lines.tolist() if a in joined}
        joined |= {a for a, b in wire.lines.tolist() if b in joined}
    assert joined == set(range(16))


def test_nodes_of_a_line_are_spread_and_neighbours_are_joined():
    places = np.column_stack([np.arange(101.0), np.zeros(101), np.zeros(101)])
    chosen = spread_nodes(places, np.array([50]), 5)
    assert chosen.tolist() == [0, 25, 50, 75, 100]
    lines = np.column_stack([np.arange(100), np.arange(1, 101)])
    groups = ("left",) * 50 + ("right",) * 50
    few, named = contracted(lines, groups, places, chosen)
    assert few.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert named == ("left", "left", "right", "right")


def test_a_geometry_file_gives_trace_lines_and_places_of_channels():
    nodes = {1: (0.0, 0.0, 0.0), 5: (0.0, 0.0, 2.0), 9: (1.0, 0.0, 2.0)}
    places = {"a": NodeAxis(5, -1), "b": NodeAxis(9, 3)}
    wire = measured_wireframe(("a", "b"), Geometry(nodes, ((1, 5, 0, 5, 9),), places))
    assert wire.lines.tolist() == [[0, 1], [1, 2]]
    assert [(one.node, one.along) for one in wire.sensors] == [(1, (-1, 0, 0)), (2, (0, 0, 1))]
    # Without lines, the nodes hang together by the shortest ones.
    alone = measured_wireframe(("a", "b"), Geometry(nodes, (), places))
    assert sorted(map(sorted, alone.lines.tolist())) == [[0, 1], [1, 2]]


def test_a_model_without_positions_says_what_to_give(tower, tmp_path):
    write_matrix(tmp_path / "K.npz", tower.matrices.stiffness)
    write_matrix(tmp_path / "M.npz", tower.matrices.mass)
    file = {"slowtime_model": 2, "matrices": {"stiffness": "K.npz", "mass": "M.npz"}}
    read = matrix_model_of(FiniteElementFile.model_validate(file), tmp_path)
    with pytest.raises(MatrixFileError, match=r"Give `dofs` with x, y, z, or `positions`\."):
        wireframe_of(read)


def test_shells_are_drawn_by_their_sides_each_of_them_once():
    names = ["a", "b", "c", "d", "e", "f"]
    frame = {
        "nodes": [{"id": n, "at": [k // 2, k % 2, 0.0]} for k, n in enumerate(names)],
        "materials": [{"id": "steel", "young_pa": 2.1e11, "density_kg_m3": 7850.0}],
        "shells": [
            {
                "id": f"s{k}",
                "corners": corners,
                "thickness_m": 0.01,
                "material": "steel",
                "group": f"g{k}",
            }
            for k, corners in enumerate((["a", "c", "d", "b"], ["c", "e", "f", "d"]))
        ],
        "supports": [{"node": "a"}, {"node": "b"}],
        "parameters": [{"name": "far", "elements": [], "groups": ["g1"]}],
    }
    file = FiniteElementFile.model_validate({"slowtime_model": 2, "frame": frame})
    model = matrix_model_of(file, Path())
    wire = wireframe_of(model)
    sides = {
        tuple(names[k] for k in line): g
        for line, g in zip(wire.lines, wire.groups, strict=True)
    }
    assert len(sides) == 7
    assert sides["c", "d"] == ""
    assert sides["e", "f"] == "far"
    (part,) = model.matrices.stiffness_parts
    assert part is not None
    assert part.nnz > 0

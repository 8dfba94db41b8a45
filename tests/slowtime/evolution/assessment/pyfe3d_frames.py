"""Frames of columns and girders by pyfe3d, measured before and after losses of stiffness.

The library divides each member in two; the model of slowtime has one element a member.
"""

import dataclasses
import functools
import itertools
from collections.abc import Mapping

import numpy as np
import scipy.linalg

from benchmarks.methods.lattice_tower.structure import tube_properties
from slowtime.evolution.structures import MeasuredModes, SparseStructure
from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.frame import Beam, Frame, Parameter, PointMass, Support
from slowtime.finite_elements.sections import Material, tube

STEEL = Material(young_pa=2.1e11, poisson=0.3, density_kg_m3=7850.0)
PLAN_M = ((0.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 4.0))
STOREY_M = 3.5
COLUMN_M, GIRDER_M = (0.25, 0.010), (0.20, 0.008)
CORNER_KG = (900.0, 700.0, 800.0, 1000.0)
"""Mass on the corners of each floor: uneven, so that no modes are exact pairs."""


Node = tuple[int, int]
Member = tuple[Node, Node, tuple[float, float]]
"""Ends, each a level and a corner, and diameter and wall of the tube [m]."""


@dataclasses.dataclass(frozen=True)
class Truth:
    """A frame by pyfe3d, and how it is measured.

    Parameters
    ----------
    storeys
        Storeys of four columns and four girders each.
    modes
        Number of lowest modes that are measured.
    frequency_sd, shape_sd
        Errors of frequencies, relative, and of components of shapes over the largest [1].
    model_error, temperature_sd
        Relative standard deviation of the stiffness of each member about the model, and of a
        common factor on all between two states [1].
    corners
        Those whose two horizontal motions are measured, on each floor.
    """

    storeys: int
    modes: int = 8
    frequency_sd: float = 1e-3
    shape_sd: float = 0.01
    model_error: float = 0.02
    temperature_sd: float = 0.02
    corners: tuple[int, ...] = (0, 1, 2, 3)

    @functools.cached_property
    def members(self) -> dict[str, Member]:
        """Name → ends, each level and corner, and tube."""
        found: dict[str, Member] = {}
        for level, corner in itertools.product(range(self.storeys), range(4)):
            above, beside = (level + 1, corner), (level + 1, (corner + 1) % 4)
            found[f"column {level + 1}.{corner}"] = ((level, corner), above, COLUMN_M)
            found[f"girder {level + 1}.{corner}"] = (above, beside, GIRDER_M)
        return found

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.members)

    def place(self, node: tuple[int, int]) -> np.ndarray:
        return np.array([*PLAN_M[node[1]], STOREY_M * node[0]])

    @functools.cached_property
    def sensed(self) -> list[tuple[tuple[int, int], int]]:
        """Node and direction of each channel."""
        levels = range(1, self.storeys + 1)
        return list(itertools.product(itertools.product(levels, self.corners), (0, 1)))

    @functools.cached_property
    def model(self) -> tuple[SparseStructure, np.ndarray]:
        """Model of slowtime, and what the channels see of it."""
        nodes = [*itertools.product(range(self.storeys + 1), range(4))]
        word = "{0[0]}.{0[1]}".format
        frame = Frame(
            node_names=tuple(map(word, nodes)),
            coordinates=np.array([self.place(node) for node in nodes]),
            beams=tuple(
                Beam(name=name, ends=(word(one), word(other)), section=tube(*size),
                     material=STEEL, group=name)
                for name, (one, other, size) in self.members.items()
            ),
            masses=tuple(
                PointMass(name=f"m{word(node)}", node=word(node), mass_kg=CORNER_KG[node[1]])
                for node in nodes[4:]
            ),
            supports=tuple(Support(node=word(node)) for node in nodes[:4]),
            parameters=tuple(Parameter(name=n, groups=(n,)) for n in self.names),
        )  # fmt: skip
        matrices = assemble(frame)
        assert matrices.dofs is not None
        rows = [
            matrices.dofs.row(word(node), {("ux", "uy")[way]: 1.0}) for node, way in self.sensed
        ]
        return SparseStructure(matrices=matrices), np.array(rows)

    @functools.cached_property
    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness of each member, mass, and the rows of the channels; feet are held."""
        from pyfe3d import BeamC, BeamCData, BeamCProbe

        number: dict[object, int] = {}
        places: list[np.ndarray] = []

        def at(key: object, place: np.ndarray) -> int:
            if key not in number:
                number[key] = len(places)
                places.append(place)
            return number[key]

        halves = []
        for corner in range(4):
            at((0, corner), self.place((0, corner)))
        for name, (one, other, size) in self.members.items():
            ends = [at(node, self.place(node)) for node in (one, other)]
            middle = at(name, (self.place(one) + self.place(other)) / 2)
            halves += [(ends[0], middle, size), (middle, ends[1], size)]
        flat, free = np.concatenate(places), 6 * len(places)
        data, probe = BeamCData(), BeamCProbe()
        parts, mass = np.zeros((len(self.members), free, free)), np.zeros((free, free))
        for k, (first, second, size) in enumerate(halves):
            triplets = [
                [np.zeros(n, dtype=int), np.zeros(n, dtype=int), np.zeros(n)]
                for n in (data.KC0_SPARSE_SIZE, data.M_SPARSE_SIZE)
            ]
            element = BeamC(probe)
            element.c1, element.c2, element.init_k_KC0, element.init_k_M = (
                6 * first, 6 * second, 0, 0,
            )  # fmt: skip
            along = places[second] - places[first]
            element.update_rotation_matrix(*np.eye(3)[np.argmin(np.abs(along))], flat)
            element.update_probe_xe(flat)
            properties = tube_properties(*size)
            element.update_KC0(*triplets[0], properties)
            element.update_M(*triplets[1], properties)
            for whole, entry in zip((parts[k // 2], mass), triplets, strict=True):
                np.add.at(whole, (entry[0], entry[1]), entry[2])
        for level, corner in itertools.product(range(1, self.storeys + 1), range(4)):
            own = 6 * number[level, corner] + np.arange(3)
            mass[own, own] += CORNER_KG[corner]
        rows = np.zeros((len(self.sensed), free))
        for row, (node, way) in zip(rows, self.sensed, strict=True):
            row[6 * number[node] + way] = 1.0
        inner = slice(24, None)
        return parts[:, inner, inner], mass[inner, inner], rows[:, inner]

    def measured(self, factors: np.ndarray, random: np.random.Generator) -> MeasuredModes:
        """Modes with noise, of members with these factors on their stiffness."""
        parts, mass, rows = self.matrices
        stiffness = np.tensordot(factors, parts, axes=1)
        squares, shapes = scipy.linalg.eigh(
            stiffness, mass, subset_by_index=(0, self.modes - 1)
        )
        frequency = np.sqrt(squares) / (2 * np.pi)
        seen = (rows @ shapes).T
        sd = self.shape_sd * np.abs(seen).max(axis=1, keepdims=True) * np.ones(seen.shape)
        noise = 1 + self.frequency_sd * random.standard_normal(self.modes)
        return MeasuredModes(
            frequency_hz=frequency * noise,
            frequency_sd_hz=self.frequency_sd * frequency,
            shapes=seen + sd * random.standard_normal(seen.shape),
            shape_sd=sd,
            channels=self.model[1],
        )

    def states(
        self, losses: Mapping[str, float], seed: int
    ) -> tuple[MeasuredModes, MeasuredModes]:
        """Modes before and now: model error, losses, a common factor, noise."""
        random = np.random.default_rng(seed)
        factors = np.exp(self.model_error * random.standard_normal(len(self.names)))
        kept = np.array([1.0 - losses.get(name, 0.0) for name in self.names])
        warm = np.exp(self.temperature_sd * random.standard_normal())
        return self.measured(factors, random), self.measured(factors * kept * warm, random)

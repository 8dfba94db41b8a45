"""A lattice tower of beams and trusses made by pyfe3d: its files, reduction and monitoring."""

import numpy as np
import pytest

from benchmarks.methods.lattice_tower.reduction import (
    COORDINATES,
    MODES,
    SPAN,
    compare_at_random,
)
from benchmarks.methods.lattice_tower.structure import (
    DENSITY_KG_M3,
    POISSON,
    YOUNG_PA,
    TowerLayout,
    assemble_tower,
    draw_tower,
    export_tower,
    group_names,
    tube_properties,
)
from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import lowest_modes, nominal_modes
from slowtime.finite_elements.frame import Bar, Beam, Frame, Parameter, Support
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime.finite_elements.sections import Material, Section
from slowtime_services.matrices import read_matrix_model

pytest.importorskip("pyfe3d")

SMALL = TowerLayout(storeys=60, leg_elements=1, girt_elements=1)
MIDDLE = TowerLayout(storeys=60, leg_elements=2, girt_elements=2)


def section(tube):
    """The tube that pyfe3d has, for the elements of this project."""
    made = tube_properties(*tube)
    return Section(
        area_m2=made.A, inertia_y_m4=made.Iyy, inertia_z_m4=made.Izz, torsion_m4=made.J,
        shear_y_m2=0.5 * made.A, shear_z_m2=0.5 * made.A,
    )  # fmt: skip


def own_frame(tower):
    """The same tower of the elements of this project."""
    steel = Material(young_pa=YOUNG_PA, poisson=POISSON, density_kg_m3=DENSITY_KG_M3)
    groups = group_names()

    def elements(kind, letter, members):
        return tuple(
            kind(
                name=f"{letter}{k}",
                ends=(tower.names[first], tower.names[second]),
                section=section(tube),
                material=steel,
                group="" if group < 0 else groups[group],
            )
            for k, (first, second, tube, group) in enumerate(members)
        )

    return Frame(
        node_names=tuple(tower.names),
        coordinates=tower.place_m,
        beams=elements(Beam, "b", tower.beams),
        bars=elements(Bar, "t", tower.trusses),
        supports=tuple(Support(node=f"0.{corner}") for corner in range(4)),
        parameters=tuple(Parameter(name=name, groups=(name,)) for name in groups),
    )


def test_frequencies_and_their_slopes_equal_those_of_the_elements_of_this_project():
    tower = draw_tower(SMALL)
    theirs = assemble_tower(tower)
    ours = assemble(own_frame(tower))
    modes = lowest_modes(theirs.stiffness, theirs.mass, 10)
    own = nominal_modes(ours, 10)
    # Trusses of pyfe3d resist torsion and weigh about their axis, those of this project do not.
    np.testing.assert_allclose(modes.frequency_hz, own.frequency_hz, rtol=5e-4)
    for part, own_part in zip(theirs.parts, ours.stiffness_parts, strict=True):
        energy = np.sum(modes.shapes * (part @ modes.shapes), axis=0) / modes.eigenvalue
        own_energy = np.sum(own.shapes * (own_part @ own.shapes), axis=0) / own.eigenvalue
        np.testing.assert_allclose(energy, own_energy, atol=2e-3)


def test_files_hold_what_was_assembled_and_changes_of_groups(tmp_path):
    made = assemble_tower(draw_tower(SMALL))
    whole = read_matrix_model(export_tower(tmp_path / "built", SMALL))
    assert whole.matrices.names == group_names()
    assert len(whole.matrices.names) == 30
    assert len(whole.channels) == 24
    assert abs(whole.matrices.stiffness - made.stiffness).max() < 1e-9 * made.stiffness.max()
    softer = read_matrix_model(export_tower(tmp_path / "soft", SMALL, changes={"legs 4": -0.1}))
    lost = whole.matrices.stiffness - softer.matrices.stiffness
    expected = 0.1 * made.parts[group_names().index("legs 4")]
    assert abs(lost - expected).max() < 1e-9 * made.stiffness.max()


@pytest.mark.long
def test_the_reduced_model_holds_over_thirty_groups_and_an_update_costs_little(tmp_path):
    full = read_matrix_model(export_tower(tmp_path, MIDDLE)).matrices
    assert full.size == 4320
    reduced = reduce_modal(full, BasisSettings(modes=MODES, span=SPAN), trials=0)
    assert reduced.size <= COORDINATES
    found = compare_at_random(full, reduced, 10, 1)
    assert found.frequency < 1e-3
    assert found.agreement > 0.999
    assert found.updated_s < 0.2 * found.full_s

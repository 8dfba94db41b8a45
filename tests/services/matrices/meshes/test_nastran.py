"""Frames from bulk data: against closed forms, and against frequencies that OpenSees printed.

No Nastran was at hand; the cards follow its Quick Reference Guide.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import nominal_modes
from slowtime_services.matrices import MatrixFileError, read_matrix_model
from slowtime_services.matrices.frame_model import frame_of
from slowtime_services.matrices.meshes import convert_mesh, frame_text

OPENSEES_HZ = np.loadtxt(Path(__file__).parents[1] / "written/opensees/frequencies.txt")
PORTAL = """SOL 103
CEND
SPC = 7
BEGIN BULK
PARAM,POST,0
EIGRL,1,,,6
GRID           1              0.      0.      0.
GRID           2              0.      0.      3.
GRID*                  3                              2.              0.
*                     3.
GRID,4,,4.,0.,3.
GRID,5,,4.,0.,0.
CBAR           1       9       1       2      1.      0.      0.
CBAR,2,9,2,3,0.,0.,-1.
CBAR,3,9,3,4,0.,0.,-1.
CBAR,4,9,4,5,-1.,0.,0.
PBAR           9       2  1.5-3   1.6-6   1.2-6    2.-6
MAT1,2,2.1+11,8.0769+10,,7850.
CONM2,1,3,,50.
SPC1           7  123456       1       5
SPC1           8  123456       3
ENDDATA
"""
STEEL = "MAT1,1,2.1+11,,.3,7850.\n"


def converted(tmp_path, text, name="m.bdf", **more):
    path = tmp_path / name
    path.write_text(text)
    return convert_mesh(path, **more)


def hertz(found, count):
    return nominal_modes(assemble(frame_of(found.file.frame)), count).frequency_hz


def line(count=20, length=1.0):
    return "".join(f"GRID,{k + 1},,{length * k / count:.9f},0.,0.\n" for k in range(count + 1))


def cantilever(card, orientation="0.,1.,0.", element="CBAR", count=20, length=1.0):
    elements = "".join(
        f"{element},{k},1,{k},{k + 1},{orientation}\n" for k in range(1, count + 1)
    )
    return line(count, length) + elements + card + STEEL + "SPC1,1,123456,1\n"


def test_a_portal_has_the_frequencies_that_opensees_prints(tmp_path):
    found = converted(tmp_path, PORTAL)
    # OpenSees takes J for the polar inertia of mass, which the second and fourth mode, in the
    # plane of the portal, do not have; with J the others agree to 3e-10 too.
    np.testing.assert_allclose(hertz(found, 6)[[1, 3]], OPENSEES_HZ[[1, 3]], rtol=1e-9)
    np.testing.assert_allclose(hertz(found, 6), OPENSEES_HZ, rtol=1e-3)
    assert found.notes == ()


def test_what_is_written_is_read_again_as_the_same_model(tmp_path):
    found = converted(tmp_path, PORTAL, parameters=True)
    path = tmp_path / "portal.yaml"
    path.write_text(frame_text(found.file))
    read = read_matrix_model(path)
    assert read.file == found.file
    assert read.matrices.names == ("PBAR 9",)
    np.testing.assert_array_equal(nominal_modes(read.matrices, 6).frequency_hz, hertz(found, 6))
    assert yaml.safe_load(path.read_text())["frame"]["nodes"][0]["id"] == "1"


@pytest.mark.parametrize(
    ("card", "planes", "element"),
    [
        ("PBAR,1,1,2.-3,8.-7,2.-7,1.-7\n", (8e-7 / 2e-3, 2e-7 / 2e-3), "CBAR"),
        ("PBEAM,1,1,2.-3,8.-7,2.-7,,1.-7\n+\n+,1.+9,1.+9\n", (4e-4, 1e-4), "CBEAM"),
        ("PBARL,1,1,,BAR\n+,.01,.03\n", (0.03**2 / 12, 0.01**2 / 12), "CBAR"),
        ("PBARL,1,1,,ROD\n+,.01\n", (0.01**2 / 4,) * 2, "CBAR"),
        ("PBARL,1,1,,TUBE\n+,.02,.018\n", ((0.02**2 + 0.018**2) / 4,) * 2, "CBAR"),
        ("PBEAML,1,1,,TUBE2\n+,.02,.002\n", ((0.02**2 + 0.018**2) / 4,) * 2, "CBEAM"),
        (
            "PBARL,1,1,,BOX\n+,.02,.04,.002,.001\n",
            (
                (0.02 * 0.04**3 - 0.018 * 0.036**3) / 12 / (0.02 * 0.04 - 0.018 * 0.036),
                (0.04 * 0.02**3 - 0.036 * 0.018**3) / 12 / (0.02 * 0.04 - 0.018 * 0.036),
            ),
            "CBAR",
        ),
    ],
)
def test_a_slender_cantilever_bends_in_its_planes_as_in_the_textbook(
    tmp_path, card, planes, element
):
    length = 20.0  # so slender that shear and rotary inertia change less than 1e-4
    found = converted(tmp_path, cantilever(card, element=element, length=length))
    modes = nominal_modes(assemble(frame_of(found.file.frame)), 2)
    speed = np.sqrt(2.1e11 / 7850.0)
    expected = 1.8751040687**2 / (2 * np.pi) * speed * np.sqrt(planes) / length**2
    np.testing.assert_allclose(modes.frequency_hz, np.sort(expected), rtol=2e-4)
    model: Any = assemble(frame_of(found.file.frame))
    moved = model.expand(modes.shapes)
    stiff = int(np.argmax(expected)) if planes[0] != planes[1] else None
    if stiff is not None:  # plane 1 is that of the orientation, the global x-y plane
        tip = [abs(moved[model.dofs.find("21", way), 1]) for way in ("uy", "uz")]
        assert tip[0] > 1e3 * tip[1]


def test_rods_scalar_springs_and_masses_vibrate_as_single_masses(tmp_path):
    text = (
        "GRID,1,,0.,0.,0.\nGRID,2,,2.,0.,0.,,23456\n"
        "CROD,1,3,1,2\nPROD,3,1,1.-4\nMAT1,1,2.+11,,.3\n"
        "CELAS2,2,3.+6,2,1\nCELAS1,3,5,2,1\nPELAS,5,1.+6\n"
        "CONM2,4,2,,25.\nSPC,1,1,123456,0.\n"
    )
    found = converted(tmp_path, text)
    stiffness = 2e11 * 1e-4 / 2.0 + 3e6 + 1e6
    assert hertz(found, 1)[0] == pytest.approx(np.sqrt(stiffness / 25.0) / (2 * np.pi))
    assert {one.group for one in found.file.frame.elements} == {
        "PROD 3",
        "CELAS2 2",
        "PELAS 5",
    }


def test_a_bushing_between_two_points_at_one_place_is_six_springs(tmp_path):
    text = (
        "GRID,1,,0.,0.,0.,,123456\nGRID,2,,0.,0.,0.\nCBUSH,1,4,1,2,,,,0\n"
        "PBUSH,4,K,1.+4,2.+4,3.+4,40.,50.,60.\nCONM2,9,2,,1.\n+,1.,,1.,,,1.\n"
    )
    expected = np.sqrt(np.sort([1e4, 2e4, 3e4, 40.0, 50.0, 60.0])) / (2 * np.pi)
    np.testing.assert_allclose(hertz(converted(tmp_path, text), 6), expected, rtol=1e-9)


def test_rigid_elements_offsets_and_relations_carry_a_mass_alike(tmp_path):
    beam = cantilever("PBAR,1,1,2.-3,8.-7,2.-7,1.-7\n")
    far = "GRID,99,,1.0,0.2,0.1\nCONM2,1,99,,30.\n"
    offset = beam + "CONM2,1,21,,30.,,.2,.1\n"
    truth = hertz(converted(tmp_path, offset.replace("30.,,.2", "30.,0.,.2")), 5)
    for rigid in (
        "RBE2,7,21,123456,99\n",
        "RBAR,7,21,99,123456\n",
        "RBE2,7,21,123,99\nRBE2,8,21,456,99\n",
        "MPC,1,99,1,1.,21,1,-1.\n+,,21,6,.2,21,5,-.1\nMPC,1,99,2,1.,21,2,-1.\n"
        "+,,21,4,.1\nMPC,1,99,3,1.,21,3,-1.\n+,,21,4,-.2\n"
        "MPC,1,99,4,1.,21,4,-1.\nMPC,1,99,5,1.,21,5,-1.\nMPC,1,99,6,1.,21,6,-1.\n",
    ):
        found = hertz(converted(tmp_path, beam + far + rigid), 5)
        np.testing.assert_allclose(found, truth, rtol=1e-8)


CORNERS = ((2.0, 1.0), (-1.0, 1.0), (-1.0, -2.0), (1.5, -1.0))
SPRINGS_N_PER_M = (1e4, 2e4, 3e4, 5e4)


def averaged(card, held="12456"):
    """A body at a point that averages four corners, each on a spring along z."""
    text = "BEGIN BULK\nGRID,9,,0.,0.,0.\nCONM2,1,9,,8.\n"
    for k, ((x, y), spring) in enumerate(zip(CORNERS, SPRINGS_N_PER_M, strict=True), 1):
        text += f"GRID,{k},,{x},{y},0.\nCELAS2,{k},{spring},{k},3\n"
    return text + f"{card}\nSPC1,1,12456,1,2,3,4\nSPC1,1,{held},9\nENDDATA\n"


def test_an_interpolation_element_spreads_a_force_and_stiffens_nothing(tmp_path):
    # With the rotations free, a force at the centre splits by the fit of a plane: statics.
    rows = np.array([[1.0, y, -x] for x, y in CORNERS])
    share = np.linalg.solve(rows.T @ rows, rows.T)[0]
    softness = float(np.sum(share**2 / np.array(SPRINGS_N_PER_M)))
    card = "RBE3,7,,9,3,1.0,123,1,2,\n,3,4"
    found = converted(tmp_path, averaged(card))
    np.testing.assert_allclose(hertz(found, 1), np.sqrt(1 / (8.0 * softness)) / (2 * np.pi))
    # Weights count: of one point alone that weighs much, its spring is felt.
    card = "RBE3,7,,9,3,1.0,123,1,2,\n,3,1.0-9,123,4"
    weights = np.array([1.0, 1.0, 1.0, 1e-9])
    share = np.linalg.solve(rows.T * weights @ rows, rows.T * weights)[0]
    softness = float(np.sum(share**2 / np.array(SPRINGS_N_PER_M)))
    found = converted(tmp_path, averaged(card))
    np.testing.assert_allclose(hertz(found, 1), np.sqrt(1 / (8.0 * softness)) / (2 * np.pi))


@pytest.mark.parametrize(
    ("card", "message"),
    [
        (
            "RBE3,7,,9,3,1.0,123456,1,2,\n,3,4",
            "components '123456'. Allowed are positive weights",
        ),
        ("RBE3,7,,9,3,1.0,123,1,2", "do not determine the motion.*RBE2"),
        ("RBE3,7,,9,3,1,123,1,2,\n,3,4", "begins with a point"),
        ("RBE3,7,,9,3,1.0,123,1,2,\n,3,4,UM,1,3", r"dependent components.*\(UM\)"),
    ],
)
def test_an_interpolation_element_that_cannot_be_kept_is_refused(tmp_path, card, message):
    with pytest.raises(MatrixFileError, match=message):
        converted(tmp_path, averaged(card))


def shells(extra=""):
    """A square of 12 by 12 CQUAD4, simply supported on all sides, 2 mm thick."""
    n = 12
    number = {(i, j): i * (n + 1) + j + 1 for i in range(n + 1) for j in range(n + 1)}
    rim = {k: v for k, v in number.items() if {0, n} & set(k)}
    cards = [f"GRID,{v},,{i / n:.9f},{j / n:.9f},0.,,126" for (i, j), v in number.items()]
    for i in range(n):
        for j in range(n):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            at = ",".join(str(number[c]) for c in corners)
            cards.append(f"CQUAD4,{i * n + j + 1},1,{at}")
    cards += [f"SPC1,1,{34 if i in (0, n) else 35},{v}" for (i, j), v in rim.items()]
    return "\n".join(cards) + f"\nPSHELL,1,1,.002,1,,1,,{extra}\n" + STEEL


def test_shells_have_the_frequencies_of_naviers_plate(tmp_path):
    rigidity = 2.1e11 * 0.002**3 / (12 * (1 - 0.3**2))
    exact = np.pi / 2 * np.sqrt(rigidity / (7850.0 * 0.002)) * np.array([2.0, 5.0, 5.0])
    found = converted(tmp_path, shells())
    # Elements of a twelfth: the error of the square of the size is 0.6 % and 2.5 %.
    np.testing.assert_allclose(hertz(found, 3), exact, rtol=0.03)
    heavy = converted(tmp_path, shells("15.7"))
    np.testing.assert_allclose(hertz(heavy, 3), hertz(found, 3) / np.sqrt(2.0), rtol=1e-4)
    with pytest.raises(MatrixFileError, match=r"PSHELL: is not of one material"):
        converted(tmp_path, shells().replace("PSHELL,1,1,.002,1,", "PSHELL,1,1,.002,,"))


def test_an_offset_bar_is_a_bar_between_points_that_follow(tmp_path):
    direct = "GRID,1,,0.,0.,.3\nGRID,2,,2.,0.,.3\n"
    apart = "GRID,1,,0.,0.,0.\nGRID,2,,2.,0.,0.\n"
    rest = "PBAR,1,1,2.-3,8.-7,2.-7,1.-7\n" + STEEL + "SPC1,1,123456,1\n"
    plain = converted(tmp_path, direct + "CBAR,1,1,1,2,0.,1.,0.\n" + rest)
    moved = converted(
        tmp_path,
        apart
        + "CBAR,1,1,1,2,0.,1.,0.\n+,,,0.,0.,.3,0.,0.\n+,.3\n".replace("0.,0.\n+,.3", "0.,0.,.3")
        + rest,
    )
    np.testing.assert_allclose(hertz(moved, 3), hertz(plain, 3), rtol=1e-8)


def test_millimetres_and_inches_give_the_same_frequencies(tmp_path):
    metres = hertz(converted(tmp_path, cantilever("PBAR,1,1,2.-3,8.-7,2.-7,1.-7\n")), 6)
    text = cantilever("PBAR,1,1,2000.,8.+5,2.+5,1.+5\n", length=1000.0)
    text = text.replace(STEEL, "MAT1,1,2.1+5,,.3,7.85-9\n")
    np.testing.assert_allclose(
        hertz(converted(tmp_path, text, unit="mm"), 6), metres, rtol=1e-9
    )
    inch, pound = 0.0254, 4.4482216152605
    mass = pound / inch
    text = cantilever(
        f"PBAR,1,1,{2e-3 / inch**2:.8g},{8e-7 / inch**4:.8g},{2e-7 / inch**4:.8g},"
        f"{1e-7 / inch**4:.8g}\n",
        length=1.0 / inch,
    )
    weight = 7850.0 / mass * inch**3 * 386.0886
    text = text.replace(
        STEEL,
        f"MAT1,1,{2.1e11 / pound * inch**2:.9g},,.3,{weight:.9g}\n"
        f"PARAM,WTMASS,{1 / 386.0886:.9g}\n",
    )
    found = converted(tmp_path, text, unit="in")
    np.testing.assert_allclose(hertz(found, 6), metres, rtol=1e-6)
    assert found.notes[0].startswith("Masses are multiplied by PARAM,WTMASS, 0.00259008")


def test_nonstructural_mass_is_part_of_the_mass_by_length(tmp_path):
    plain = hertz(converted(tmp_path, cantilever("PBAR,1,1,2.-3,8.-7,2.-7,1.-7\n")), 2)
    found = converted(tmp_path, cantilever("PBAR,1,1,2.-3,8.-7,2.-7,1.-7,15.7\n"))
    np.testing.assert_allclose(hertz(found, 2), plain / np.sqrt(2.0), rtol=1e-12)
    assert found.notes == ("Nonstructural mass of PBAR 1 is in the density of its material.",)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("EIGRL", "CTRIA3,7,1,1,2,3\nEIGRL"),
            r"not understood: CTRIA3 \(line 6\).*again with quadrilaterals \(CQUAD4, S4\)",
        ),
        (
            ("SPC1           8", "RBE1,1,,2,123\nGRDSET,,,,,,,6\nSPC1           8"),
            "RBE1.*GRDSET",
        ),
        (("GRID,4,,", "GRID,4,3,"), r"Line 11.*GRID: has positions in the coordinate system 3"),
        (("SPC = 7\n", ""), r"sets 7, 8 of SPC are there.*`SPC = number` before BEGIN BULK"),
        (("CBAR,2,9,2,3,", "CBAR,2,8,2,3,"), r"CBAR: names the property 8.*PBAR, PBARL"),
        (("CBAR,2,9,2,3,", "CBAR,2,9,2,33,"), r"node '33' does not exist.*5 nodes"),
        (("    2.-6\n", "      \n"), r"PBAR: has A=0.0015.*J=0.*small J"),
        (("8.0769+10", "4.0000+10"), r"MAT1: has Poisson's ratio .*Allowed"),
        (("CONM2,1,3,", "CONM2,1,3,4"), "system 4"),
        (("GRID,4,,4.", "GRID,4,,4.x"), r"Line 11 of m.bdf has '4.x'"),
    ],
)
def test_what_cannot_be_kept_is_an_error_that_names_it(tmp_path, change, message):
    assert change[0] in PORTAL
    with pytest.raises(MatrixFileError, match=message):
        converted(tmp_path, PORTAL.replace(*change))


def test_a_mesh_of_another_kind_is_told_where_to_go(tmp_path):
    with pytest.raises(MatrixFileError, match=r"ends in .csv.*slowtime import"):
        converted(tmp_path, "a,b\n", name="record.csv")
    with pytest.raises(MatrixFileError, match=r"no beam, bar, spring or shell.*`matrices`"):
        converted(tmp_path, "GRID,1,,0.,0.,0.\n")


def test_a_hinge_halfway_makes_two_cantilevers_and_two_propped_beams(tmp_path):
    count, length = 20, 20.0
    points = "".join(
        f"GRID,{k + 1},,{length * k / count:.9f},0.,0.,,4\n" for k in range(count + 1)
    )
    bars = "".join(
        f"CBAR,{k},1,{k},{k + 1},0.,1.,0.\n" + ("+,,56\n" if k == count // 2 else "")
        for k in range(1, count + 1)
    )
    inertias = np.array([8e-7, 3e-7])  # bending in the planes x-y and x-z
    text = f"{points}{bars}PBAR,1,1,2.-3,8.-7,3.-7,1.-7\n{STEEL}SPC1,1,123456,1,{count + 1}\n"
    found = hertz(converted(tmp_path, text), 4)
    # Alike in both halves: no moment and no shear at the hinge. Opposite: it does not move.
    roots = np.array([1.8751040687, 3.9266023120, 4.6940911330])
    wave = np.sqrt(2.1e11 * inertias / (7850.0 * 2e-3)) / (length / 2) ** 2
    expected = np.sort(np.outer(roots**2, wave).ravel())[:4] / (2 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_a_bar_that_turns_freely_at_both_ends_is_refused(tmp_path):
    text = cantilever("PBAR,1,1,2.-3,8.-7,2.-7,1.-7\n", count=1).replace(
        "0.,1.,0.", "0.,1.,0.\n+,4,4"
    )
    with pytest.raises(ValueError, match=r"CBAR 1' is a mechanism with its releases"):
        hertz(converted(tmp_path, text), 1)

"""Frames from input of Abaqus and CalculiX, against frequencies that CalculiX 2.20 printed.

CalculiX expands beams and trusses to solids, which are stiffer at a clamped end and have
Poisson's effect held there; the tolerances are of that.
"""

import math
import re
import shutil
import subprocess

import numpy as np
import pytest

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import nominal_modes
from slowtime_services.matrices import MatrixFileError
from slowtime_services.matrices.frame_model import frame_of
from slowtime_services.matrices.meshes import convert_mesh

STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1E11, 0.3\n*DENSITY\n7850.\n"
STEP = "*STEP\n*FREQUENCY\n6\n*END STEP\n"


def cantilever(kind, section, sizes, count=20):
    nodes = "".join(f"{k + 1}, {2.0 * k / count:.12g}, 0, 0\n" for k in range(count + 1))
    step = 2 if kind.startswith("B32") else 1
    elements = "".join(
        f"{j}, " + ", ".join(str(k + 1 + m) for m in range(step + 1)) + "\n"
        for j, k in enumerate(range(0, count, step), 1)
    )
    return (
        f"*HEADING\nCantilever\n*NODE\n{nodes}*ELEMENT, TYPE={kind}, ELSET=BEAM\n{elements}"
        f"{STEEL}*BEAM SECTION, ELSET=BEAM, MATERIAL=STEEL, SECTION={section}\n{sizes}\n"
        f"0., 1., 0.\n*BOUNDARY\n1, 1, 6\n{STEP}"
    )


def truss(bays=6, area=0.04):
    """Three chords; so thick that bending of the bars, which CalculiX has, is fast."""
    nodes, bars = [], []
    for k in range(bays + 1):
        for c in range(3):
            angle = 2 * math.pi * c / 3
            nodes.append((1.0 * k, 0.5 * math.cos(angle), 0.5 * math.sin(angle)))
    for k in range(bays):
        for c in range(3):
            here, ahead, turned = 3 * k + c + 1, 3 * k + c + 4, 3 * k + (c + 1) % 3 + 4
            bars += [(here, ahead), (here, turned), (ahead, turned)]
    return (
        "*NODE\n"
        + "".join(
            f"{i}, {x:.12g}, {y:.12g}, {z:.12g}\n" for i, (x, y, z) in enumerate(nodes, 1)
        )
        + "*ELEMENT, TYPE=T3D2, ELSET=BARS\n"
        + "".join(f"{i}, {a}, {b}\n" for i, (a, b) in enumerate(bars, 1))
        + f"{STEEL}*SOLID SECTION, ELSET=BARS, MATERIAL=STEEL\n{area}\n"
        + f"*BOUNDARY\n1, 1, 3\n2, 1, 3\n3, 1, 3\n{STEP}"
    )


def panel(n=16, thickness=0.02):
    """A clamped square of shells, which CalculiX expands to solids."""
    number = {(i, j): i * (n + 1) + j + 1 for i in range(n + 1) for j in range(n + 1)}
    elements = [
        [number[c] for c in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
        for i in range(n)
        for j in range(n)
    ]
    rim = [str(v) for k, v in number.items() if {0, n} & set(k)]
    return (
        "*NODE\n"
        + "".join(f"{v}, {i / n:.12g}, {j / n:.12g}, 0\n" for (i, j), v in number.items())
        + "*ELEMENT, TYPE=S4, ELSET=SKIN\n"
        + "".join(f"{k}, " + ", ".join(map(str, e)) + "\n" for k, e in enumerate(elements, 1))
        + "*NSET, NSET=RIM\n"
        + ",\n".join(rim)
        + f"\n{STEEL}*SHELL SECTION, ELSET=SKIN, MATERIAL=STEEL\n{thickness}\n"
        + f"*BOUNDARY\nRIM, 1, 6\n{STEP}"
    )


CASES = {
    "panel": (panel(), (179.9184, 368.3758, 368.3758), 0.012),
    "rect31": (cantilever("B31", "RECT", "0.06, 0.10"), (12.53198, 20.86382, 78.56334), 0.006),
    "rect32": (cantilever("B32R", "RECT", "0.06, 0.10"), (12.65339, 20.98453, 79.02478), 0.012),
    "pipe32": (cantilever("B32R", "PIPE", "0.05, 0.006"), (24.22836, 24.22836, 149.7018), 0.02),
    "circ32": (cantilever("B32R", "CIRC", "0.08, 0.08"), (14.69241, 14.69241, 91.63707), 0.02),
    "box32": (
        cantilever("B32R", "BOX", "0.06, 0.1, 0.005, 0.004, 0.005, 0.004"),
        (17.83807, 25.69433, 110.9879),
        0.02,
    ),
    "truss": (truss(), (14.27172, 14.27172, 31.70254, 70.97352, 70.97352), 0.015),
}
"""Input, frequencies that CalculiX printed [Hz], and relative tolerance."""


def converted(tmp_path, text, **more):
    path = tmp_path / "m.inp"
    path.write_text(text)
    return convert_mesh(path, **more)


def hertz(found, count):
    return nominal_modes(assemble(frame_of(found.file.frame)), count).frequency_hz


@pytest.mark.parametrize("name", CASES)
def test_frequencies_are_those_that_calculix_prints(tmp_path, name):
    text, printed, tolerance = CASES[name]
    found = hertz(converted(tmp_path, text), len(printed))
    np.testing.assert_allclose(found, printed, rtol=tolerance)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="calculix-ccx is not installed")
@pytest.mark.parametrize("name", ["rect31", "truss", "panel"])
def test_the_installed_calculix_prints_what_is_kept(tmp_path, name):
    text, kept, _ = CASES[name]
    (tmp_path / "m.inp").write_text(text)
    subprocess.run(["ccx", "m"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    printed = (tmp_path / "m.dat").read_text().split("P A R T")[0]
    rows = re.findall(r"^ +\d+ +\S+ +\S+ +(\S+) +\S+$", printed, re.MULTILINE)
    np.testing.assert_allclose([float(r) for r in rows[: len(kept)]], kept, rtol=1e-5)


def test_a_general_section_has_the_frequencies_of_the_same_rectangle(tmp_path):
    base, height = 0.06, 0.10
    plain = cantilever("B33", "RECT", f"{base}, {height}")
    a, b = base * height**3 / 12, height * base**3 / 12
    shape = 1e-5
    general = re.sub(
        r"\*BEAM SECTION.*\n.*\n.*\n",
        "*BEAM GENERAL SECTION, ELSET=BEAM, SECTION=GENERAL, DENSITY=7850.\n"
        f"{base * height}, {a}, 0., {b}, {shape}\n0., 1., 0.\n2.1E11, 8.0769230769E10\n",
        plain,
    )
    bending = [0, 1, 2, 3]  # torsion is of a constant of its own
    np.testing.assert_allclose(
        hertz(converted(tmp_path, general), 4)[bending],
        hertz(converted(tmp_path, plain), 4)[bending],
        rtol=1e-9,
    )


def test_masses_springs_equations_and_sets_are_read(tmp_path):
    text = (
        "*NODE, NSET=ALL\n1, 0.\n2, 1.\n3, 1.\n"
        "*ELEMENT, TYPE=SPRING2, ELSET=S\n1, 1, 2\n*SPRING, ELSET=S\n1, 1\n4.E4\n"
        "*ELEMENT, TYPE=SPRING1, ELSET=G\n2, 3\n*SPRING, ELSET=G\n1\n5.E4\n"
        "*ELEMENT, TYPE=MASS, ELSET=M\n3, 2\n*MASS, ELSET=M\n10.\n"
        "*NSET, NSET=FREE, GENERATE\n2, 3, 1\n*BOUNDARY\n1, ENCASTRE\nFREE, 2, 6\n"
        "*EQUATION\n2\n3, 1, 1., 2, 1, -2.\n" + STEP
    )
    # Node 3 moves twice as far as node 2, so that its spring counts four times.
    found = hertz(converted(tmp_path, text), 1)[0]
    assert found == pytest.approx(np.sqrt((4e4 + 4 * 5e4) / 10.0) / (2 * np.pi))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("*BOUNDARY", "*MPC\nBEAM, 1, 2\n*RIGID BODY, NSET=X\n*BOUNDARY"),
            r"\*MPC.*\*RIGID BODY.*Couplings: write them as \*EQUATION",
        ),
        (
            ("*NODE", "*PART, NAME=MAST\n*NODE"),
            r"\*PART \(line \d+\).*write the input flat",
        ),
        (("TYPE=B31", "TYPE=S3R"), r"TYPE=S3R.*mesh again with quadrilaterals"),
        (("TYPE=B31", "TYPE=C3D8"), r"not understood: \*ELEMENT, TYPE=C3D8 \(line 25\)"),
        (("SECTION=RECT", "SECTION=TRAPEZOID"), r"SECTION=TRAPEZOID with 2 sizes.*RECT"),
        (("NAME=STEEL", "NAME=IRON"), r"names the material STEEL"),
        (("ELSET=BEAM, MATERIAL", "ELSET=BEAN, MATERIAL"), r"set 'BEAN'. Allowed are BEAM"),
        (("1, 1, 6\n", "1, XASYMM\n"), r"holds 'XASYMM'. Allowed are directions 1 to 6"),
        (("1, 1, 6\n", "1, 1, 1, 0.2\n"), r"prescribes a displacement"),
        (("*FREQUENCY", "*MODEL CHANGE\n*FREQUENCY"), r"\*MODEL CHANGE \(line"),
        (("1, 1, 2\n", "1, 1, 200\n"), r"node '200' does not exist"),
        (("2.1E11, 0.3", "2.1E11, x"), r"Line \d+ of m.inp, \*ELASTIC: line \d+ is not a list"),
    ],
)
def test_what_cannot_be_kept_is_an_error_that_names_it(tmp_path, change, message):
    text = CASES["rect31"][0]
    assert change[0] in text
    with pytest.raises(MatrixFileError, match=message):
        converted(tmp_path, text.replace(change[0], change[1], 1))


def test_an_element_without_a_section_is_named(tmp_path):
    text = re.sub(r"\*BEAM SECTION.*\n.*\n.*\n", "", CASES["rect31"][0])
    with pytest.raises(MatrixFileError, match=r"element 1 of type B31 has no section"):
        converted(tmp_path, text)


def test_a_released_end_is_a_hinge_about_the_axes_that_are_named(tmp_path):
    # A cantilever whose foot is released about n1 is a mechanism in one plane only: the other
    # keeps its frequency. The second node holds it, so that a propped beam is left.
    text = cantilever("B33", "RECT", "0.06, 0.10").replace(
        "*BOUNDARY\n1, 1, 6\n", "*RELEASE\n1, S1, M1\n*BOUNDARY\n1, 1, 6\n21, 1, 4\n"
    )
    both = hertz(converted(tmp_path, text), 2)
    width, height, length = 0.06, 0.10, 2.0  # along n1, which is y, and n2, which is z
    speed = np.sqrt(2.1e11 / 7850.0) / (2 * np.pi * length**2)
    # Bending about n1 is in the x-z plane: pinned and pinned there, clamped and pinned across.
    expected = [
        np.pi**2 * speed * height / np.sqrt(12),
        3.9266023120**2 * speed * width / np.sqrt(12),
    ]
    np.testing.assert_allclose(both, np.sort(expected), rtol=2e-3)


@pytest.mark.parametrize("line", ["1, S3, M1", "1, S1, M3", "1, S1"])
def test_a_release_that_is_not_understood_says_what_is_allowed(tmp_path, line):
    text = cantilever("B33", "RECT", "0.06, 0.10").replace(
        "*BOUNDARY", f"*RELEASE\n{line}\n*BOUNDARY"
    )
    with pytest.raises(MatrixFileError, match=r"ends S1, S2 and the moments M1, M2, T"):
        converted(tmp_path, text)

"""Matrices of a portal frame in space, by OpenSeesPy: `python portal.py [COLUMNS GIRDER]`.

Factors on the moduli: 1 and 1 for K.out and M.out, 0.9 and 1 for columns.out, 1 and 0.9 for
girder.out. The files beside this one were written by version 3.7.1.
"""

import sys

import numpy as np
import openseespy.opensees as ops

COLUMNS, GIRDER = (float(word) for word in (*sys.argv[1:], "1", "1")[:2])
NODES = [(0, 0, 0), (0, 0, 3), (2, 0, 3), (4, 0, 3), (4, 0, 0)]
YOUNG, SHEAR = 2.1e11, 8.0769e10
AREA, TORSION, INERTIA_Y, INERTIA_Z = 1.5e-3, 2.0e-6, 1.2e-6, 1.6e-6

ops.wipe()
ops.model("basic", "-ndm", 3, "-ndf", 6)
for tag, place in enumerate(NODES, 1):
    ops.node(tag, *map(float, place))
ops.fix(1, 1, 1, 1, 1, 1, 1)
ops.fix(5, 1, 1, 1, 1, 1, 1)
ops.geomTransf("Linear", 1, 0.0, 1.0, 0.0)
for tag in range(1, 5):
    f = COLUMNS if tag in (1, 4) else GIRDER
    ops.element(
        "elasticBeamColumn", tag, tag, tag + 1, AREA, f * YOUNG, f * SHEAR, TORSION, INERTIA_Y,
        INERTIA_Z, 1, "-mass", 7850 * AREA, "-cMass",
    )  # fmt: skip
ops.mass(3, 50.0, 50.0, 50.0, 0.0, 0.0, 0.0)

squares = ops.eigen("-fullGenLapack", 6)
np.savetxt("frequencies.txt", np.sqrt(squares) / (2 * np.pi), fmt="%.10g")

ops.wipeAnalysis()
ops.constraints("Plain")
ops.numberer("Plain")
ops.system("FullGeneral")
ops.algorithm("Linear")
ops.analysis("Transient")
for name, (m, c, k) in {"K": (0.0, 0.0, 1.0), "M": (1.0, 0.0, 0.0)}.items():
    ops.integrator("GimmeMCK", m, c, k)
    ops.analysis("Transient", "-noWarnings")
    ops.analyze(1, 0.0)
    size = ops.systemSize()
    # `printA -file` writes six digits, too few for the sway of a frame of stiff bars.
    matrix = np.array(ops.printA("-ret")).reshape(size, size)
    np.savetxt(f"{name}.out", matrix, fmt="%.17g")

rows = sorted(
    (equation, node, direction, *ops.nodeCoord(node))
    for node in ops.getNodeTags()
    for direction, equation in enumerate(ops.nodeDOFs(node), 1)
    if equation >= 0
)
with open("dofs.csv", "w", encoding="utf-8") as file:
    file.write("node,direction,x,y,z\n")
    for _, *row in rows:
        file.write(",".join(map(str, row)) + "\n")

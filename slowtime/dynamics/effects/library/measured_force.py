r"""Force surfaces that were estimated from records, where no law with a name explains them.

With :math:`x = e/e_0`, :math:`y = v/v_0`, both held to [−1, 1], a direction
:math:`s = \tanh(10 y)` and a memory :math:`\dot w = (v - |v| w) / x_0` (Dahl), the force is a
polynomial in them. Beyond the measured range it keeps its value at the edge.
"""

import math
from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Parameter


def surface(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of the surface [N]."""
    x = min(max(e / p[1], -1.0), 1.0)
    y = min(max(v / p[2], -1.0), 1.0)
    s = math.tanh(10.0 * y)
    w = z[0]
    return float(
        p[3] * x * x
        + p[4] * x * x * x
        + p[5] * x * x * x * x
        + p[6] * x * x * x * x * x
        + p[7] * s
        + p[8] * x * s
        + p[9] * x * x * s
        + p[10] * y * abs(y)
        + p[11] * y * y * y
        + p[12] * x * y
        + p[13] * x * x * y
        + p[14] * w
        + p[15] * x * w
        + p[16] * x * x * w
    )


def memory(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the memory of the path [1/s]."""
    return float((v - abs(v) * z[0]) / p[0])


TERMS = (
    ("x2_n", "x²"), ("x3_n", "x³"), ("x4_n", "x⁴"), ("x5_n", "x⁵"),
    ("s_n", "s"), ("xs_n", "x s"), ("x2s_n", "x² s"),
    ("yy_n", "|y| y"), ("y3_n", "y³"), ("xy_n", "x y"), ("x2y_n", "x² y"),
    ("w_n", "w"), ("xw_n", "x w"), ("x2w_n", "x² w"),
)  # fmt: skip
"""Names of the coefficients [N], and the term that each stands before."""


KINDS = (
    Kind(
        name="measured_force",
        title="Measured force surface",
        family="measured force",
        where="element",
        parameters=(
            Parameter(
                name="memory_m",
                unit="m",
                meaning="path over which memory fades",
                low=0.0,
                nonzero=True,
                fitted=False,
            ),
            Parameter(
                name="e0_m",
                unit="m",
                meaning="largest elongation that was measured",
                low=0.0,
                nonzero=True,
                fitted=False,
            ),
            Parameter(
                name="v0_m_per_s",
                unit="m/s",
                meaning="largest rate that was measured",
                low=0.0,
                nonzero=True,
                fitted=False,
            ),
            *(
                Parameter(name=name, unit="N", meaning=f"coefficient of {term}", default=0.0)
                for name, term in TERMS
            ),
        ),
        equation="polynomial in x = e/e0, y = v/v0, s = tanh(10 y) and a memory w; "
        "constant beyond |x| = 1, |y| = 1",
        source="restoring-force surfaces: Masri and Caughey 1979; memory: Dahl 1968",
        sentence="The force as these records show it, without a law that has a name.",
        action=Law(force=surface, rates=(memory,)),
        is_surface=True,
    ),
)

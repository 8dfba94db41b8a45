"""A module of effects of one's own, each wrong in its own way, as text to install."""

EFFECTS = '''
import math, os, sys, time

import numpy as np

from slowtime.dynamics.effects import Kind, Law, Parameter


def softening(e, v, t, z, p):
    return p[0] * e / (1.0 + abs(e) / p[1])


def not_a_number(e, v, t, z, p):
    return math.sqrt(-1.0 - abs(e)) * p[0] / p[1]


def endless(e, v, t, z, p):
    total = 0.0
    for i in range(10**15):
        total += math.sin(i * e)
    return p[0] * total / p[1]


def shapes(motion):
    largest = max(float(np.max(np.abs(motion.e))), 1e-12)
    return [{"d_m": float(d)} for d in np.geomspace(0.1 * largest, 3 * largest, 4)]


def raises(motion):
    raise RuntimeError("no such luck")


def strange(motion):
    return [{"nowhere": 1.0}]


def prints(motion):
    print("nonsense" * 10_000)
    os.write(1, b"\\xff" * 10_000)
    return shapes(motion)


def raises_later(motion):
    """Well-behaved in a trial, whose motion has 512 samples."""
    return shapes(motion) if len(motion.e) == 512 else raises(motion)


def hangs_later(motion):
    if len(motion.e) != 512:
        time.sleep(3600)
    return shapes(motion)


def ends_later(motion):
    if len(motion.e) != 512:
        os._exit(7)
    return shapes(motion)


def kind(name, law=softening, shapes=shapes):
    return Kind(
        name=name,
        family="elasticity",
        where="element",
        parameters=(
            Parameter(name="k_n_per_m", unit="N/m", meaning="its stiffness", low=0.0),
            Parameter(name="d_m", unit="m", meaning="half is left", low=0.0, nonzero=True),
        ),
        equation="k e / (1 + |e| / d)",
        source="a test",
        sentence="The element gives way.",
        action=Law(force=law),
        strength="k_n_per_m",
        scales=("d_m",),
        shapes=shapes,
    )


GOOD = kind("softening_spring")
PRINTS = kind("printing_spring", shapes=prints)
NAN = kind("nan_spring", not_a_number)
ENDLESS = kind("endless_spring", endless)
RAISES = kind("raising_spring", shapes=raises)
STRANGE = kind("strange_spring", shapes=strange)
RAISES_LATER = kind("later_spring", shapes=raises_later)
HANGS_LATER = kind("later_spring", shapes=hangs_later)
ENDS_LATER = kind("later_spring", shapes=ends_later)
'''

"""Frames that several tests share."""

import numpy as np

from slowtime.finite_elements.frame import Beam, Frame, Parameter, Support
from slowtime.finite_elements.sections import Material, Section, rectangle

STEEL = Material(young_pa=2.1e11, poisson=0.3, density_kg_m3=7850.0)
FLAT = rectangle(0.05, 0.08)


def line_of_beams(
    number: int,
    length: float = 2.0,
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0),
    section: Section = FLAT,
    **changes,
) -> Frame:
    """A straight beam of equal elements, each a parameter; clamped at node 0 unless told."""
    along = np.array(direction) / np.linalg.norm(direction)
    names = tuple(str(i) for i in range(number + 1))
    settings = {"theory": "euler"} | {
        key: changes.pop(key) for key in ("theory", "orientation") if key in changes
    }
    beams = tuple(
        Beam(
            name=f"b{i}",
            ends=(names[i], names[i + 1]),
            section=section,
            material=STEEL,
            group=f"g{i}",
            **settings,
        )
        for i in range(number)
    )
    return Frame(
        node_names=names,
        coordinates=np.linspace(0, length, number + 1)[:, None] * along,
        beams=beams,
        **{
            "supports": (Support(node="0"),),
            "parameters": tuple(
                Parameter(name=f"p{i}", groups=(f"g{i}",)) for i in range(number)
            ),
        }
        | changes,
    )


def small_tower(storeys: int = 6) -> Frame:
    """A square tower of beams: legs, rings and braces, one parameter a storey."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float) * 3.0
    names, coordinates, beams = [], [], []
    for level in range(storeys + 1):
        for c, corner in enumerate(corners):
            names.append(f"{level}.{c}")
            coordinates.append([*corner, 4.0 * level])
    leg, brace = rectangle(0.2, 0.2), rectangle(0.1, 0.12)
    for level in range(storeys):
        for c in range(4):
            low, high = f"{level}.{c}", f"{level + 1}.{c}"
            turn = f"{level + 1}.{(c + 1) % 4}"
            for kind, ends, section in (
                ("leg", (low, high), leg),
                ("ring", (high, turn), brace),
                ("brace", (low, turn), brace),
            ):
                beams.append(
                    Beam(
                        name=f"{kind} {level}.{c}",
                        ends=ends,
                        section=section,
                        material=STEEL,
                        group=f"storey {level + 1}",
                    )
                )
    return Frame(
        node_names=tuple(names),
        coordinates=np.array(coordinates),
        beams=tuple(beams),
        supports=tuple(Support(node=f"0.{c}") for c in range(4)),
        parameters=tuple(
            Parameter(name=f"storey {s + 1}", groups=(f"storey {s + 1}",))
            for s in range(storeys)
        ),
    )

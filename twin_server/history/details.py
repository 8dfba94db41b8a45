"""Details of the states of twins of elements, kept and rendered as JSON text.

The text is the part of the message `TwinState` that such a twin has and others have not, as
JSON; it is written once, by estimation, and copied from then on.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from pydantic_core import from_json, to_json

ASSESSMENT = "assessment"
"""Key of the latest comparison of the members with the reference."""


class Detail(NamedTuple):
    """Details of one state.

    Parameters
    ----------
    changes
        Value, lo and hi of each parameter as they lie in memory, float64; for drawing.
    body
        A JSON object: elements, posterior_to_prior, suspects, channels, modes, truth; and
        assessment where one is asked for.
    """

    changes: bytes
    body: bytes


Bodies: TypeAlias = Sequence[bytes | None]
"""Body of each of some states; empty where none of them has any."""


def without_shapes(body: bytes) -> bytes:
    """Leave out the shapes of the modes, which are most of it.

    Examples
    --------
    >>> without_shapes(b'{"modes":[{"kind":"structural","shape":{"re":[1.0]}}]}')
    b'{"modes":[{"kind":"structural","shape":null}]}'
    """
    content = from_json(body)
    for mode in content["modes"]:
        mode["shape"] = None
    return to_json(content)


def without_assessment(body: bytes) -> bytes:
    """Leave out the assessment of the members, which messages do not have.

    Examples
    --------
    >>> without_assessment(b'{"suspects":["c1"],"assessment":{"verdict":"changed"}}')
    b'{"suspects":["c1"]}'
    """
    if f'"{ASSESSMENT}"'.encode() not in body:
        return body
    content = from_json(body)
    content.pop(ASSESSMENT, None)
    return to_json(content)


def part(bodies: Bodies, rows: slice) -> Bodies:
    """Keep some of them."""
    return bodies[rows] if bodies else ()

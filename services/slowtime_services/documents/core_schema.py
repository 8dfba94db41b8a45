"""Loader and dumper of YAML by the core schema of YAML 1.2, whose numbers are those of JSON.

PyYAML follows YAML 1.1 of 2005: there ``4.0e7`` and ``1e3`` are text (an exponent needs a
sign), ``010`` is 8, ``1:30`` is 90, ``1_000`` is 1000, ``no`` is false and ``2024-01-01`` a
date. By the core schema the first two are numbers, ``010`` is 10, and the others are text.

References
----------
.. [1] YAML Ain't Markup Language, version 1.2.2 (2021), section 10.3.2, "Tag resolution".
"""

import re
from typing import Any

import yaml

from .numbers import finite_number, whole_number

NULL = re.compile(r"~|null|Null|NULL|")
TRUTH = re.compile(r"true|True|TRUE|false|False|FALSE")
WHOLE = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
REAL = re.compile(
    r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
)
RESOLVED = (
    ("tag:yaml.org,2002:null", NULL, ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:bool", TRUTH, list("tTfF")),
    ("tag:yaml.org,2002:int", WHOLE, list("-+0123456789")),
    ("tag:yaml.org,2002:float", REAL, list("-+.0123456789")),
)
"""Tags of plain scalars: the first whose whole pattern fits; text where none does."""


class CoreLoader(yaml.SafeLoader):  # type: ignore[misc]  # yaml is untyped
    """Reads plain values, with the numbers and truth values of the core schema."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


class FastCoreLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Reads the same by LibYAML, where PyYAML was built with it: ten times faster."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


class CoreDumper(yaml.SafeDumper):  # type: ignore[misc]  # yaml is untyped
    """Writes plain values, and in quotes each text that `CoreLoader` would read as a number."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


def real_number(text: str) -> float:
    """Read a floating-point number of the core schema.

    Raises
    ------
    OverflowError
        Where it is more than a floating-point number holds.

    Examples
    --------
    >>> [real_number(text) for text in ("4.0e7", "1.e-3", "+.5", "-.inf")]
    [40000000.0, 0.001, 0.5, -inf]
    """
    return finite_number(re.sub(r"\.(?=inf|nan)", "", text, flags=re.IGNORECASE))


def _scalar(pattern: re.Pattern[str], read: Any) -> Any:
    def construct(loader: Any, node: yaml.ScalarNode) -> Any:
        text = loader.construct_scalar(node)
        if not pattern.fullmatch(text):  # under an explicit tag, such as !!int
            raise ValueError(f"{text[:40]!r} is not a number of YAML 1.2")
        return read(text)

    return construct


for _class in (CoreLoader, FastCoreLoader, CoreDumper):
    for _tag, _pattern, _first in RESOLVED:
        # PyYAML calls match(), which does not ask for the whole.
        _class.add_implicit_resolver(_tag, re.compile(f"(?:{_pattern.pattern})$(?!\n)"), _first)
for _class in (CoreLoader, FastCoreLoader):
    _class.add_constructor("tag:yaml.org,2002:int", _scalar(WHOLE, whole_number))
    _class.add_constructor("tag:yaml.org,2002:float", _scalar(REAL, real_number))

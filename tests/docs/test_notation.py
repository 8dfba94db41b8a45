import dataclasses
import importlib
import inspect
import re
import typing
from pathlib import Path

import pydantic
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime_schemas.messages import Features, TwinState

PAGE = Path(__file__).parents[2] / "docs/notation.md"

UNITS = {
    "_kg": "kg",
    "_n_s_per_m": "N s/m",
    "_n_per_m": "N/m",
    "_hz": "Hz",
    "_ns": "ns",
    "_db": "dB",
    "_ratio": "1",
    "_change": "1",
}


def rows():
    """Cells of every row of every table: symbol, what, code names, unit, place in the book."""
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    return [row for row in cells if row[0] != "symbol" and not row[0].startswith("---")]


NAMES = [(name, row[3]) for row in rows() for name in re.findall(r"`([^`]+)`", row[2])]


def member(owner, name):
    """Give attribute or field `name` of `owner`; a field without default is its own proof."""
    if isinstance(owner, type):
        if issubclass(owner, pydantic.BaseModel) and name in owner.model_fields:
            return owner.model_fields[name]
        if dataclasses.is_dataclass(owner):
            fields = {field.name: field for field in dataclasses.fields(owner)}
            if name in fields:
                return fields[name]
    return getattr(owner, name)


def resolve(name):
    """What a dotted name means, with the module as long as possible."""
    path, _, parameter = name.rstrip(")").partition("(")
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: typing.Any = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = member(found, part)
        return inspect.signature(found).parameters[parameter] if parameter else found
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize("name", sorted({name for name, _ in NAMES}))
def test_every_name_in_the_table_means_something_in_code(name):
    assert resolve(name) is not None


@pytest.mark.parametrize(
    "name",
    [
        "slowtime.dynamics.nowhere",
        "slowtime.dynamics.sdof.oscillator.Oscillator.mass_lb",
        "slowtime.dynamics.evolution_functions.mass_change(nowhere)",
        "slowtime_schemas.messages.Features.nowhere",
    ],
)
def test_a_name_that_means_nothing_is_noticed(name):
    with pytest.raises((AttributeError, KeyError, ModuleNotFoundError)):
        resolve(name)


def test_the_unit_at_the_end_of_a_name_is_the_unit_in_the_table():
    ends = {
        (name, unit, suffix)
        for name, unit in NAMES
        for suffix in UNITS
        if name.rstrip(")").endswith(suffix)
    }
    assert len(ends) > 20
    assert [(name, unit) for name, unit, end in sorted(ends) if unit != UNITS[end]] == []


def test_every_row_has_five_cells_a_code_name_and_a_place():
    for row in rows():
        assert len(row) == 5
        assert row[1]
        assert "`" in row[2]
        assert re.fullmatch(r"—|[1-9](\.\d+){1,2}(, [1-9]\.\d+)*", row[4]), row


def leaves(annotation):
    """Types and nested models at the ends of an annotation."""
    inner = typing.get_args(annotation)
    if typing.get_origin(annotation) is typing.Literal:
        return {str}
    return set().union(*map(leaves, inner)) if inner else {annotation}


def quantities(model):
    """Fields of a message, and of what it holds, that carry numbers."""
    for name, field in model.model_fields.items():
        ends = leaves(field.annotation)
        models = {end for end in ends if isinstance(end, type)}
        nested = {end for end in models if issubclass(end, pydantic.BaseModel)}
        if ends & {int, float} or nested:
            owner = next(base for base in reversed(model.__mro__) if declares(base, name))
            yield f"{owner.__module__}.{owner.__name__}.{name}"
        for inner in nested:
            yield from quantities(inner)


def declares(base, name):
    """Whether a class itself, not one below it, declares a field."""
    return issubclass(base, pydantic.BaseModel) and name in base.model_fields


@pytest.mark.parametrize("message", [Features, TwinState])
def test_every_number_that_travels_is_in_the_table(message):
    carried = set(quantities(message))
    assert len(carried) > 8
    assert carried - {name for name, _ in NAMES} == set()


def test_everything_an_oscillator_is_is_in_the_table():
    named = {name for name, _ in NAMES}
    public = {name for name in vars(Oscillator) if not name.startswith("_")} - {"from_modal"}
    where = "slowtime.dynamics.sdof.oscillator.Oscillator."
    assert {name for name in public if where + name not in named} == set()

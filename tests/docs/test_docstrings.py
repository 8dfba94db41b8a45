"""Docstrings of the public Python interface: parameters, returns, units (numpydoc)."""

import inspect
import re

import pytest
from numpydoc.docscrape import FunctionDoc
from numpydoc.validate import validate

import slowtime as st

CHECKED = {"GL08", "SS01", "PR01", "PR02", "PR07", "RT01", "YD01"}
"""Errors of numpydoc: no docstring or summary; a parameter that is missing, unknown or without
description; no Returns or Yields."""
UNITS = {
    "_hz": "Hz", "_s": "s", "_kg": "kg", "_n_per_m": "N/m", "_n_s_per_m": "N s/m", "_m": "m",
    "_n_m2": "N m^2", "_kg_per_m": "kg/m", "_ratio": "1", "_damping": "1",
}  # fmt: skip
"""End of a name → unit that its description states."""


def functions():
    """Public functions, constructors and methods, by name, with what holds their docstring."""
    for name in st.__all__:
        one = getattr(st, name)
        if not callable(one) or one.__module__.startswith("slowtime_services"):
            continue
        yield name, one
        if inspect.isclass(one):
            for member, value in vars(one).items():
                function = getattr(value, "__func__", value)
                deprecated = hasattr(function, "__deprecated__")
                if (
                    not member.startswith("_")
                    and inspect.isfunction(function)
                    and not deprecated
                ):
                    yield f"{name}.{member}", function


FUNCTIONS = dict(functions())


def unit_of(name: str) -> str | None:
    found = re.search(r"_(n_s_per_m|n_per_m|kg_per_m|n_m2|hz|kg|ratio|damping|s|m)$", name)
    return UNITS.get(f"_{found[1]}") if found else None


def described(function) -> dict[str, str]:
    """Description of each parameter; several may share one."""
    return {
        name.strip(): " ".join(parameter.desc)
        for parameter in FunctionDoc(function, doc=inspect.getdoc(function))["Parameters"]
        for name in parameter.name.split(",")
    }


def test_there_are_functions():
    assert {"read", "Model.chain", "Twin.update", "Signals.psd"} <= set(FUNCTIONS)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_documents_parameters_and_returns(name):
    one = FUNCTIONS[name]
    found = validate(f"{one.__module__}.{one.__qualname__}")
    wrong = [error for error in found["errors"] if error[0] in CHECKED]
    assert wrong == []


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_physical_parameter_states_its_unit(name):
    one = FUNCTIONS[name]
    told = described(one)
    missing = [
        f"{parameter} [{unit}]"
        for parameter in inspect.signature(one).parameters
        if (unit := unit_of(parameter)) is not None
        and f"[{unit}]" not in told.get(parameter, "")
    ]
    assert missing == []


@pytest.mark.parametrize(
    ("name", "unit"),
    [("rate_hz", "Hz"), ("masses_kg", "kg"), ("dampings_n_s_per_m", "N s/m"), ("path", None)],
)
def test_the_unit_of_a_name_is_its_end(name, unit):
    assert unit_of(name) == unit

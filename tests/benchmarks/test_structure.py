"""Structure of the diagnosis: the figures of `benchmarks.structure`, held to limits."""

import ast

import pytest

from benchmarks import structure
from benchmarks.structure import StructureLimits, measure, violations

LIMITS = StructureLimits(modules=15, lines=60, parameters=8, cycles=0, sourced_share=1.0)


@pytest.fixture(scope="module")
def diagnosis():
    return measure("slowtime.discrepancy")


@pytest.mark.gate
@pytest.mark.parametrize("package", ["slowtime.discrepancy", "slowtime.history_diagnosis"])
def test_both_diagnoses_keep_within_the_limits(package):
    assert violations(measure(package), LIMITS) == []


@pytest.mark.parametrize("package", ["slowtime.discrepancy", "slowtime.history_diagnosis"])
def test_every_constant_of_both_diagnoses_states_unit_and_source(package):
    constants = measure(package).constants
    assert constants
    assert [name for name, stated in constants.items() if not stated] == []


def test_a_package_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match=r"There is no package 'slowtime\.nowhere'"):
        measure("slowtime.nowhere")


def test_a_limit_that_is_exceeded_is_told(diagnosis):
    strict = StructureLimits(modules=1, lines=1, parameters=1, sourced_share=1.1)
    told = " ".join(violations(diagnosis, strict))
    for word in ("modules", "lines", "parameters", "state unit and source"):
        assert word in told


def test_check_exits_with_1_beyond_a_limit_only(capsys):
    assert structure.main(["slowtime.discrepancy.data", "--check"]) == 0
    assert structure.main(["slowtime.discrepancy.data", "--check", "--lines", "2"]) == 1
    assert structure.main(["slowtime.discrepancy.data", "--lines", "2"]) == 0
    assert "at most 2 are allowed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("source", "stated"),
    [
        ('A = 1.0\n"""[s] Wait. Source: a clock."""', {"A": True}),
        ('A = 1.0\n"""Wait. Source: a clock."""', {"A": False}),
        ('A = 1.0\n"""[s] Wait."""', {"A": False}),
        ('A, B = 1.0, 2\n"""[s] Wait. Source: a clock."""', {"A": False, "B": False}),
        ("A = 2**-3", {"A": False}),
        ("A = True\nB = 'x'\nC = f(1)", {}),
        (
            "@dataclasses.dataclass(frozen=True)\nclass T:\n    a: float = 1.0\n"
            '    """[1] Share. Source: a book."""\n    b: int = 2',
            {"T.a": True, "T.b": False},
        ),
        ("class T:\n    a: float = 1.0", {}),
    ],
)
def test_a_constant_is_documented_by_a_unit_and_a_source_of_its_own(source, stated):
    assert dict(structure._constants(ast.parse(source))) == stated


def test_lines_leave_out_the_docstring_and_parameters_self():
    (function,) = ast.parse(
        'def f(self, a, *, b=1, **c):\n    """One.\n\n    Two.\n    """\n    return a'
    ).body
    assert isinstance(function, ast.FunctionDef)
    assert structure._body_lines(function) == 2
    assert structure._parameters(function) == 3


def test_cycles_are_found_and_floors_counted():
    acyclic = {"p.a": {"p.b"}, "p.b": {"p.c"}, "p.c": set()}
    assert structure._cycles(acyclic, ["p"]) == []
    assert structure._floors(structure._between_children("p", acyclic)) == 3
    cyclic = {**acyclic, "p.c": {"p.a"}}
    assert structure._cycles(cyclic, ["p"]) == [("p.a", "p.b", "p.c")]

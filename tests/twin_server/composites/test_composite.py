"""Composites: what may be registered, what a tree of twins is made of, and what is refused."""

from typing import Any

import pytest
from pydantic import ValidationError

from slowtime.reliability.trees import CommonCause, members
from twin_server.composites.composite import EXAMPLE, Composite
from twin_server.composites.hierarchy import (
    WrongCompositeError,
    above,
    below,
    check,
    groups_of,
    memberships,
    tree_of,
    twins_of,
)

PAIR = {"members": ["lab.a", "lab.b"]}
TWINS = {f"lab.t{i}" for i in range(20)}


def depends(kind, one, other):
    return {"members": [f"lab.t{one}", f"lab.t{other}"], kind: 0.1}


def composite(*names, **more):
    return Composite(members=names, **more)


def registered(**wanted):
    """Register composites one after the other, each checked against those before."""
    found: dict[str, Composite] = {}
    for name, one in wanted.items():
        check(f"lab.{name}", one, found, TWINS.__contains__)
        found[f"lab.{name}"] = one
    return found


LINE = composite(
    "lab.t1",
    "lab.t2",
    "lab.t3",
    kind="line",
    tree={"k": 2, "of": ["lab.t1", "lab.t2", "lab.t3"]},
)
SITE = composite(
    "lab.line",
    "lab.t1",
    "lab.t4",
    tree={"series": ["lab.t4", {"parallel": ["lab.line", "lab.t1"]}]},
)


def test_a_registration_survives_being_written_and_read():
    one = Composite.model_validate(EXAMPLE)
    assert Composite.from_json(one.to_json()) == one
    assert Composite.model_validate(one.to_dict()) == one


def test_the_tree_of_a_site_has_the_trees_of_its_composites_in_their_places():
    known = registered(line=LINE, site=SITE)
    assert members(tree_of("lab.site", known)) == ("lab.t4", "lab.t1", "lab.t2", "lab.t3")
    assert twins_of("lab.site", known) == ["lab.t1", "lab.t4", "lab.t2", "lab.t3"]
    assert below("lab.site", known) == ["lab.line"]
    assert memberships("lab.t2", known) == ["lab.line"]
    assert above("lab.t2", known) == ["lab.line", "lab.site"]


def test_dependence_of_a_composite_holds_in_what_contains_it():
    pair = ("lab.t1", "lab.t2")
    line = LINE.model_copy(
        update={
            "dependence": composite(
                *pair, dependence=[{"members": pair, "beta": 0.2}]
            ).dependence
        }
    )
    known = registered(line=line, site=SITE)
    assert groups_of("lab.site", known) == (CommonCause(pair, 0.2),)


@pytest.mark.parametrize(
    ("name", "wanted", "says"),
    [
        ("lab.t1", composite("lab.t2"), "lab.t1 is a twin already"),
        ("lab.x", composite("lab.nobody"), "lab.nobody is neither a twin nor a composite"),
        ("lab.x", composite("lab.x"), "cannot contain itself: lab.x → lab.x"),
        ("lab.line", composite("lab.site"), "lab.line → lab.site → lab.line"),
        (
            "lab.x",
            composite("lab.t1", "lab.t2", dependence=[depends("rho", 1, 9)]),
            "`dependence` names lab.t9, not a twin in the tree",
        ),
        (
            "lab.x",
            composite(
                "lab.t1",
                "lab.t2",
                "lab.t3",
                dependence=[depends("rho", 1, 2), depends("beta", 2, 3)],
            ),
            "'lab.t2' is in two groups",
        ),
        (
            "lab.x",
            composite(
                "lab.line", failing={"lab.line": {"quantity": "stiffness_change", "at": -0.1}}
            ),
            "`failing` names lab.line",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_what_to_change(name, wanted, says):
    known = registered(line=LINE, site=SITE)
    with pytest.raises(WrongCompositeError, match=says):
        check(name, wanted, known, TWINS.__contains__)


def test_a_change_below_that_would_break_what_is_above_is_refused():
    known = registered(
        line=LINE,
        site=SITE.model_copy(
            update={
                "dependence": composite(
                    "lab.t1",
                    "lab.t4",
                    dependence=[{"members": ["lab.t1", "lab.t4"], "rho": 0.2}],
                ).dependence
            }
        ),
    )
    line = composite(
        "lab.t1", "lab.t2", dependence=[{"members": ["lab.t1", "lab.t2"], "rho": 0.2}]
    )
    with pytest.raises(WrongCompositeError, match=r"In lab.site: 'lab.t1' is in two groups"):
        check("lab.line", line, known, TWINS.__contains__)


def test_trees_that_double_at_each_level_are_counted_before_they_are_made():
    known: dict[str, Composite] = {}
    for level in range(14):
        name = f"lab.l{level}"
        below_it = ("lab.t1", "lab.t2") if level == 0 else (f"lab.l{level - 1}", "lab.t1")
        one = composite(
            *below_it, tree={"series": [below_it[0], {"parallel": [below_it[0], below_it[1]]}]}
        )
        if level < 11:
            check(name, one, known, TWINS.__contains__)
        known[name] = one
    with pytest.raises(WrongCompositeError, match="Allowed: 4,096"):
        check("lab.l13", known["lab.l13"], known, TWINS.__contains__)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"members": []}, "at least 1"),
        ({"members": ["lab.a", "lab.a"]}, "names one twice"),
        ({"members": ["Lab.A"]}, "pattern"),
        (
            {"members": ["lab.a"], "tree": {"series": ["lab.b"]}},
            "`tree` names lab.b, not among",
        ),
        (
            {"members": ["lab.a"], "tree": {"series": ["lab.a"], "parallel": ["lab.a"]}},
            "Give one of them",
        ),
        ({"members": ["lab.a"], "tree": {"k": 2, "of": ["lab.a"]}}, "k=2 of 1 inputs"),
        ({**PAIR, "dependence": [PAIR]}, "either beta"),
        ({**PAIR, "dependence": [{**PAIR, "rho": -0.1}]}, "greater than or equal to 0"),
        ({"members": ["lab.a"], "alike": ["lab.b"]}, "`alike` names lab.b"),
    ],
)
def test_a_registration_that_is_wrong_in_itself_says_where(given, says):
    with pytest.raises(ValidationError, match=says):
        Composite.model_validate(given)


def test_gates_nested_too_deep_are_refused():
    tree: Any = {"series": ["lab.a"]}
    for _ in range(20):
        tree = {"parallel": [tree]}
    with pytest.raises(ValidationError, match="more than 16 deep"):
        Composite.model_validate({"members": ["lab.a"], "tree": tree})

"""Graphs of twins: our export is read as it was, and those of others become composites."""

import json

import pytest

from twin_server.composites.composite import Composite
from twin_server.registration.twin import Registration
from twin_server.serve.composites import WrongGraphError, composites_of
from twin_server.serve.exports import Asset, as_json_ld, graph

from .conftest import IDS, LINE, YARD

OWN = {"lab.line": Composite.model_validate(LINE), "lab.yard": Composite.model_validate(YARD)}


@pytest.fixture(scope="module")
def whole():
    return graph([Asset(i, Registration(), {"valid": False}) for i in IDS], OWN)


def platform(twins, links):
    return json.dumps(
        {
            "digitalTwinsGraph": {
                "digitalTwins": [
                    {"$dtId": name, "$metadata": {"$model": "dtmi:com:example:Room;1"}, **more}
                    for name, more in twins.items()
                ],
                "relationships": [
                    {
                        "$relationshipId": f"r{i}", "$sourceId": source,
                        "$relationshipName": how, "$targetId": target,
                    }
                    for i, (source, how, target) in enumerate(links)
                ],
            }
        }
    )  # fmt: skip


@pytest.mark.parametrize("form", [lambda whole: whole, as_json_ld])
def test_an_own_export_gives_the_composites_as_they_were(whole, form):
    found = composites_of(json.dumps(form(whole)), IDS)
    assert found.composites == OWN
    assert list(found.composites) == ["lab.line", "lab.yard"]  # parts first
    assert found.notes == ()


def test_a_part_that_is_not_here_makes_a_plain_composite_and_a_note(whole):
    found = composites_of(json.dumps(whole), IDS[1:])
    assert found.composites["lab.line"].members == tuple(IDS[1:3])
    assert found.composites["lab.line"].tree is None
    assert "lab.beam-0 is not a registered twin" in found.notes[0]


def test_a_graph_of_a_building_becomes_composites_of_its_floors():
    text = platform(
        {
            "Block A": {"name": "Main block"}, "Floor 1": {}, "Floor 2": {}, "Roof": {},
            "beam-0": {}, "beam-1": {}, "beam-2": {}, "Pump 9": {},
        },
        [
            ("Block A", "hasPart", "Floor 1"), ("Block A", "hasPart", "Floor 2"),
            ("Block A", "hasPart", "Roof"), ("Floor 1", "contains", "beam-0"),
            ("Floor 1", "contains", "beam-1"), ("Floor 2", "contains", "beam-2"),
            ("Floor 2", "contains", "Pump 9"), ("Roof", "contains", "Pump 9"),
            ("Floor 1", "adjacentTo", "Floor 2"),
        ],
    )  # fmt: skip
    found = composites_of(text, IDS, site="lab")
    assert {name: one.members for name, one in found.composites.items()} == {
        "lab.floor-1": ("lab.beam-0", "lab.beam-1"),
        "lab.floor-2": ("lab.beam-2",),
        "lab.block-a": ("lab.floor-1", "lab.floor-2"),
    }
    assert list(found.composites)[-1] == "lab.block-a"
    assert found.composites["lab.block-a"].name == "Main block"
    assert any("Roof contains no registered twin" in note for note in found.notes)
    own = composites_of(text, IDS, site="lab", contains=["adjacentTo"])
    assert own.composites == {}


def test_json_ld_of_another_vocabulary_is_read_by_the_last_part_of_its_names():
    nodes = [
        {
            "@id": "https://example.org/plant#yard",
            "@type": ["https://example.org/Site"],
            "https://brickschema.org/schema/Brick#hasPart": [
                {"@id": "https://example.org/plant#lab.beam-3"},
                {"@id": "https://example.org/plant#lab.beam-4"},
            ],
        },
        {"@id": "https://example.org/plant#lab.beam-3"},
        {"@id": "https://example.org/plant#lab.beam-4"},
    ]
    found = composites_of(json.dumps({"@graph": nodes}), IDS)
    assert found.composites["lab.yard"].members == ("lab.beam-3", "lab.beam-4")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "is not JSON"),
        ("[]", "neither digitalTwinsGraph nor @graph"),
        ('{"digitalTwinsModels": []}', "models alone have no twins"),
        ('{"digitalTwinsGraph": {"digitalTwins": [{"id": 1}]}}', "lacks what each twin"),
        (
            platform({"a": {}, "b": {}}, [("a", "contains", "b"), ("b", "contains", "a")]),
            "contains itself",
        ),
    ],
)
def test_what_is_no_graph_is_named(text, says):
    with pytest.raises(WrongGraphError, match=says):
        composites_of(text, IDS)

"""Model files: what is right reads back, what is wrong is told with line and cure."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.dynamics.builders import beam, chain, shear_frame
from slowtime.dynamics.description import Tolerance, assemble
from slowtime_schemas.files.registry import DOCUMENTS
from slowtime_schemas.frozen import folder
from slowtime_services.documents.bounds import BOUNDS
from slowtime_services.models import (
    ModelFileError,
    description_of,
    model_file_of,
    model_text,
    read_description,
    read_model,
    write_model,
)
from slowtime_services.models.model_reader import parse_model

GOLDEN = Path(__file__).parents[3] / "schemas/golden"
RIG = """\
slowtime_model: 1
name: rig
nodes:
  - {id: m1, mass_kg: 1.9}
  - {id: m2, mass_kg: 2.1}
elements:
  - {id: j0, between: [base, m1], stiffness_n_per_m: 4100.0, damping_n_s_per_m: 2.3}
  - id: j1
    between: [m1, m2]
    stiffness_n_per_m: 3900.0
inputs:
  - {channel: u, kind: force, node: m1, unit: N}
sensors:
  - {channel: a1, quantity: acceleration, node: m1, unit: m/s^2}
"""


def test_the_example_of_the_contract_reads_for_ever():
    description = read_description(GOLDEN / "model_file/v1.yaml")
    assert description.dofs == ("m1", "m2")
    assert assemble(description).stiffness.tolist() == [[8000.0, -3900.0], [-3900.0, 3900.0]]
    assert description.effects == ({"effect": "coulomb", "element": "j1", "friction_n": 4.1},)
    assert description.tolerance == Tolerance(stiffness=0.02, damping=0.15, mass=0.0)
    assert description.sensors[1].noise_sd == 1e-5


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_version_of_a_document_that_was_frozen_has_a_golden_file(name):
    frozen = {path.stem for path in (folder() / name).iterdir()}
    assert frozen == {path.stem for path in (GOLDEN / name).iterdir()}
    assert f"v{DOCUMENTS[name].VERSION}" in frozen


@pytest.mark.parametrize(
    "description",
    [
        chain([1.0, 2.0], [3.0, 0.1 + 0.2, 1e-7], rayleigh=(0.1, 1 / 3)),
        shear_frame([1e4, 2e4], [1e7, 2e7], dampings_n_s_per_m=[1e3, 2e3]),
        beam(1.0, 2.0, 3.0, elements=3, supports="propped", damping_s=1e-5, tip_mass_kg=0.5),
        read_description(GOLDEN / "model_file/v1.yaml"),
    ],
    ids=["chain", "frame", "beam", "contract"],
)
def test_what_builders_write_reads_back_to_the_last_digit(tmp_path, description):
    write_model(tmp_path / "model.yaml", description)
    assert read_description(tmp_path / "model.yaml") == description
    assert description_of(model_file_of(description)) == description


def test_json_reads_alike(tmp_path):
    model = parse_model(RIG, "rig")
    (tmp_path / "model.json").write_text(model.model_dump_json())
    assert read_model(tmp_path / "model.json") == model


def test_a_written_model_is_one_line_a_part():
    text = model_text(parse_model(RIG, "rig"))
    assert text.splitlines()[:4] == [
        "slowtime_model: 1",
        "name: rig",
        "nodes:",
        "  - {id: m1, mass_kg: 1.9}",
    ]


@given(st.floats(1e-12, 1e12), st.text("abcé:-#'\" 01._exo~", min_size=1, max_size=12))
def test_any_number_and_any_name_survive(mass, name):
    description = chain([mass], [mass])
    model = model_file_of(description).model_copy(update={"name": name})
    assert parse_model(model_text(model), "x") == model


def test_numbers_as_people_write_them_are_numbers():
    text = RIG.replace("4100.0", "4.1e3").replace("mass_kg: 2.1", "mass_kg: 2")
    model = parse_model(text.replace("id: m1", "id: 1").replace("m1", "1"), "rig")
    assert assemble(description_of(model)).stiffness[0, 0] == 8000.0
    assert model.nodes[0].id == "1"


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("4.0e7", 4e7),
        ("1e3", 1e3),
        ("1E3", 1e3),
        ("1.e-3", 1e-3),
        (".5", 0.5),
        ("+.5", 0.5),
        ("+12e03", 12e3),
        ("4100", 4100.0),
        ("010", 10.0),
        ("0o10", 8.0),
        ("0x1F", 31.0),
    ],
)
@pytest.mark.parametrize("was", ["stiffness_n_per_m: 3900.0", "friction_n: 4.1"])
def test_numbers_are_those_of_yaml_1_2_in_elements_and_effects_alike(was, written, meant):
    effects = "effects:\n  - {effect: coulomb, element: j1, friction_n: 4.1}\n"
    key = was.partition(":")[0]
    model = parse_model((RIG + effects).replace(was, f"{key}: {written}"), "rig")
    values = {**model.elements[1].model_dump(), **model.effects[0].model_dump()}
    assert values[key] == meant


@pytest.mark.parametrize("name", ["1.10", "1e3", "007", "0x1F", "1_000", "no", "2024-01-01"])
def test_a_name_that_looks_like_something_else_stays_as_it_is_written(name):
    effects = "effects:\n  - {effect: coulomb, element: m1, friction_n: 4.1}\n"
    text = RIG.replace("id: j1", "id: m1") + effects  # an element may be called as a node is
    model = parse_model(text.replace("m1", name).replace("name: rig", f"name: {name}"), "rig")
    assert {model.name, model.nodes[0].id, model.elements[1].id} == {name}
    assert model.elements[1].between == (name, "m2")
    assert model.effects[0].model_dump()["element"] == name
    assert parse_model(model_text(model), "rig") == model


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "mass_kg: 2.1",
            "mas_kg: 2.1",
            r"line 5: unknown key `mas_kg`. Did you mean `mass_kg`",
        ),
        (
            "mass_kg: 2.1",
            "mas_kg: 2.1",
            r"line 5: `mass_kg` is missing in nodes number 2\. Add it",
        ),
        (
            "    stiffness_n_per_m: 3900.0",
            "    stifness: 1",
            r"line 10: unknown key `stifness`",
        ),
        (", unit: N}", "}", r"line 12: `unit` is missing in inputs number 1\."),
        (", unit: m/s^2}", "}", r"line 14: `unit` is missing in sensors number 1\."),
        ("unit: N}", "unit: V}", r"line 12: 'V' is not a valid unit of force. Allowed: N, kN"),
        ("    between: [m1, m2]", "    between: [m1, m3]", r"line 9: No node is called 'm3'"),
        ("node: m1, unit: N", "node: m4, unit: N", r"line 12: No node is called 'm4'"),
        ("id: m2, ", "id: m1, ", r"line 5: 'm1' is used twice among the nodes"),
        ("mass_kg: 1.9", "mass_kg: -1.9", r"line 4: `mass_kg`: .*greater than 0, not -1.9"),
        ("mass_kg: 1.9", "mass_kg: heavy", r"line 4: `mass_kg`: .*not 'heavy'"),
        ("mass_kg: 1.9", "mass_kg: true", r"line 4: `mass_kg`: True is a truth value"),
        ("mass_kg: 1.9", "mass_kg: yes", r"line 4: `mass_kg`: this is text.*not 'yes'"),
        ("mass_kg: 1.9", "mass_kg: 1_000", r"line 4: `mass_kg`: .*text.* 4\.0e7, not '1_000'"),
        ("mass_kg: 1.9", "mass_kg: 1:30", r"line 4: `mass_kg`: this is text.*not '1:30'"),
        ("mass_kg: 1.9", "mass_kg: !!int 0x", r"line 4: `0x` is no value"),
        (
            "mass_kg: 1.9",
            f"mass_kg: {10**400}",
            r"line 4: `1000.* is no value: it has 401 digits",
        ),
        ("mass_kg: 1.9", "mass_kg: 1e400", r"line 4: `1e400` is no value: it is larger than"),
        ("mass_kg: 1.9", "mass_kg: .nan", r"line 4: `mass_kg`: .*finite"),
        (
            "  - id: j1",
            "  - kind: rod\n    id: j1",
            r"line 8: `kind: rod` is not known.*spring",
        ),
        ("kind: force", "kind: torque", r"line 12: `kind`: .*'force', 'base_acceleration'"),
        ("slowtime_model: 1", "slowtime_model: 3", r"line 1: `slowtime_model`: .*2, not 3"),
        ("slowtime_model: 1\n", "", r"`slowtime_model` is missing\. Add it"),
        (
            "name: rig",
            "name: rig\nname: two",
            r"line 3: `name` stands here twice, first on line 2",
        ),
        ("name: rig", "name: &a rig\ntitle: *a", r"line 3: `\*a` is an alias"),
        ("name: rig", "name: [rig", r"line \d+: This is not YAML"),
        ("name: rig", "name: !!python/object:os.system x", r"line 2: This is not YAML"),
        ("name: rig", "masses: 3", r"line 2: unknown key `masses`.*Allowed: slowtime_model"),
        ("name: rig", "name: " + "[" * 40 + "]" * 40, r"line 2: More than 16 levels deep"),
    ],
)
def test_what_is_wrong_is_told_with_its_line_and_a_cure(old, new, words):
    assert old in RIG
    with pytest.raises(ModelFileError, match=words):
        parse_model(RIG.replace(old, new, 1), "rig.yaml")


def test_all_faults_are_told_at_once_and_not_too_many():
    text = RIG.replace("mass_kg", "mass").replace("between", "betwixt")
    with pytest.raises(ModelFileError) as caught:
        parse_model(text, "rig.yaml")
    assert len(str(caught.value).splitlines()) == 8
    many = RIG.replace("nodes:\n", "nodes:\n" + "  - {id: x}\n" * 20)
    with pytest.raises(ModelFileError, match=r"\.\.\. and 12 more"):
        parse_model(many, "rig.yaml")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty. Begin it with `slowtime_model: 1`"),
        (b"just words", "Begin it with"),
        (b"\xff\xfe\x00", "not text"),
        (b"#" * (BOUNDS.most_bytes + 1), "Is it a record"),
    ],
)
def test_what_is_no_model_file_is_told_so(tmp_path, content, words):
    (tmp_path / "m.yaml").write_bytes(content)
    with pytest.raises(ModelFileError, match=words):
        read_model(tmp_path / "m.yaml")


@pytest.mark.parametrize(
    ("was", "named"),
    [
        ("name: rig", "`name`"),
        ("channel: a1", "`channel`"),
        ("id: m1", "`id`"),
        ("unit: N", "`unit`"),
    ],
)
@pytest.mark.parametrize("character", [r"\u202e", r"\x1b", r"\n", r"\u2066"])
def test_a_name_with_a_character_that_is_not_seen_is_refused_by_its_line(was, named, character):
    key, _, word = was.partition(": ")
    text = RIG.replace(was, f'{key}: "{word}{character}"')
    line = next(i for i, row in enumerate(text.splitlines(), 1) if character in row)
    with pytest.raises(ModelFileError, match=rf"line {line}: {named}: .*has U\+\w{{4}}"):
        parse_model(text, "rig.yaml")


def test_texts_of_effects_are_held_to_it_too():
    effects = 'effects:\n  - {effect: coulomb, element: "j1\\u202e", friction_n: 4.1}\n'
    with pytest.raises(ModelFileError, match=r"has U\+202E RIGHT-TO-LEFT OVERRIDE"):
        parse_model(RIG + effects, "rig.yaml")

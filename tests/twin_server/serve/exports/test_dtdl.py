"""The graph is made of valid DTDL v3, and every twin in it is what its interface says.

No Python package parses DTDL (`test_dtdl_peer.py` asks one for Node): `violations` holds the
rules of the published text, version 3, for the classes that are used here, and refuses every
class, key and schema that are not.
"""

import json
import re
from typing import Any

import pytest

from twin_server.registration.twin import Registration
from twin_server.serve.exports import Asset, graph, models
from twin_server.serve.exports.dtdl import segment

USER_SEGMENT = r"[A-Za-z](?:\w*[A-Za-z0-9])?"
DTMI = re.compile(
    rf"dtmi:{USER_SEGMENT}(?::{USER_SEGMENT})*(;[1-9]\d{{0,8}}(\.[1-9]\d{{0,5}})?)?", re.ASCII
)
NAME = re.compile(r"[A-Za-z](?:\w*[A-Za-z0-9])?", re.ASCII)
PRIMITIVE = {
    "boolean", "date", "dateTime", "double", "duration", "float", "integer", "long", "string",
    "time",
}  # fmt: skip
COMMON = {"@type", "@id", "comment", "description", "displayName"}
KEYS = {
    "Interface": {"@context", "contents", "extends", "schemas"},
    "Telemetry": {"name", "schema", "unit"},
    "Property": {"name", "schema", "writable"},
    "Relationship": {
        "name", "target", "properties", "writable", "minMultiplicity", "maxMultiplicity",
    },
    "Object": {"fields"},
    "Array": {"elementSchema"},
    "Field": {"name", "schema"},
}  # fmt: skip
KINDS = ("Property", "Telemetry", "Relationship")
UNITS = {"Frequency": "hertz"}
CONTEXT = ["dtmi:dtdl:context;3", "dtmi:dtdl:extension:quantitativeTypes;1"]
DEEPEST, LARGEST = 5, 2**20


def violations(interfaces: list[dict[str, Any]]) -> list[str]:
    """What the published rules of DTDL v3 forbid in a whole set of interfaces."""
    found: list[str] = []
    known: dict[str, Any] = {}

    def say(condition: bool, where: str, what: str) -> None:
        if not condition:
            found.append(f"{where}: {what}")

    def element(node: Any, kind: str, where: str) -> None:
        types = node.get("@type", kind)
        semantic = [] if isinstance(types, str) else types[1:]
        say(kind in (types, types[0]), where, f"is no {kind}")
        say(all(UNITS.get(one) == node.get("unit") for one in semantic), where, "no such unit")
        say(bool(semantic) or "unit" not in node, where, "has a unit of no semantic type")
        say(kind == "Field" or "@type" in node, where, "has no @type")
        say(not node.keys() - COMMON - KEYS[kind], where, "has keys of no meaning")
        say(len(node.get("displayName", "")) <= 64, where, "a displayName too long")
        for text in ("description", "comment"):
            say(len(node.get(text, "")) <= 512, where, f"a {text} too long")
        if "@id" in node:
            say(bool(DTMI.fullmatch(node["@id"])), where, f"no DTMI: {node['@id']}")
            say(len(node["@id"]) <= (128 if kind == "Interface" else 2048), where, "too long")
            say(not node["@id"].startswith(("dtmi:dtdl:", "dtmi:standard:")), where, "reserved")
            say(node["@id"] not in known, where, f"a second {node['@id']}")
            known[node["@id"]] = node
        if "name" in KEYS[kind]:
            name = node.get("name", "")
            say(bool(NAME.fullmatch(name)) and len(name) <= 512, where, f"no name: {name!r}")

    def schema(node: Any, local: set[str], where: str, depth: int = 1) -> None:
        if isinstance(node, str):
            say(node in PRIMITIVE or node in local, where, f"no schema: {node}")
            return
        say(depth <= DEEPEST, where, "nested too deep")
        kind = node.get("@type")
        say(kind in ("Object", "Array"), where, f"{kind} is not used here")
        element(node, kind, where)
        if kind == "Array":
            schema(node["elementSchema"], local, where, depth + 1)
        for field in node.get("fields", ()):
            element(field, "Field", where)
            schema(field["schema"], local, where, depth + 1)
        names = [field["name"] for field in node.get("fields", ())]
        say(len(set(names)) == len(names), where, "fields of one name")

    for interface in interfaces:
        where = interface.get("@id", "an interface without @id")
        say(interface.get("@context") == CONTEXT, where, "not of version 3")
        say("@id" in interface, where, "needs an @id")
        say(len(json.dumps(interface).encode()) <= LARGEST, where, "too large")
        element(interface, "Interface", where)
        local = {one.get("@id", "") for one in interface.get("schemas", ())}
        say("" not in local, where, "a schema without @id")
        for one in interface.get("schemas", ()):
            schema(one, local, where)
        for content in interface.get("contents", ()):
            kind = content.get("@type")
            kind = kind[0] if isinstance(kind, list) else kind
            at = f"{where} {content.get('name')}"
            say(kind in KINDS, at, f"{kind} is not used here")
            element(content, kind, at)
            if "schema" in content:
                schema(content["schema"], local, at)
            elif "target" in content:
                say(bool(DTMI.fullmatch(content["target"])), at, "no target")

    for interface in interfaces:
        lineage, names = [interface], []
        while (of := lineage[-1].get("extends")) is not None and len(lineage) <= 10:
            if of not in known:
                found.append(f"{interface['@id']}: extends the unknown {of}")
                break
            lineage.append(known[of])
        say(len(lineage) <= 10, interface["@id"], "extends too deep, or itself")
        names = [content["name"] for one in lineage for content in one.get("contents", ())]
        say(len(set(names)) == len(names), interface["@id"], "contents of one name")
    return found


def contents_of(interfaces, model):
    by_id = {one["@id"]: one for one in interfaces}
    found: dict[str, Any] = {}
    at = model
    while at is not None:
        found |= {content["name"]: content for content in by_id[at]["contents"]}
        at = by_id[at].get("extends")
    return found


CHECKS = {
    "double": lambda v: isinstance(v, float | int) and not isinstance(v, bool),
    "long": lambda v: isinstance(v, int) and abs(v) < 2**63,
    "boolean": lambda v: isinstance(v, bool),
    "string": lambda v: isinstance(v, str),
}


def fits(schema, value):
    if isinstance(schema, str) and schema in CHECKS:
        return CHECKS[schema](value)
    if isinstance(schema, str):
        return set(value) == {"value", "sd", "lo", "hi"} and all(
            map(CHECKS["double"], value.values())
        )
    return all(fits(schema["elementSchema"], one) for one in value)


@pytest.fixture(scope="module")
def whole(house):
    return house.get("/api/v1/dtdl", site="lab").json()


@pytest.mark.long
def test_the_models_keep_the_rules_of_dtdl(whole):
    assert violations(whole["digitalTwinsModels"]) == []
    assert len(whole["digitalTwinsModels"]) == 8


@pytest.mark.long
@pytest.mark.parametrize(
    ("breaks", "says"),
    [
        (lambda m: m[0].update({"@context": "dtmi:dtdl:context;2"}), "not of version 3"),
        (lambda m: m[0].update({"@id": "dtmi:slowtime:9lives;1"}), "no DTMI"),
        (lambda m: m[0].update({"@id": "dtmi:slowtime:beam_;1"}), "no DTMI"),
        (lambda m: m[0].update({"@id": f"dtmi:slowtime:{'a' * 120};1"}), "too long"),
        (lambda m: m[0].update({"displayName": "a" * 65}), "displayName too long"),
        (lambda m: m[0].update({"version": 1}), "no meaning"),
        (lambda m: m[0]["contents"][0].update({"name": "a b"}), "no name"),
        (lambda m: m[0]["contents"][0].update({"schema": "number"}), "no schema"),
        (lambda m: m[0]["contents"].append(m[0]["contents"][0]), "contents of one name"),
        (lambda m: m[-1].update({"extends": "dtmi:slowtime:Gone;1"}), "unknown"),
        (lambda m: m.append(m[0]), "a second"),
    ],
)
def test_the_check_finds_what_breaks_a_rule(whole, breaks, says):
    broken = json.loads(json.dumps(whole["digitalTwinsModels"]))
    breaks(broken)
    assert any(says in fault for fault in violations(broken))


@pytest.mark.long
def test_every_twin_has_what_its_interface_says_and_nothing_else(whole):
    graph = whole["digitalTwinsGraph"]
    interfaces = whole["digitalTwinsModels"]
    kinds = {twin["$dtId"]: twin["$metadata"]["$model"] for twin in graph["digitalTwins"]}
    assert len(kinds) == len(graph["digitalTwins"])
    for twin in graph["digitalTwins"]:
        assert re.fullmatch(r"[\w.%-]{1,128}", twin["$dtId"])
        contents = contents_of(interfaces, kinds[twin["$dtId"]])
        for name, value in twin.items():
            if not name.startswith("$"):
                assert contents[name]["@type"] == "Property"
                assert fits(contents[name]["schema"], value), (twin["$dtId"], name, value)
    by_id = {one["@id"]: one for one in interfaces}
    for link in graph["relationships"]:
        said = contents_of(interfaces, kinds[link["$sourceId"]])[link["$relationshipName"]]
        target = by_id[kinds[link["$targetId"]]]
        assert said["target"] in (target["@id"], target.get("extends"))
    ids = [link["$relationshipId"] for link in graph["relationships"]]
    assert len(set(ids)) == len(ids)


@pytest.mark.long
def test_the_graph_has_the_frame_with_its_parts_and_the_storey_that_changed(whole):
    graph = whole["digitalTwinsGraph"]
    twins = {twin["$dtId"]: twin for twin in graph["digitalTwins"]}
    links = {
        (link["$sourceId"], link["$relationshipName"], link["$targetId"])
        for link in graph["relationships"]
    }
    assert ("lab", "hosts", "lab.frame") in links
    assert ("lab.frame", "consists_of", "lab.frame.element.storey2") in links
    assert ("lab.frame.element.storey2", "joins", "lab.frame.node.floor1") in links
    assert ("lab.frame.sensor.a_floor1", "measures", "lab.frame.node.floor1") in links
    changed = twins["lab.frame.element.storey2"]["stiffness_change"]
    assert changed["lo"] < -0.2 < changed["hi"]
    suspected = {i for i, twin in twins.items() if twin.get("suspected")}
    assert suspected == {"lab.frame.element.storey2"}
    assert twins["lab.beam"]["stiffness_change"]["value"] < -0.1


def test_one_twin_alone_and_a_site_without_twins(house):
    one = house.get("/api/v1/twins/lab.beam/dtdl").json()
    assert [t["$dtId"] for t in one["digitalTwinsGraph"]["digitalTwins"]] == ["lab", "lab.beam"]
    assert violations(one["digitalTwinsModels"]) == []
    none = house.get("/api/v1/dtdl", site="nowhere").json()
    assert none["digitalTwinsGraph"] == {"digitalTwins": [], "relationships": []}
    lab = house.get("/api/v1/dtdl", site="lab").json()["digitalTwinsGraph"]["digitalTwins"]
    assert {"lab", "lab.beam", "lab.frame"} <= {twin["$dtId"] for twin in lab}
    assert house.get("/api/v1/twins/lab.nobody/dtdl").status_code == 404
    # The file is called by the site: no header may be made of anything.
    for site in ("\u4e0a", 'a"; x="b', "a\r\nSet-Cookie: b", ""):
        assert house.get("/api/v1/dtdl", site=site).status_code == 422


def test_names_of_every_length_and_letter_become_identifiers_of_their_own():
    names = ["a-b", "a_b", "a2db", "ab", "1a", "n1a", "a" * 63, "9" + "-" * 61 + "z", "z_"]
    assert len({segment(name) for name in names}) == len(names)
    ids = [f"{site}.{asset}" for site in names for asset in names]
    assets = [Asset(i, Registration(), {"valid": False}) for i in ids]
    assert violations(models(assets)) == []
    links = graph(assets)["digitalTwinsGraph"]["relationships"]
    assert len({link["$relationshipId"] for link in links}) == len(ids)
    assert max(len(link["$relationshipId"]) for link in links) <= 128

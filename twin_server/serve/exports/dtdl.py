"""A site as a graph for twin platforms: interfaces in DTDL v3, and their instances.

The graph has the form that Azure Digital Twins Explorer imports: models, twins, relationships.
A site hosts twins; a composite has twins and other composites as members; a twin with a model
consists of elements and nodes and listens by sensors.

References
----------
.. [1] Digital Twins Definition Language, version 3,
   https://azure.github.io/opendigitaltwins-dtdl/DTDL/v3/DTDL.v3.html
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from twin_server.composites.composite import Composite
from twin_server.composites.hierarchy import twins_of
from twin_server.registration.twin import Registration

from .telemetry import QUANTITIES, telemetry_of

Node = dict[str, Any]

CONTEXT = ["dtmi:dtdl:context;3", QUANTITIES]
LONGEST_ID = 128
"""Characters of a model identifier, as DTDL v3 allows them."""

_MEMBERS = "Twins and other composites."
_PARTS = ("value", "sd", "lo", "hi")
_OF = {
    "stiffness": ("stiffness_change",),
    "mass": ("mass_change",),
    "both": ("stiffness_change", "mass_change"),
    "elements": (),
}


class Asset(NamedTuple):
    """A twin in the graph: its registration, and its latest state as in REST."""

    id: str
    registration: Registration
    state: Mapping[str, Any]


def models(assets: Iterable[Asset]) -> list[Node]:
    """Interfaces in DTDL v3: those of every site, and one of each twin."""
    return [*_common(), *(_of_twin(asset) for asset in assets)]


def graph(assets: Sequence[Asset], composites: Mapping[str, Composite] | None = None) -> Node:
    """Models, and the twins and relationships of all sites that `assets` belong to.

    Parameters
    ----------
    composites
        Of which those are told of whose twins are all among `assets`.
    """
    twins: list[Node] = []
    links: list[Node] = []
    for site in sorted({asset.id.partition(".")[0] for asset in assets}):
        twins.append(_twin(site, _shared("Site"), name=site))
    for asset in assets:
        twins.append(_twin(asset.id, _own(asset.id), **_known(asset)))
        links.append(_link(asset.id.partition(".")[0], "hosts", asset.id))
        _add_parts(asset, twins, links)
    _add_composites({asset.id for asset in assets}, composites or {}, twins, links)
    return {
        "digitalTwinsFileInfo": {"fileVersion": "1.0.0"},
        "digitalTwinsGraph": {"digitalTwins": twins, "relationships": links},
        "digitalTwinsModels": models(assets),
    }


def segment(name: str) -> str:
    """Write a name as a segment of a model identifier; different names stay different.

    Examples
    --------
    >>> segment("beam"), segment("beam-2"), segment("2nd_")
    ('beam', 'beam_2d2', 'N2nd_5f')
    """
    text = re.sub(r"[^a-z0-9]", lambda found: f"_{ord(found[0]):02x}", name)
    return f"N{text}" if text[0].isdigit() else text


def _shared(name: str) -> str:
    return f"dtmi:slowtime:{name};1"


def _own(twin_id: str) -> str:
    """Name a twin's own interface, which may have no more than 128 characters."""
    whole = f"dtmi:slowtime:twin:{':'.join(map(segment, twin_id.split('.')))};1"
    if len(whole) <= LONGEST_ID:
        return whole
    return f"dtmi:slowtime:twin:H{hashlib.sha256(twin_id.encode()).hexdigest()[:40]};1"


def _interface(model: str, name: str, says: str, *contents: Node, **more: Any) -> Node:
    return {
        "@context": CONTEXT,
        "@id": model,
        "@type": "Interface",
        "displayName": name[:64],
        "description": says,
        **more,
        "contents": list(contents),
    }


def _property(name: str, schema: Any, says: str) -> Node:
    return {"@type": "Property", "name": name, "schema": schema, "description": says}


def _relationship(name: str, target: str, says: str) -> Node:
    return {
        "@type": "Relationship",
        "name": name,
        "target": _shared(target),
        "description": says,
    }


def _estimate(model: str) -> Node:
    """Describe a value with its standard deviation and 95 % interval, of one interface."""
    path = model.removesuffix(";1")
    return {
        "@id": f"{path}:Estimate;1",
        "@type": "Object",
        "displayName": "Estimate",
        "fields": [{"name": part, "schema": "double"} for part in _PARTS],
    }


def _with_estimates(model: str) -> tuple[str, Node]:
    schema = _estimate(model)
    return schema["@id"], {"schemas": [schema]}


def _common() -> list[Node]:
    twin, element, node = _shared("Twin"), _shared("Element"), _shared("Node")
    of_twin, twin_schemas = _with_estimates(twin)
    of_element, element_schemas = _with_estimates(element)
    of_node, node_schemas = _with_estimates(node)
    texts = {"@type": "Array", "elementSchema": "string"}
    return [
        _interface(
            _shared("Site"), "Site", "Where assets stand together.",
            _property("name", "string", "What it is called in keys and identifiers."),
            _relationship("hosts", "Twin", "Twins of the assets that stand there."),
        ),
        _interface(
            twin, "Twin", "An asset that vibrates, as it was after its last epoch.",
            _property("name", "string", "For people."),
            _property("changes", "string", "What may change: stiffness, mass, both, elements."),
            _property("alive", "boolean", "Whether the edge agent is online."),
            _property("valid", "boolean", "Whether the estimates mean anything."),
            _property("reasons", texts, "Why not, in sentences."),
            _property("t_ns", "long", "Sensor time [ns since 1970-01-01 UTC]."),
            _property("slow_time", "double", "In slow_time_unit."),
            _property("slow_time_unit", "string", "Unit of slow time."),
            _property("frequency_hz", of_twin, "Natural frequency; 95 % interval [Hz]."),
            _property("damping_ratio", of_twin, "Of critical damping [1]."),
            _relationship("consists_of", "Element", "Springs, storeys or beams of its model."),
            _relationship("has_node", "Node", "Nodes of its model."),
            _relationship("listens_by", "Sensor", "Channels of its edge agent."),
            *telemetry_of("frequency_hz", "Natural frequency [Hz]"),
            *telemetry_of("damping_ratio", "Damping ratio [1]"),
            **twin_schemas,
        ),
        _interface(
            _shared("Composite"), "Composite", "A twin made of twins.",
            _property("name", "string", "For people."),
            _property("kind", "string", "site, line or structure."),
            _property("registration", "string", "Tree, dependence and the rest, as JSON."),
            {"@type": "Relationship", "name": "has_member", "description": _MEMBERS},
        ),
        _interface(
            element, "Element", "A spring or beam of a twin's model.",
            _property("kind", "string", "spring or beam."),
            _property("stiffness_n_per_m", "double", "As the model file has it [N/m]."),
            _property("damping_n_s_per_m", "double", "As the model file has it [N s/m]."),
            _property("stiffness_change", of_element, "-0.1 once a tenth is gone [1]."),
            _property("suspected", "boolean", "Whether it may be what has changed."),
            *telemetry_of("stiffness_change", "Relative change of stiffness [1]"),
            _relationship("joins", "Node", "Its ends; an end at the base has none."),
            **element_schemas,
        ),
        _interface(
            node, "Node", "Where elements of a model meet.",
            _property("kind", "string", "point or beam."),
            _property("mass_kg", "double", "As the model file has it [kg]."),
            _property("mass_change", of_node, "0.1 once a tenth is added [1]."),
            _property("suspected", "boolean", "Whether it may be what has changed."),
            *telemetry_of("mass_change", "Relative change of mass [1]"),
            **node_schemas,
        ),
        _interface(
            _shared("Sensor"), "Sensor", "A channel that measures the motion of a node.",
            _property("channel", "string", "As the edge agent calls it."),
            _property("quantity", "string", "acceleration, velocity or displacement."),
            _property("unit", "string", "Of its samples."),
            _relationship("measures", "Node", "Whose motion it measures."),
        ),
    ]  # fmt: skip


def _of_twin(asset: Asset) -> Node:
    own = _own(asset.id)
    schema, schemas = _with_estimates(own)
    return _interface(
        own,
        asset.registration.name or asset.id,
        f"The twin {asset.id}.",
        *(
            _property(name, schema, "Relative change; 95 % interval [1].")
            for name in _OF[asset.registration.changes]
        ),
        *(
            node
            for name in _OF[asset.registration.changes]
            for node in telemetry_of(name, f"Relative {name.replace('_', ' ')} [1]")
        ),
        extends=_shared("Twin"),
        **(schemas if _OF[asset.registration.changes] else {}),
    )


def _twin(dt_id: str, model: str, **properties: Any) -> Node:
    known = {name: value for name, value in properties.items() if value is not None}
    return {"$dtId": dt_id, "$metadata": {"$model": model}, **known}


def _link(source: str, name: str, target: str) -> Node:
    return {
        "$relationshipId": f"{source}-{name}-{target}"
        if len(source) + len(target) + len(name) <= LONGEST_ID - 2
        else hashlib.sha256(f"{source} {name} {target}".encode()).hexdigest(),
        "$sourceId": source,
        "$relationshipName": name,
        "$targetId": target,
    }


def _known(asset: Asset) -> Node:
    told = ("alive", "valid", "reasons", "t_ns", "slow_time", "slow_time_unit")
    estimates = ("frequency_hz", "damping_ratio", *_OF[asset.registration.changes])
    return {
        "name": asset.registration.name or asset.id,
        "changes": asset.registration.changes,
        **{name: asset.state.get(name) for name in (*told, *estimates)},
    }


def _part(twin_id: str, kind: str, name: str) -> str:
    """Name a part, in the letters and the length that are allowed."""
    text = re.sub(r"[^A-Za-z0-9_]", lambda found: f"%{ord(found[0]):02x}", name)
    whole = f"{twin_id}.{kind}.{text}"
    if len(whole) <= LONGEST_ID:
        return whole
    return f"H{hashlib.sha256(whole.encode()).hexdigest()}"


def _add_composites(
    ids: set[str], composites: Mapping[str, Composite], twins: list[Node], links: list[Node]
) -> None:
    for name, one in composites.items():
        if not ids.issuperset(twins_of(name, composites)):
            continue
        told = {"name": one.name or name, "kind": one.kind}
        text = json.dumps(one.to_dict(), ensure_ascii=False)
        twins.append(_twin(name, _shared("Composite"), registration=text, **told))
        links += [_link(name, "has_member", member) for member in one.members]


def _add_parts(asset: Asset, twins: list[Node], links: list[Node]) -> None:
    model = asset.registration.model
    if model is None:
        return
    changes = asset.state.get("elements") or {}
    named = {name for one in asset.state.get("suspects") or () for name in one.split(" or ")}
    for node in model.nodes:
        at = _part(asset.id, "node", node.id)
        mass = f"{node.id}.mass"
        told = {"kind": node.kind, "mass_kg": node.mass_kg, "suspected": mass in named}
        twins.append(_twin(at, _shared("Node"), mass_change=changes.get(mass), **told))
        links.append(_link(asset.id, "has_node", at))
    known = {node.id for node in model.nodes}
    for element in model.elements:
        at = _part(asset.id, "element", element.id)
        content = element.model_dump()
        properties = {
            name: content.get(name) for name in ("stiffness_n_per_m", "damping_n_s_per_m")
        }
        twins.append(
            _twin(
                at,
                _shared("Element"),
                kind=element.kind,
                stiffness_change=changes.get(element.id),
                suspected=element.id in named,
                **properties,
            )
        )
        links.append(_link(asset.id, "consists_of", at))
        ends = [end for end in element.between if end in known]
        links += [_link(at, "joins", _part(asset.id, "node", end)) for end in ends]
    for sensor in model.sensors:
        at = _part(asset.id, "sensor", sensor.channel)
        measured = {"quantity": sensor.quantity, "unit": sensor.unit}
        twins.append(_twin(at, _shared("Sensor"), channel=sensor.channel, **measured))
        links.append(_link(asset.id, "listens_by", at))
        if sensor.node is not None:
            links.append(_link(at, "measures", _part(asset.id, "node", sensor.node)))

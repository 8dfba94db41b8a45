"""Reader of digital-twin graphs as composites.

A graph is a file of twins and relationships as twin platforms write it
(`digitalTwinsGraph`), or JSON-LD with `@graph`. Composites of an own export are read as they
were. In any other graph each instance that contains registered twins becomes a composite.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import ValidationError

from slowtime_services.documents.bounds import DocumentError
from slowtime_services.documents.json_documents import read_json
from twin_server.composites.composite import Composite
from twin_server.registration.twin import ID

CONTAINS = (
    "has_member", "hasMember", "hasMembers", "contains", "hasPart", "has_part", "hasParts",
    "consistsOf", "isLocationOf", "hosts", "rel_has_parts",
)  # fmt: skip
"""Relationships from a whole to its parts, as ontologies of buildings, cities and plants name
them; other names are given."""

COMPOSITE = "dtmi:slowtime:Composite;1"
_OWN = "dtmi:slowtime:"
_NAME = re.compile(r"[^a-z0-9_-]+")


class WrongGraphError(ValueError):
    """A file that is no graph of twins; the text says what it contains."""


class GraphComposites(NamedTuple):
    """Composites that a graph describes.

    Parameters
    ----------
    composites
        By id, parts before what they are parts of.
    notes
        What was left out, and why, in sentences.
    """

    composites: dict[str, Composite]
    notes: tuple[str, ...]


class _Instance(NamedTuple):
    model: str
    content: Mapping[str, Any]
    links: list[tuple[str, str]]


def composites_of(
    text: str,
    twins: Collection[str],
    *,
    site: str | None = None,
    contains: Sequence[str] = CONTAINS,
) -> GraphComposites:
    """Read the composites that a graph describes.

    Parameters
    ----------
    text
        JSON.
    twins
        Ids of the registered twins: an instance is one of them by its id, or by its id behind
        `site` and a full stop.
    site
        Of instances whose ids are not SITE.NAME; by default that of the twins within.
    contains
        Names of relationships from a whole to its parts.

    Raises
    ------
    WrongGraphError
        Where it is no graph, or an instance contains itself.
    """
    instances = _instances(text)
    ids = {name: _twin_id(name, twins, site) for name in instances}
    parts = {
        name: [target for how, target in one.links if how in contains and target in instances]
        for name, one in instances.items()
        if one.model == COMPOSITE or not one.model.startswith(_OWN)
    }
    found: dict[str, Composite] = {}
    named: dict[str, str] = {}
    notes: list[str] = []
    for name in _parts_first(parts, ids):
        inside = list(
            dict.fromkeys(filter(None, (ids[p] or named.get(p) for p in parts[name])))
        )
        left_out = [p for p in parts[name] if not (ids[p] or named.get(p))]
        if not inside:
            notes.append(f"{name} contains no registered twin, and is left out.")
            continue
        if left_out:
            notes.append(f"{name}: {', '.join(left_out)[:200]} is not a registered twin.")
        own = _own_id(name, site, inside)
        if own in found or own in twins:
            notes.append(f"{name} would be called {own} as another is, and is left out.")
            continue
        named[name] = own
        found[own] = _composite(instances[name], name, inside, bool(left_out), notes)
    return GraphComposites(found, tuple(notes))


def _composite(
    instance: _Instance, name: str, inside: Sequence[str], incomplete: bool, notes: list[str]
) -> Composite:
    text = instance.content.get("registration")
    if instance.model == COMPOSITE and isinstance(text, str) and not incomplete:
        try:
            return Composite.model_validate_json(text)
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            notes.append(f"{name}: its registration is not used: {fault['msg']}")
    called = instance.content.get("name")
    title = called if isinstance(called, str) and called.isprintable() else name
    return Composite(name=title[:100], members=tuple(inside))


def _instances(text: str) -> dict[str, _Instance]:
    try:
        content = read_json(text)
    except DocumentError as error:
        raise WrongGraphError(f"The graph cannot be read: {error}") from error
    try:
        if isinstance(content, dict) and "digitalTwinsGraph" in content:
            return _of_platform(content["digitalTwinsGraph"])
        if isinstance(content, dict) and isinstance(content.get("@graph"), list):
            return _of_json_ld(content["@graph"])
    except (KeyError, TypeError, AttributeError) as error:
        raise WrongGraphError(
            f"The graph lacks what each twin and relationship has: {error!r:.80}. Twins have "
            "$dtId and $metadata.$model; relationships $sourceId, $relationshipName and "
            "$targetId."
        ) from error
    raise WrongGraphError(
        "The file has neither digitalTwinsGraph nor @graph. Give a graph of twins and "
        "relationships, such as `slowtime export` writes; models alone have no twins."
    )


def _of_platform(graph: Mapping[str, Any]) -> dict[str, _Instance]:
    found = {
        twin["$dtId"]: _Instance(twin["$metadata"]["$model"], twin, [])
        for twin in graph["digitalTwins"]
    }
    for link in graph["relationships"]:
        source = found.get(link["$sourceId"])
        if source is not None:
            source.links.append((link["$relationshipName"], link["$targetId"]))
    return found


def _of_json_ld(nodes: Sequence[Mapping[str, Any]]) -> dict[str, _Instance]:
    found: dict[str, _Instance] = {}
    for node in nodes:
        kinds = node.get("@type", "")
        links = [
            (re.split(r"[/#:]", how)[-1], _local(one["@id"]))
            for how, value in node.items()
            if not how.startswith("@")
            for one in (value if isinstance(value, list) else [value])
            if isinstance(one, dict) and "@id" in one
        ]
        model = kinds[0] if isinstance(kinds, list) and kinds else kinds
        found[_local(node["@id"])] = _Instance(str(model), node, links)
    return found


def _local(iri: str) -> str:
    """Return the last part of an IRI.

    Examples
    --------
    >>> _local("https://example.org/twins#pump-1"), _local("urn:slowtime:twin:lab.beam")
    ('pump-1', 'lab.beam')
    """
    return re.split(r"[/#:]", iri)[-1]


def _slug(name: str) -> str:
    """Write a name in the letters of an id.

    Examples
    --------
    >>> _slug("Pump House (N)")
    'pump-house-n'
    """
    return _NAME.sub("-", name.lower()).strip("-_")[:63] or "unnamed"


def _twin_id(name: str, twins: Collection[str], site: str | None) -> str | None:
    behind = f"{site}.{_slug(name)}" if site else None
    return next((one for one in (name, behind) if one is not None and one in twins), None)


def _own_id(name: str, site: str | None, inside: Sequence[str]) -> str:
    if re.fullmatch(ID, name):
        return name
    return f"{site or inside[0].partition('.')[0]}.{_slug(name)}"


def _parts_first(
    parts: Mapping[str, Sequence[str]], ids: Mapping[str, str | None]
) -> list[str]:
    """Sort composites so that each comes after those that are its members."""
    done: dict[str, None] = {}
    under_way: dict[str, None] = {}
    for start in parts:
        waiting = [(start, False)]
        while waiting:
            name, left = waiting.pop()
            if left:
                del under_way[name]
                done[name] = None
            elif name in under_way:
                raise WrongGraphError(
                    f"{name} contains itself, by way of {', '.join(under_way)[:200]}. Take one "
                    "of these relationships out."
                )
            elif name not in done and parts.get(name) and not ids[name]:
                under_way[name] = None
                waiting.append((name, True))
                waiting += [(part, False) for part in parts[name]]
    return list(done)

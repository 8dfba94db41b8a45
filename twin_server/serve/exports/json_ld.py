"""A graph of twins as JSON-LD: each twin a node, each relationship a link to another.

References
----------
.. [1] W3C, "JSON-LD 1.1", https://www.w3.org/TR/json-ld11/
"""

from typing import Any

Node = dict[str, Any]

VOCABULARY = "urn:slowtime:term:"
TWINS = "urn:slowtime:twin:"


def as_json_ld(graph: Node) -> Node:
    """Write the twins and relationships of a graph as JSON-LD; `@type` is the DTDL model.

    Examples
    --------
    >>> twins = [{"$dtId": "lab", "$metadata": {"$model": "dtmi:slowtime:Site;1"}, "name": "x"}]
    >>> graph = {"digitalTwins": twins, "relationships": []}
    >>> as_json_ld({"digitalTwinsGraph": graph})["@graph"]
    [{'@id': 'urn:slowtime:twin:lab', '@type': 'dtmi:slowtime:Site;1', 'name': 'x'}]
    """
    whole = graph["digitalTwinsGraph"]
    nodes: dict[str, Node] = {}
    for twin in whole["digitalTwins"]:
        known = {
            name: {"@type": "@json", "@value": value} if isinstance(value, dict) else value
            for name, value in twin.items()
            if not name.startswith("$")
        }
        model = twin["$metadata"]["$model"]
        nodes[twin["$dtId"]] = {"@id": TWINS + twin["$dtId"], "@type": model, **known}
    for link in whole["relationships"]:
        targets = nodes[link["$sourceId"]].setdefault(link["$relationshipName"], [])
        targets.append({"@id": TWINS + link["$targetId"]})
    context = {"@version": 1.1, "@vocab": VOCABULARY}
    return {"@context": context, "@graph": list(nodes.values())}

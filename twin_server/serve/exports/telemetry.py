"""DTDL Telemetry of estimates: a value and its standard deviation each epoch, with units."""

from typing import Any

Node = dict[str, Any]

QUANTITIES = "dtmi:dtdl:extension:quantitativeTypes;1"
"""Context of semantic types and units; a part of the language itself in version 2."""

_SEMANTIC = {"frequency_hz": ("frequency", "Frequency", "hertz")}
"""Of a property: what its telemetry is called, its semantic type and its unit. Relative changes
and damping ratios have no semantic type in DTDL; their unit is 1."""


def telemetry_of(quantity: str, says: str) -> tuple[Node, Node]:
    """Return the telemetry of an estimate and that of its standard deviation.

    Examples
    --------
    >>> value, sd = telemetry_of("frequency_hz", "Natural frequency")
    >>> value["@type"], value["name"], sd["name"], sd["unit"]
    (['Telemetry', 'Frequency'], 'frequency_estimate', 'frequency_sd', 'hertz')
    """
    name, semantic, unit = _SEMANTIC.get(quantity, (quantity, None, None))
    more: Node = {} if unit is None else {"unit": unit}
    kind: Any = "Telemetry" if semantic is None else ["Telemetry", semantic]

    def one(part: str, text: str) -> Node:
        told = {"name": f"{name}_{part}", "schema": "double", "description": text}
        return {"@type": kind, **told, **more}

    return (
        one("estimate", f"{says}, as estimated each epoch."),
        one("sd", f"{says}: standard deviation of the estimate."),
    )


def as_version_2(graph: Node) -> Node:
    """Write a graph with models of DTDL version 3 with models of version 2.

    Version 2 has semantic types without an extension, and no arrays in properties: lists of
    sentences become one text.
    """
    arrays = {
        content["name"]
        for model in graph["digitalTwinsModels"]
        for content in model["contents"]
        if _is_array(content.get("schema"))
    }
    twins = [
        {name: " ".join(v) if name in arrays else v for name, v in twin.items()}
        for twin in graph["digitalTwinsGraph"]["digitalTwins"]
    ]
    return {
        **graph,
        "digitalTwinsGraph": {**graph["digitalTwinsGraph"], "digitalTwins": twins},
        "digitalTwinsModels": [_older(model) for model in graph["digitalTwinsModels"]],
    }


def _older(model: Node) -> Node:
    contents = [
        {**one, "schema": "string"} if _is_array(one.get("schema")) else one
        for one in model["contents"]
    ]
    return {**model, "@context": "dtmi:dtdl:context;2", "contents": contents}


def _is_array(schema: Any) -> bool:
    return isinstance(schema, dict) and schema.get("@type") == "Array"

"""Directives that render the REST interface and the streams of the bus from their documents."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parents[2]
METHODS = ("get", "post", "put", "patch", "delete")


def openapi() -> dict[str, Any]:
    """Return the OpenAPI document of a twin server with default settings."""
    import tempfile

    from slowtime_cli.shared.offline_twin import offline_twin
    from twin_server.pipeline import TwinKnowledge
    from twin_server.serve import Hub, create_app
    from twin_server.settings import ServeSettings

    with (
        tempfile.TemporaryDirectory() as folder,
        offline_twin(Path(folder) / "twin.sqlite") as (pipeline, store),
    ):
        return create_app(TwinKnowledge(pipeline, store), Hub(1, 1), ServeSettings()).openapi()


def cell(text: str) -> str:
    """Return a text that does not end the cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def kind(schema: Mapping[str, Any]) -> str:
    """Return the kind of values of a schema in a few words."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    for several in ("anyOf", "oneOf"):
        if several in schema:
            kinds = dict.fromkeys(kind(one) for one in schema[several])
            return " or ".join(one for one in kinds if one != "null")
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    if schema.get("type") == "array":
        return f"list of {kind(schema.get('items', {}))}"
    limits = [
        f"{sign} {schema[name]:g}"
        for name, sign in (
            ("minimum", "≥"), ("exclusiveMinimum", ">"),
            ("maximum", "≤"), ("exclusiveMaximum", "<"),
        )
        if isinstance(schema.get(name), int | float)
    ]  # fmt: skip
    return " ".join([str(schema.get("type", "any")), ", ".join(limits)]).strip()


def operation_text(method: str, path: str, operation: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of one operation, in Markdown."""
    yield f"### `{method.upper()} {path}`\n"
    yield f"{operation.get('description') or operation.get('summary', '')}\n"
    parameters = operation.get("parameters", [])
    if parameters:
        yield "| parameter | in | values | meaning |\n|---|---|---|---|"
        for one in parameters:
            name = f"`{one['name']}`" + (" (required)" if one.get("required") else "")
            values = cell(kind(one.get("schema", {})))
            yield f"| {name} | {one['in']} | {values} | {cell(one.get('description', ''))} |"
        yield ""
    body = operation.get("requestBody", {}).get("content", {})
    for media, content in body.items():
        yield f"Body: `{media}`, {kind(content.get('schema', {}))}.\n"
    yield "| status | answer | meaning |\n|---|---|---|"
    for status, answer in sorted(operation.get("responses", {}).items()):
        contents = answer.get("content", {}).items()
        told = "; ".join(f"`{media}` {kind(one.get('schema', {}))}" for media, one in contents)
        yield f"| {status} | {cell(told)} | {cell(answer.get('description', ''))} |"
    yield ""


def rest_text(document: Mapping[str, Any]) -> str:
    """Return all operations in Markdown, grouped by their first tag."""
    groups: dict[str, list[str]] = {}
    for path, item in document["paths"].items():
        for method in METHODS:
            if method in item:
                tag = (item[method].get("tags") or ["other"])[0]
                lines = operation_text(method, path, item[method])
                groups.setdefault(tag, []).extend(lines)
    parts = [f"## {tag.capitalize()}\n\n" + "\n".join(lines) for tag, lines in groups.items()]
    return "\n".join([*parts, models_text(document["components"]["schemas"])])


def models_text(schemas: Mapping[str, Any]) -> str:
    """Return the objects in requests and answers as tables."""
    lines = ["## Objects\n"]
    for name, schema in sorted(schemas.items()):
        fields = schema.get("properties", {})
        if not fields:
            continue
        lines += [f"### {name}\n", f"{schema.get('description', '')}\n"]
        lines += ["| field | values | meaning |\n|---|---|---|"]
        required = schema.get("required", ())
        for field, of in fields.items():
            called = f"`{field}`" + (" (required)" if field in required else "")
            meaning = cell(of.get("description", ""))
            lines.append(f"| {called} | {cell(kind(of))} | {meaning} |")
        lines.append("")
    return "\n".join(lines)


def streams_text() -> str:
    """Return the streams of the bus as a table."""
    document = json.loads((ROOT / "schemas/asyncapi.json").read_text())
    lines = ["| address | messages | meaning |", "|---|---|---|"]
    for channel in document["channels"].values():
        messages = ", ".join(f"`{name}`" for name in channel.get("messages", {}))
        meaning = cell(channel.get("description") or channel.get("summary") or "")
        lines.append(f"| `{channel['address']}` | {messages} | {meaning} |")
    return "\n".join(lines)


class RestReference(SphinxDirective):
    """Render every route of the REST interface."""

    def run(self) -> list[nodes.Node]:
        """Parse the generated Markdown in place."""
        return self.parse_text_to_nodes(rest_text(openapi()), allow_section_headings=True)


class Streams(SphinxDirective):
    """Render the table of streams."""

    def run(self) -> list[nodes.Node]:
        """Parse the generated Markdown in place."""
        return self.parse_text_to_nodes(streams_text())


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("rest-reference", RestReference)
    app.add_directive("streams-reference", Streams)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

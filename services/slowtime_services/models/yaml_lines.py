"""Reader of YAML 1.2 that keeps the line of each value.

Only what JSON could also say: no objects, no aliases (which a few lines can make unfold to any
size), no key twice. JSON is YAML, and read alike.
"""

import contextlib
from collections.abc import Collection, Mapping
from typing import Any

import yaml

from .core_schema import CoreLoader, FastCoreLoader

Path = tuple[str | int, ...]
DEPTH = 16
NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


class YamlError(ValueError):
    """Text that is not YAML, or more than is allowed of it."""

    def __init__(self, line: int, sentence: str) -> None:
        super().__init__(sentence)
        self.line = line


class EmptyYamlError(YamlError):
    """Text without a document."""


def read_with_lines(text: str, names: Collection[str] = ()) -> tuple[Any, Mapping[Path, int]]:
    r"""Read a document, and return the line of each key and item, counted from 1.

    Parameters
    ----------
    names
        Keys whose values, however deep, are names: kept as they are written, so that a node
        ``1.10`` is not called ``1.1``, nor one ``1e3`` ``1000.0``.

    Raises
    ------
    YamlError
        With the line at fault.

    Examples
    --------
    >>> values, lines = read_with_lines("name: rig\nnodes:\n  - {id: m1}")
    >>> values, lines["nodes", 0, "id"]
    ({'name': 'rig', 'nodes': [{'id': 'm1'}]}, 3)
    """
    # Only PyYAML's own parser says in plain words what is wrong, and where.
    with contextlib.suppress(YamlError):
        return _read(text, frozenset(names), FastCoreLoader)
    return _read(text, frozenset(names), CoreLoader)


def _read(
    text: str, names: frozenset[str], loading: type[CoreLoader | FastCoreLoader]
) -> tuple[Any, Mapping[Path, int]]:
    loader = None
    lines: dict[Path, int] = {}
    try:
        _refuse_aliases(text, loading)
        loader = loading(text)
        root = loader.get_single_node()
        if root is None:
            raise EmptyYamlError(1, "The file is empty.")
        return _values(loader, root, (), lines, names), lines
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise YamlError(
            line,
            f"This is not YAML: {error.problem or error.context}. Check indentation, "
            "colons and quotes.",
        ) from None
    except yaml.YAMLError as error:
        raise YamlError(1, f"This is not YAML: {error}") from None
    finally:
        if loader is not None:
            loader.dispose()


def _refuse_aliases(text: str, loading: type[CoreLoader | FastCoreLoader]) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=loading):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise YamlError(line, f"`*{event.anchor}` is an alias. Write the value out.")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEPTH:
            raise YamlError(
                line, f"More than {DEPTH} levels deep: no model is. Check brackets."
            )


def _values(
    loader: Any, node: yaml.Node, path: Path, lines: dict[Path, int], names: frozenset[str]
) -> Any:
    lines.setdefault(path, node.start_mark.line + 1)
    if isinstance(node, yaml.SequenceNode):
        return [
            _values(loader, item, (*path, i), lines, names) for i, item in enumerate(node.value)
        ]
    if not isinstance(node, yaml.MappingNode):
        if node.tag in NUMBERS and not names.isdisjoint(path):
            return node.value
        return _scalar(loader, node)
    values: dict[str, Any] = {}
    for key_node, value_node in node.value:
        line = key_node.start_mark.line + 1
        if not isinstance(key_node, yaml.ScalarNode):
            raise YamlError(line, "A key is no single word. Check the brackets.")
        key = str(key_node.value)
        if key in values:
            first = lines[(*path, key)]
            raise YamlError(line, f"`{key}` stands here twice, first on line {first}.")
        lines[(*path, key)] = line
        values[key] = _values(loader, value_node, (*path, key), lines, names)
    return values


def _scalar(loader: Any, node: yaml.Node) -> Any:
    """Return one value; refuse numbers of thousands of digits and invalid dates."""
    try:
        return loader.construct_object(node)
    except (ValueError, OverflowError) as error:
        line = node.start_mark.line + 1
        raise YamlError(line, f"`{str(node.value)[:40]}` is no value: {error}.") from None

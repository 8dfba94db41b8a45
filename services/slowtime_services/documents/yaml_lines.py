"""Reader of YAML 1.2 that keeps the line of each value.

Only what JSON could also say: no objects, no aliases (which a few lines can make unfold to any
size), no key twice. JSON is YAML, and read alike. Values are made from the parser's events one
by one, since a tree of nodes takes several times the memory of its values.
"""

import re
from collections.abc import Collection, Mapping
from typing import Any

import yaml

from .bounds import BOUNDS, Bounds, DocumentError, refuse_many_values
from .core_schema import CoreLoader, FastCoreLoader

Path = tuple[str | int, ...]
DEPTH = 16
"""Lists and tables within each other that a model or a problem may have [1]."""
NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
WORDED_CHARACTERS = 1 << 16
"""Size up to which a text with an error is read again by PyYAML's own parser [1], which says
in plain words what is wrong, ten times more slowly than LibYAML."""
MOST_KEYS = 10_000
"""Keys of one table at most [1]; the largest that people write have some hundreds."""
_SHORT_NUMBER = re.compile(r"[-+]?(?:0|[1-9][0-9]{0,14})(\.[0-9]{1,17})?([eE][-+]?[0-9]{1,2})?")
"""Numbers that are read without asking the loader, by far the most of a large document."""
_SHOWN = 40
"""Characters of a value that an error quotes [1]."""


class YamlError(DocumentError):
    """Text that is not YAML, or more than is allowed of it."""

    def __init__(self, line: int, sentence: str) -> None:
        super().__init__(sentence, line)
        self.line: int = line


class EmptyYamlError(YamlError):
    """Text without a document."""


class _SyntaxFault(YamlError):
    """A text that the parser refuses."""


def read_with_lines(
    text: str, names: Collection[str] = (), bounds: Bounds = BOUNDS, *, depth: int = DEPTH
) -> tuple[Any, Mapping[Path, int]]:
    r"""Read a document, and return the line of each key and item, counted from 1.

    Parameters
    ----------
    names
        Keys whose values, however deep, are names: kept as they are written, so that a node
        ``1.10`` is not called ``1.1``, nor one ``1e3`` ``1000.0``.
    bounds
        Of size and number of values.
    depth
        Lists and tables within each other at most [1]; they are read by recursion.

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
    try:
        if len(text) > bounds.most_bytes:
            raise DocumentError(
                f"It has {len(text):,} characters. Allowed: {bounds.most_bytes:,}."
            )
        refuse_many_values(text, bounds)
    except DocumentError as error:
        raise YamlError(1, str(error)) from None
    try:
        return _read(text, frozenset(names), depth, FastCoreLoader)
    except _SyntaxFault:
        if len(text) > WORDED_CHARACTERS:
            raise
    return _read(text, frozenset(names), depth, CoreLoader)


def _read(
    text: str, names: frozenset[str], depth: int, loading: type[CoreLoader | FastCoreLoader]
) -> tuple[Any, Mapping[Path, int]]:
    loader = None
    try:
        loader = loading(text)
        document = _Document(loader, names, depth)
        return document.read(), document.lines
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise _SyntaxFault(
            line,
            f"This is not YAML: {error.problem or error.context}. Check indentation, "
            "colons and quotes.",
        ) from None
    except yaml.YAMLError as error:
        raise _SyntaxFault(1, f"This is not YAML: {' '.join(str(error).split())}") from None
    finally:
        if loader is not None:
            loader.dispose()


class _Document:
    """Makes values of the events of a loader, and notes their lines."""

    def __init__(self, loader: Any, names: frozenset[str], depth: int) -> None:
        self._loader, self._names, self._depth = loader, names, depth
        self.lines: dict[Path, int] = {}

    def read(self) -> Any:
        self._loader.get_event()  # the beginning of the stream
        if self._loader.check_event(yaml.StreamEndEvent):
            raise EmptyYamlError(1, "The file is empty.")
        self._loader.get_event()
        value = self._value(self._loader.get_event(), (), 0)
        self._loader.get_event()
        if not self._loader.check_event(yaml.StreamEndEvent):
            line = self._loader.peek_event().start_mark.line + 1
            raise YamlError(line, "A second document begins here. Give one in a file.")
        return value

    def _value(self, event: Any, path: Path, depth: int) -> Any:
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise YamlError(
                line, f"`*{event.anchor[:_SHOWN]}` is an alias. Write the value out."
            )
        if isinstance(event, yaml.ScalarEvent):
            # The line of an item is kept where it is another than that of its list.
            if not path or isinstance(path[-1], str) or line != self.lines[path[:-1]]:
                self.lines.setdefault(path, line)
            return self._scalar(event, path, line)
        self.lines.setdefault(path, line)
        if depth == self._depth:
            raise YamlError(line, f"More than {self._depth} levels deep. Check brackets.")
        if isinstance(event, yaml.SequenceStartEvent):
            return self._list(path, depth + 1)
        return self._table(path, depth + 1)

    def _list(self, path: Path, depth: int) -> list[Any]:
        values: list[Any] = []
        following, first = self._loader.get_event, self.lines[path] - 1
        plain = self._names.isdisjoint(path)
        while not isinstance(event := following(), yaml.SequenceEndEvent):
            # Most items of long lists are numbers on the line of their list.
            if (
                plain
                and isinstance(event, yaml.ScalarEvent)
                and event.start_mark.line == first
                and (number := _short_number(event)) is not None
            ):
                values.append(number)
                continue
            values.append(self._value(event, (*path, len(values)), depth))
        return values

    def _table(self, path: Path, depth: int) -> dict[str, Any]:
        values: dict[str, Any] = {}
        while not isinstance(event := self._loader.get_event(), yaml.MappingEndEvent):
            line = event.start_mark.line + 1
            if not isinstance(event, yaml.ScalarEvent):
                raise YamlError(line, "A key is no single word. Check the brackets.")
            key = str(event.value)
            if key in values:
                first = self.lines[(*path, key)]
                raise YamlError(
                    line, f"`{key[:_SHOWN]}` stands here twice, first on line {first}."
                )
            if len(values) == MOST_KEYS:
                raise YamlError(
                    line, f"A table has more than {MOST_KEYS:,} keys. Check the indentation."
                )
            self.lines[(*path, key)] = line
            values[key] = self._value(self._loader.get_event(), (*path, key), depth)
        return values

    def _scalar(self, event: Any, path: Path, line: int) -> Any:
        """Return one value; refuse numbers of thousands of digits."""
        text: str = event.value
        tag = event.tag
        short = _short_number(event)
        if short is not None and self._names.isdisjoint(path):
            return short
        if tag is None or tag == "!":
            tag = self._loader.resolve(yaml.ScalarNode, text, event.implicit)
        if tag == "tag:yaml.org,2002:str" or (
            tag in NUMBERS and not self._names.isdisjoint(path)
        ):
            return text
        node = yaml.ScalarNode(tag, text, event.start_mark, event.end_mark)
        try:
            value = self._loader.construct_object(node)
        except (ValueError, OverflowError) as error:
            raise YamlError(line, f"`{text[:_SHOWN]}` is no value: {error}.") from None
        self._loader.constructed_objects.clear()  # kept for aliases, which there are none of
        return value


def _short_number(event: Any) -> int | float | None:
    """Return the value of a plain number of few digits, None for anything else."""
    if event.tag is not None or not event.implicit[0]:
        return None
    short = _SHORT_NUMBER.fullmatch(event.value)
    if short is None:
        return None
    return int(event.value) if short.lastindex is None else float(event.value)

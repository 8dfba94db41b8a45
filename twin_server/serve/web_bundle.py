"""The page's modules as one script: one request, and one that browsers may keep for good."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass

_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(
    r"^export ((?:async )?(?:function|class)\*? (\w+)|(?:const|let) )", re.MULTILINE
)
_DECLARED = re.compile(r"(?:^|, )(\w+) = ")


@dataclass(frozen=True)
class Bundle:
    """A script that may be kept for good, since its name changes with its text.

    Parameters
    ----------
    name
        File name with a digest of the text.
    text
        Of all modules.
    """

    name: str
    text: str


def bundled(sources: Mapping[str, str], first: str) -> Bundle:
    """Put a module and all that it imports into one script.

    Each module becomes an asynchronous function that gives what it exports, and runs after
    those that it imports; so names of different modules stay apart.

    Parameters
    ----------
    sources
        Text of each module by its file name. Each import names what it takes, from one file of
        the same folder: ``import { a, b } from "./c.js";``.
    first
        The module that the page begins with.

    Raises
    ------
    ValueError
        If modules import each other in a circle, one is not there, or one imports or exports in
        a form that is not known here.
    """
    done: dict[str, str] = {}
    _add(first, sources, done, ())
    text = "\n".join(done.values())
    stem, _, ending = first.partition(".")
    return Bundle(f"{stem}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.{ending}", text)


def _add(
    name: str, sources: Mapping[str, str], done: dict[str, str], above: tuple[str, ...]
) -> None:
    if name in done:
        return
    if name in above:
        raise ValueError(f"{' → '.join((*above, name))}: modules import each other.")
    if name not in sources:
        raise ValueError(
            f"{name}, which {above[-1] if above else 'the page'} needs, is missing."
        )
    for _, other in _IMPORT.findall(sources[name]):
        _add(other, sources, done, (*above, name))
    done[name] = _wrapped(name, sources[name])


def _wrapped(name: str, source: str) -> str:
    """Make a module a function of its imports that gives its exports."""
    taken = _IMPORT.sub(
        lambda found: f"const {{{found[1].replace(' as ', ': ')}}} = {_held(found[2])};\n",
        source,
    )
    exports: list[str] = []
    for found in _EXPORT.finditer(taken):
        line = taken[found.start() : taken.index("\n", found.start())]
        exports += [found[2]] if found[2] else _constants(line)
    body = _EXPORT.sub(r"\1", taken)
    strange = re.search(r"^(import|export)\b.*", body, re.MULTILINE)
    if strange:
        raise ValueError(f"{name}: {strange[0]!r} is no import or export of a known form.")
    given = ", ".join(exports)
    return f"const {_held(name)} = await (async () => {{\n{body}\nreturn {{ {given} }};\n}})();"


def _constants(line: str) -> list[str]:
    """Names that a line declares: only those outside of any brackets."""
    depth, outside = 0, []
    for sign in line.removeprefix("export ").removeprefix("const ").removeprefix("let "):
        depth += (sign in "([{") - (sign in ")]}")
        outside.append(sign if depth == 0 and sign not in ")]}" else " ")
    return _DECLARED.findall("".join(outside))


def _held(name: str) -> str:
    return "$" + re.sub(r"\W", "_", name.removesuffix(".js"))

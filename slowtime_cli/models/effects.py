"""The verb `effects`: lists the catalogue of effects, or describes some of them."""

import math
from collections.abc import Iterator, Mapping

import click

from slowtime.dynamics.effects import Kind, Parameter
from slowtime_api.effect_list import effects as listed


def effects(names: tuple[str, ...], *, markdown: bool) -> int:
    """List the catalogue, or describe the effects of these names."""
    known = listed(*names).kinds
    if names:
        lines = [line for name in names for line in _described(known[name])]
    else:
        lines = list(_markdown(known) if markdown else _listed(known))
    click.echo("\n".join(lines))
    return 0


def _listed(known: Mapping[str, Kind]) -> Iterator[str]:
    width = max(map(len, known))
    for where, kinds in _by_place(known):
        yield f"At {_article(where)}:"
        yield from (f"  {kind.name.ljust(width)}  {kind.title}" for kind in kinds)


def _by_place(known: Mapping[str, Kind]) -> Iterator[tuple[str, list[Kind]]]:
    """Give the kinds of each sort of place, as the catalogue orders them."""
    for where in dict.fromkeys(kind.where for kind in known.values()):
        yield where, [kind for kind in known.values() if kind.where == where]


def _article(where: str) -> str:
    named = {"base": "the base", "element": "an element", "input": "an input"}
    return named.get(where, f"a {where}")


def _described(kind: Kind) -> Iterator[str]:
    yield f"{kind.title} ({kind.name}), at {_article(kind.where)}"
    yield f"  {kind.sentence}"
    yield f"  equation: {kind.equation}"
    if kind.source:
        yield f"  source:   {kind.source}"
    for parameter in kind.parameters:
        yield f"  {parameter.name}: {_meaning(parameter)}"
    if kind.contains:
        yield f"  contains: {', '.join(kind.contains)}"
    if kind.similar:
        yield f"  similar to: {', '.join(kind.similar)}"


def _meaning(parameter: Parameter) -> str:
    """Meaning, unit, range and default of a parameter."""
    told = parameter.meaning + (f" [{parameter.unit}]" if parameter.unit else "")
    ends = [
        f"from {parameter.low:g}" if math.isfinite(parameter.low) else "",
        f"up to {parameter.high:g}" if math.isfinite(parameter.high) else "",
        "not 0" if parameter.nonzero else "",
    ]
    if parameter.choices:
        ends = [" or ".join(f"{choice:g}" for choice in parameter.choices)]
    if parameter.default is not None and not math.isnan(parameter.default):
        ends.append(f"{parameter.default:g} where not given")
    limits = ", ".join(end for end in ends if end)
    return f"{told}; {limits}" if limits else told


def _markdown(known: Mapping[str, Kind]) -> Iterator[str]:
    yield "# Effects"
    yield ""
    yield "`slowtime diagnose` may name these effects, and a model file may hold them under"
    yield "`effects:`. `slowtime model effects` lists them, `slowtime model effects NAME`"
    yield "describes one; you may add [effects of your own](tutorials/own_effect.md)."
    yield "This page is written by `slowtime model effects --markdown`."
    yield ""
    yield "Symbols: e is the elongation of an element (of a node, its displacement), v its"
    yield "rate, z and w are internal states, a dot is a rate of change, (…)₊ is the positive"
    yield "part, and t is the campaign time, on the clock that all records of a diagnosis"
    yield "share. Other symbols stand for the parameters listed. On a rotation read rad for m,"
    yield "and N m for N."
    for where, kinds in _by_place(known):
        yield from ("", f"## At {_article(where)}")
        for kind in kinds:
            yield from _section(kind)


def _section(kind: Kind) -> Iterator[str]:
    yield from ("", f"### {kind.title}: `{kind.name}`", "", kind.sentence, "")
    yield from (f"    {kind.equation}", "")
    for parameter in kind.parameters:
        yield f"- `{parameter.name}`: {_meaning(parameter)}"
    if kind.contains:
        names = ", ".join(f"`{name}`" for name in kind.contains)
        yield f"- contains as special or limiting cases: {names}"
    if kind.similar:
        names = ", ".join(f"`{name}`" for name in kind.similar)
        yield f"- similar to, and tried where these do not suffice: {names}"
    if kind.source:
        yield f"- source: {kind.source}"

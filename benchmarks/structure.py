"""Structure of a package's code: `python -m benchmarks.structure [package] [--check]`.

Prints modules per package, the longest functions, the longest lists of parameters, packages
that import each other, import arrows and floors between the package's children, modules that
only one other module imports, and how many numeric constants state their unit and source.
"""

import argparse
import ast
import dataclasses
import functools
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = {
    "slowtime": ROOT / "slowtime",
    "slowtime_schemas": ROOT / "schemas" / "slowtime_schemas",
    "slowtime_services": ROOT / "services" / "slowtime_services",
    "edge_agent": ROOT / "edge_agent",
    "twin_server": ROOT / "twin_server",
    "slowtime_api": ROOT / "slowtime_api",
    "slowtime_cli": ROOT / "slowtime_cli",
}
"""Import packages, and the folders that hold them."""

SHOWN = 10
"""[1] Functions that are listed, the longest first. Source: one screen holds them."""

UNIT = re.compile(r"^\[[^\]]+\]")
SOURCE = "Source:"

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class StructureLimits:
    """What `--check` allows at most, or of constants at least."""

    modules: int = 15
    """[modules] Of one package, `__init__` left out. Source: project rule."""
    lines: int = 60
    """[lines] Of one function, its docstring left out. Source: one screen."""
    parameters: int = 8
    """[1] Of one function, `self` and `cls` left out. Source: project rule."""
    cycles: int = 0
    """[1] Groups of packages that import each other. Source: pyproject.toml."""
    sourced_share: float = 1.0
    """[share] Of numeric constants that state a unit and a source. Source: project rule."""


@dataclasses.dataclass(frozen=True, slots=True)
class Definition:
    """A function or constant, where it stands, and its size."""

    size: int
    where: str


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class PackageStructure:
    """Figures of one package.

    Parameters
    ----------
    modules
        By package: how many modules stand in it.
    functions, parameters
        Lines and parameters of every function, the largest first.
    cycles
        Groups of packages that import each other.
    arrows, floors
        Imports between the package's children, and children in the longest chain of them.
    importers
        By module: how many other modules of the project import it.
    lines
        Of all modules.
    constants
        By constant: whether its docstring states a unit in brackets and a source.
    """

    modules: dict[str, int]
    functions: list[Definition]
    parameters: list[Definition]
    cycles: list[tuple[str, ...]]
    arrows: int
    floors: int
    importers: dict[str, int]
    lines: int
    constants: dict[str, bool]

    @property
    def sourced_share(self) -> float:
        """Share of numeric constants that state unit and source; 1 where there are none."""
        return sum(self.constants.values()) / len(self.constants) if self.constants else 1.0

    @property
    def single_importer_share(self) -> float:
        """Share of modules that exactly one other module imports."""
        single = sum(count == 1 for count in self.importers.values())
        return single / len(self.importers) if self.importers else 0.0


def measure(package: str) -> PackageStructure:
    """Read the source of a package and give its figures.

    Parameters
    ----------
    package
        Dotted name, such as `slowtime.discrepancy`.

    Raises
    ------
    ValueError
        Where there is no such package.
    """
    every = _parsed()
    packages = {name for name, path in _modules(SOURCES) if path.name == "__init__.py"}
    own = {n: t for n, t in every.items() if n == package or n.startswith(package + ".")}
    if package not in packages:
        raise ValueError(f"There is no package {package!r}. There are: {', '.join(SOURCES)}.")
    imports = {name: set(_imported(name, every, packages)) for name in every}
    leaves = [name for name in own if name not in packages]
    functions = [(f, f"{name}:{f.name}") for name, tree in own.items() for f in _defined(tree)]
    children = _between_children(package, imports)
    return PackageStructure(
        modules={
            holder: sum(leaf.rpartition(".")[0] == holder for leaf in leaves)
            for holder in sorted(packages & own.keys())
        },
        functions=_largest((_body_lines(f), where) for f, where in functions),
        parameters=_largest((_parameters(f), where) for f, where in functions),
        cycles=_cycles(imports, sorted(packages & own.keys())),
        arrows=sum(len(targets) for targets in children.values()),
        floors=_floors(children),
        importers={
            leaf: sum(leaf in targets for name, targets in imports.items() if name != leaf)
            for leaf in leaves
        },
        lines=sum(
            len(path.read_text().splitlines()) for n, path in _modules(SOURCES) if n in own
        ),
        constants={
            f"{name}:{constant}": stated
            for name, tree in own.items()
            for constant, stated in _constants(tree)
        },
    )


def violations(found: PackageStructure, limits: StructureLimits) -> list[str]:
    """Give a sentence for every limit that a package exceeds."""
    broken = [
        f"{package} holds {count} modules; at most {limits.modules} are allowed."
        for package, count in found.modules.items()
        if count > limits.modules
    ]
    for what, measured, most in (
        ("lines", found.functions, limits.lines),
        ("parameters", found.parameters, limits.parameters),
    ):
        broken += [
            f"{one.where} has {one.size} {what}; at most {most} are allowed."
            for one in measured
            if one.size > most
        ]
    if len(found.cycles) > limits.cycles:
        broken += [f"Packages import each other: {', '.join(c)}." for c in found.cycles]
    if found.sourced_share < limits.sourced_share:
        broken.append(
            f"{found.sourced_share:.1%} of the numeric constants state unit and source; at "
            f"least {limits.sourced_share:.1%} have to."
        )
    return broken


@functools.cache
def _parsed() -> dict[str, ast.Module]:
    """Syntax tree of every module of the project."""
    return {name: ast.parse(path.read_text()) for name, path in _modules(SOURCES)}


def _modules(sources: Mapping[str, Path]) -> Iterator[tuple[str, Path]]:
    """Every module by its dotted name; a package by that of its `__init__`."""
    for top, folder in sources.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            yield ".".join([top, *(p for p in parts if p != "__init__")]), path


def _imported(name: str, every: Mapping[str, ast.Module], packages: set[str]) -> Iterator[str]:
    """Modules that a module imports, seen through the names that packages re-export."""
    for node in ast.walk(every[name]):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in every)
        elif isinstance(node, ast.ImportFrom):
            source = _target(node, name, packages)
            for alias in node.names:
                inner = f"{source}.{alias.name}"
                if inner in every:
                    yield inner
                elif source in every:
                    yield _origin(source, alias.name, every, packages)


def _origin(
    source: str, wanted: str, every: Mapping[str, ast.Module], packages: set[str]
) -> str:
    """Find the module that defines a name which a package re-exports."""
    for node in every[source].body if source in packages else ():
        if isinstance(node, ast.ImportFrom) and any(a.name == wanted for a in node.names):
            target = _target(node, source, packages)
            return _origin(target, wanted, every, packages) if target in every else source
    return source


def _target(node: ast.ImportFrom, name: str, packages: set[str]) -> str:
    """Dotted name of the module that an import statement reads from."""
    if not node.level:
        return node.module or ""
    base = name.split(".") if name in packages else name.split(".")[:-1]
    base = base[: len(base) - node.level + 1]
    return ".".join([*base, *([node.module] if node.module else [])])


def _child(name: str, package: str) -> str | None:
    """Child of a package that holds a module."""
    return name[len(package) + 1 :].split(".")[0] if name.startswith(package + ".") else None


def _between_children(package: str, imports: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Give the imports between the children of a package."""
    found: dict[str, set[str]] = {}
    for name, targets in imports.items():
        own = _child(name, package)
        if own is not None:
            others = {_child(target, package) for target in targets} - {own, None}
            found.setdefault(own, set()).update(other for other in others if other)
    return found


def _cycles(imports: Mapping[str, set[str]], packages: Iterable[str]) -> list[tuple[str, ...]]:
    """Find groups of siblings, in any of the packages, that import each other."""
    found = []
    for package in packages:
        children = _between_children(package, imports)
        reach = {child: _reached(child, children) for child in children}
        groups = {
            tuple(sorted(f"{package}.{c}" for c in reach[child] if child in reach.get(c, ())))
            for child in children
            if child in reach[child]
        }
        found += sorted(groups)
    return found


def _reached(start: str, arrows: Mapping[str, set[str]]) -> set[str]:
    """All that is imported from a start, directly or not."""
    found: set[str] = set()
    waiting = list(arrows[start])
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.add(one)
            waiting += arrows.get(one, ())
    return found


def _floors(arrows: Mapping[str, set[str]]) -> int:
    """Children in the longest chain of imports; 0 where they form a cycle."""
    heights: dict[str, int] = {}
    waiting = dict(arrows)
    while waiting:
        ready = [n for n, below in waiting.items() if all(b not in waiting for b in below)]
        if not ready:
            return 0
        for name in ready:
            heights[name] = 1 + max((heights.get(b, 1) for b in arrows[name]), default=0)
        waiting = {name: below for name, below in waiting.items() if name not in ready}
    return max(heights.values(), default=0)


def _defined(tree: ast.Module) -> Iterator[Function]:
    return (node for node in ast.walk(tree) if isinstance(node, Function))


def _body_lines(function: Function) -> int:
    """Lines of a function, its docstring and decorators left out."""
    whole = (function.end_lineno or function.lineno) - function.lineno + 1
    first = function.body[0]
    if ast.get_docstring(function) is None:
        return whole
    return whole - ((first.end_lineno or first.lineno) - first.lineno + 1)


def _parameters(function: Function) -> int:
    """Parameters of a function, `self` and `cls` left out."""
    own = function.args
    every = [*own.posonlyargs, *own.args, *own.kwonlyargs]
    every += [one for one in (own.vararg, own.kwarg) if one is not None]
    return sum(one.arg not in ("self", "cls") for one in every)


def _largest(measured: Iterable[tuple[int, str]]) -> list[Definition]:
    return [Definition(size, where) for size, where in sorted(measured, reverse=True)]


def _constants(tree: ast.Module) -> Iterator[tuple[str, bool]]:
    """Numeric constants of a module and numeric fields of its frozen threshold classes."""
    yield from _documented(tree.body)
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and _is_threshold_class(node):
            for name, stated in _documented(node.body):
                yield f"{node.name}.{name}", stated


def _documented(body: list[ast.stmt]) -> Iterator[tuple[str, bool]]:
    """Names that are assigned numbers, and whether the next docstring has unit and source."""
    for statement, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.Assign):
            targets, value = statement.targets[0], statement.value
        elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
            targets, value = statement.target, statement.value
        else:
            continue
        if not _is_numeric(value):
            continue
        text = ""
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            text = str(after.value.value)
        # One docstring cannot state the units of several names.
        stated = bool(UNIT.match(text)) and SOURCE in text and isinstance(targets, ast.Name)
        for node in ast.walk(targets):
            if isinstance(node, ast.Name) and not node.id.startswith("__"):
                yield node.id, stated


def _is_numeric(value: ast.expr) -> bool:
    """Whether an expression is a number, or a tuple, sum or product of numbers."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.Tuple):
        return bool(value.elts) and all(_is_numeric(one) for one in value.elts)
    if isinstance(value, ast.UnaryOp):
        return _is_numeric(value.operand)
    return isinstance(value, ast.BinOp) and _is_numeric(value.left) and _is_numeric(value.right)


def _is_threshold_class(node: ast.ClassDef) -> bool:
    """Whether a class is a frozen dataclass of numbers alone."""
    frozen = any("frozen=True" in ast.unparse(one) for one in node.decorator_list)
    fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
    return (
        frozen and bool(fields) and all(one.value and _is_numeric(one.value) for one in fields)
    )


def _report(package: str, found: PackageStructure, limits: StructureLimits) -> Iterator[str]:
    yield f"# {package}: {found.lines} lines in {len(found.importers)} modules\n"
    yield f"Modules per package (at most {limits.modules}):"
    yield from (f"  {count:3d}  {name}" for name, count in found.modules.items())
    for title, measured, most in (
        ("Longest functions, docstrings left out", found.functions, limits.lines),
        ("Most parameters", found.parameters, limits.parameters),
    ):
        yield f"\n{title} (at most {most}):"
        yield from (f"  {one.size:3d}  {one.where}" for one in measured[:SHOWN])
    yield f"\nPackages that import each other: {len(found.cycles)}"
    yield from (f"  {', '.join(group)}" for group in found.cycles)
    yield f"Import arrows between children: {found.arrows}, on {found.floors} floors"
    yield f"Modules with exactly one importer: {found.single_importer_share:.1%}"
    yield (
        f"Numeric constants with unit and source: {found.sourced_share:.1%} "
        f"of {len(found.constants)}"
    )


def main(argv: list[str] | None = None) -> int:
    """Print the figures; 1 where `--check` is given and a limit is exceeded."""
    limits = StructureLimits()
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m benchmarks.structure")
    parser.add_argument("package", nargs="?", default="slowtime.discrepancy")
    parser.add_argument("--check", action="store_true", help="exit with 1 beyond a limit")
    parser.add_argument(
        "--unsourced", action="store_true", help="list constants without source"
    )
    for field in dataclasses.fields(limits):
        kind = type(field.default)
        name = "--" + field.name.replace("_", "-")
        parser.add_argument(name, type=kind, default=field.default)
    given = parser.parse_args(argv)
    limits = StructureLimits(
        **{f.name: getattr(given, f.name) for f in dataclasses.fields(limits)}
    )
    found = measure(given.package)
    print("\n".join(_report(given.package, found, limits)))
    if given.unsourced:
        print("\nWithout unit or source:")
        print("\n".join(f"  {name}" for name, stated in found.constants.items() if not stated))
    broken = violations(found, limits)
    if broken:
        print("\nBeyond the limits:")
        print("\n".join(f"  {sentence}" for sentence in broken))
    return int(given.check and bool(broken))


if __name__ == "__main__":
    raise SystemExit(main())

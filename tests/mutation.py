"""Mutation test: change random lines, and see whether the tests that run them fail.

Run as ``python -m tests.mutation --lines 200 --seed 1 --rooms slowtime twin_server``.

Everything happens in a copy of the tracked files under ``var/mutation``, in a folder named by
their content. A later call with the same content goes on where an earlier one ended:

1. Lines are drawn at random, and of each one mutation; the same seed draws the same.
2. The coverage map of the files with drawn lines is made once: the default suite runs under
   coverage, folder by folder, and each executed line is stored with the tests that executed
   it. This module is the pytest plugin for that. Other files are not traced, which takes half
   the time.
3. The tests that cover the line run on the mutated copy, as many as fit into
   `Limits.tests_s`. A mutation is killed if one fails or the run exceeds `Limits.run_s`.

Lines that no test covers are counted apart: they are untested, compiled by numba, or run in
processes that coverage does not see.
"""

import argparse
import ast
import copy
import dataclasses
import hashlib
import importlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

ROOT = Path(__file__).parents[1]
SOURCES = {"slowtime_schemas": "schemas/slowtime_schemas",
           "slowtime_services": "services/slowtime_services"}  # fmt: skip
"""Rooms whose folder is not their name."""
TIMES = "MUTATION_TIMES"
"""Environment variable: file to which the plugin writes the time of each passed test."""
MARKS = "not slow and not long and not data"


@dataclasses.dataclass(frozen=True, slots=True)
class Limits:
    """Limits of time; sources: the machine time that 200 lines may take.

    Parameters
    ----------
    run_s
        [s] Of one mutation, after which it counts as killed: it loops, or is far slower.
    tests_s
        [s] That the chosen tests took when the map was made, under coverage; a fraction of
        `run_s`, so that a run of unchanged code does not exceed that.
    map_s
        [s] Of one folder of tests while the map is made.
    """

    run_s: float = 120.0
    tests_s: float = 40.0
    map_s: float = 7200.0


LIMITS = Limits()


@dataclasses.dataclass(frozen=True, slots=True)
class Mutation:
    """A replacement of one node of the syntax tree.

    Parameters
    ----------
    path
        File, relative to the root.
    line, column
        First line of the node, from 1, and its first byte in it, from 0.
    end_line, end_column
        Its last line, and the byte after its last.
    old, new
        Source before and after.
    """

    path: str
    line: int
    column: int
    end_line: int
    end_column: int
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}  {self.old}  ->  {self.new}"

    def apply(self, source: str) -> str:
        """Return the source of the whole file with the replacement."""
        lines = source.encode().splitlines(keepends=True)
        start = sum(map(len, lines[: self.line - 1])) + self.column
        end = sum(map(len, lines[: self.end_line - 1])) + self.end_column
        whole = b"".join(lines)
        return (whole[:start] + self.new.encode() + whole[end:]).decode()


Outcome = Literal["killed", "survived", "uncovered"]

_SWAPS: dict[type[ast.AST], type[Any]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult,
    ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
_SKIPPED = (ast.JoinedStr, ast.pattern)
"""Parts without positions of their own, or where an expression in parentheses is no syntax."""


def mutants(node: ast.AST) -> Iterator[ast.AST]:
    """Return each mutation of one node.

    Examples
    --------
    >>> [ast.unparse(m) for m in mutants(ast.parse("0 < a <= 1", mode="eval").body)]
    ['0 <= a <= 1', '0 < a < 1']
    >>> [ast.unparse(m) for m in mutants(ast.parse("2.5", mode="eval").body)]
    ['5.0']
    >>> [ast.unparse(m) for m in mutants(ast.parse("not a", mode="eval").body)]
    ['a']
    """
    match node:
        case ast.Compare():
            for place, operator in enumerate(node.ops):
                compared = copy.copy(node)
                compared.ops = list(node.ops)
                compared.ops[place] = _SWAPS[type(operator)]()
                yield compared
        case ast.BinOp() | ast.BoolOp() | ast.AugAssign() if type(node.op) in _SWAPS:
            changed: Any = copy.copy(node)
            changed.op = _SWAPS[type(node.op)]()
            yield changed
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield node.operand
        case ast.Constant(value=bool() as flag):
            yield ast.Constant(not flag)
        case ast.Constant(value=int() as count):
            yield ast.Constant(count + 1)
        case ast.Constant(value=float() as number):
            yield ast.Constant(2.0 * number if number else 1.0)
        case ast.Return(value=ast.expr() as value) if not _is_none(value):
            yield ast.Return(ast.Constant(None))


def _is_none(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _executed(node: ast.AST) -> Iterator[ast.AST]:
    """Walk the tree without annotations, decorators, and parts that cannot be replaced."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "type_params"}:
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, _SKIPPED):
                yield from _executed(child)


def mutable(source: str) -> dict[int, list[ast.expr | ast.stmt]]:
    """Return the nodes of a file that have mutations, by line."""
    found: dict[int, list[ast.expr | ast.stmt]] = defaultdict(list)
    for node in _executed(ast.parse(source)):
        if isinstance(node, ast.expr | ast.stmt) and next(mutants(node), None) is not None:
            found[node.lineno].append(node)
    return dict(sorted(found.items()))


def mutations(path: str, source: str, nodes: Sequence[ast.expr | ast.stmt]) -> list[Mutation]:
    """Return all mutations of some nodes of a file, those that compile.

    Examples
    --------
    >>> source = "def f(x: int = 3) -> int:\\n    return x + 1\\n"
    >>> [m.new for nodes in mutable(source).values() for m in mutations("f.py", source, nodes)]
    ['(4)', 'return None', '(x - 1)', '(2)']
    """
    found = []
    for node in nodes:
        old = " ".join((ast.get_source_segment(source, node) or "").split())
        ends = node.end_lineno or node.lineno, node.end_col_offset or node.col_offset
        for changed in mutants(node):
            new = ast.unparse(ast.fix_missing_locations(changed))
            new = new if isinstance(node, ast.stmt) else f"({new})"
            mutation = Mutation(path, node.lineno, node.col_offset, *ends, old, new)
            try:
                compile(mutation.apply(source), path, "exec")
            except SyntaxError:
                continue
            found.append(mutation)
    return found


def draw(files: dict[str, str], lines: int, seed: int) -> list[Mutation]:
    """Draw lines at random without replacement, and of each one mutation.

    Parameters
    ----------
    files
        Source of each file, by path.
    lines
        How many lines.
    seed
        Of the generator.
    """
    places = [
        (path, nodes)
        for path, source in sorted(files.items())
        for nodes in mutable(source).values()
    ]
    generator = random.Random(seed)
    drawn: list[Mutation] = []
    for path, nodes in generator.sample(places, len(places)):
        if len(drawn) == lines:
            break
        if choices := mutations(path, files[path], nodes):
            drawn.append(generator.choice(choices))
    return drawn


@dataclasses.dataclass(frozen=True, slots=True)
class Copy:
    """A copy of the tracked files, with its coverage map and the results so far."""

    home: Path
    rooms: tuple[str, ...]

    @property
    def tree(self) -> Path:
        """Root of the copy."""
        return self.home / "tree"

    @property
    def folders(self) -> list[str]:
        """Folders of the rooms, relative to the root."""
        return [SOURCES.get(room, room) for room in self.rooms]

    def run(
        self, arguments: Sequence[str], timeout_s: float, **more: str
    ) -> subprocess.CompletedProcess[str]:
        """Run Python in the copy, so that it imports the copy and nothing else."""
        paths = [self.tree, self.tree / "schemas", self.tree / "services"]
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join([*map(str, paths), os.environ.get("PYTHONPATH", "")]),
            "OPENBLAS_NUM_THREADS": "1",
        }
        return subprocess.run(
            [sys.executable, *arguments], cwd=self.tree, env=environment | more, text=True,
            capture_output=True, timeout=timeout_s, check=False,
        )  # fmt: skip


def tracked() -> list[str]:
    """Return the tracked files of the project that exist."""
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    return [name for name in listed if (ROOT / name).is_file()]


def make_copy(out: Path, rooms: Sequence[str]) -> Copy:
    """Copy the tracked files to a folder that is named by their content."""
    names = tracked()
    digest = hashlib.sha256()
    for name in names:
        if name.endswith((".py", ".toml")):
            digest.update(name.encode() + b"\0" + (ROOT / name).read_bytes())
    made = Copy(out / digest.hexdigest()[:12], tuple(rooms))
    for name in names:  # also where it was made before: a run that was killed leaves a mutation
        target = made.tree / name
        if not target.exists() or target.read_bytes() != (ROOT / name).read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target)
            _forget_compiled(target)
    return made


def _forget_compiled(path: Path) -> None:
    """Remove the compiled forms of a module: they are told apart by whole seconds and size."""
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
        compiled.unlink()


def folders_of_tests(made: Copy, chosen: Sequence[str]) -> list[str]:
    """Return the folders and files of tests of which a part of the map is made each."""
    if chosen:
        return list(chosen)
    folders = {str(Path(n).parent) for n in tracked() if Path(n).name.startswith("test_")}
    return [*sorted(folders), *made.folders]  # the rooms for their doctests


def make_map(made: Copy, tests: Sequence[str], files: Sequence[str]) -> "Coverage":
    """Run tests under coverage, as far as this has not been done, and return the map.

    Parameters
    ----------
    made
        The copy.
    tests
        Folders and files of tests.
    files
        Files whose lines are traced.
    """
    parts = []
    traced = hashlib.sha256("\n".join(files).encode()).hexdigest()[:8]
    for place in tests:
        base = made.home / f"map-{traced}" / place.replace("/", "+")
        data, times = base.with_name(f"{base.name}.sqlite"), base.with_name(f"{base.name}.json")
        if not times.exists():
            print(f"coverage map: {place}", flush=True)
            base.parent.mkdir(parents=True, exist_ok=True)
            data.unlink(missing_ok=True)
            chosen = [
                str(one.relative_to(made.tree)) for one in (made.tree / place).glob("test_*.py")
            ]
            run = made.run(
                [
                    "-m", "coverage", "run", f"--data-file={data}",
                    f"--include={','.join(str(made.tree / one) for one in files)}",
                    "-m", "pytest", "-q",
                    "-p", "tests.mutation", "-p", "no:cacheprovider", "-m", MARKS,
                    *(chosen or [place]),
                ],
                LIMITS.map_s,
                **{TIMES: str(times)},
            )  # fmt: skip
            if not times.exists():
                raise SystemExit(
                    f"The tests of {place} did not run under coverage:\n{run.stdout[-2000:]}"
                    f"{run.stderr[-2000:]}\nMend that, or choose others with --tests."
                )
        parts.append((data, times))
    return Coverage(made, parts)


class Coverage:
    """The tests that cover each line, and how long each takes."""

    def __init__(self, made: Copy, parts: Sequence[tuple[Path, Path]]) -> None:
        coverage = importlib.import_module("coverage")
        self._tree = made.tree
        self._times: dict[str, float] = {}
        self._parts: list[Any] = []
        for data, times in parts:
            self._times |= json.loads(times.read_text())
            if data.exists():
                part = coverage.CoverageData(str(data))
                part.read()
                self._parts.append(part)

    def tests(self, mutation: Mutation) -> list[str]:
        """Return the tests that execute a mutated line, those of its module first.

        Lines that run when a module is imported have no test of their own: then all tests that
        execute another line of the file are asked.
        """
        path = str(self._tree / mutation.path)
        lines = range(mutation.line, mutation.end_line + 1)
        own: set[str] = set()
        imported: set[str] = set()
        executed = False
        for part in self._parts:
            for line, contexts in part.contexts_by_lineno(path).items():
                found = {one for one in contexts if one in self._times}
                imported |= found
                if line in lines:
                    executed = True
                    own |= found
        chosen = own or (imported if executed else set())
        stem = Path(mutation.path).stem
        return sorted(
            chosen, key=lambda one: (f"test_{stem}.py" not in one, self._times[one], one)
        )

    def affordable(self, tests: Sequence[str]) -> list[str]:
        """Return as many tests, in their order, as fit into the limit of time."""
        chosen: list[str] = []
        total = 0.0
        for test in tests:
            total += self._times[test]
            if chosen and total > LIMITS.tests_s:
                break
            chosen.append(test)
        return chosen


def judge(made: Copy, mutation: Mutation, tests: Sequence[str]) -> Outcome:
    """Run tests on the mutated copy, and put the file back."""
    target = made.tree / mutation.path
    source = target.read_bytes()
    asked = made.home / "tests.txt"
    asked.write_text("\n".join(tests) + "\n")
    try:
        target.write_text(mutation.apply(source.decode()))
        _forget_compiled(target)
        run = made.run(
            ["-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", f"@{asked}"], LIMITS.run_s
        )
    except subprocess.TimeoutExpired:
        return "killed"
    finally:
        target.write_bytes(source)
        _forget_compiled(target)
    if run.returncode == 5:
        raise SystemExit(f"pytest found none of the tests of {mutation}:\n{run.stdout[-2000:]}")
    return "killed" if run.returncode else "survived"


def measure(
    made: Copy, drawn: Sequence[Mutation], covered: Coverage, kept: Path
) -> dict[str, Outcome]:
    """Judge each mutation that no earlier run has judged.

    Parameters
    ----------
    made
        The copy.
    drawn
        Mutations.
    covered
        The coverage map.
    kept
        File of the outcomes, to which each is added as it is known.

    Returns
    -------
    Outcome by mutation, in the order in which they were drawn.
    """
    known: dict[str, Outcome] = {}
    if kept.exists():
        known = dict(json.loads(line) for line in kept.read_text().splitlines())
    outcomes: dict[str, Outcome] = {}
    for place, mutation in enumerate(drawn):
        key = str(mutation)
        if key not in known:
            covering = covered.tests(mutation)
            tests = covered.affordable(covering)
            began = time.monotonic()
            known[key] = judge(made, mutation, tests) if tests else "uncovered"
            with kept.open("a") as file:
                file.write(json.dumps([key, known[key]]) + "\n")
            asked = f"{len(tests)} of {len(covering)} tests"
            took = f"{asked}, {time.monotonic() - began:.0f} s"
            print(f"{place + 1}/{len(drawn)} {known[key]:9} {key}  ({took})", flush=True)
        outcomes[key] = known[key]
    return outcomes


def summary(outcomes: dict[str, Outcome]) -> str:
    """Return the survivors, the lines without a test, and the share killed.

    Examples
    --------
    >>> print(summary({"a.py:1:4  x  ->  y": "killed", "b.py:2:8  0  ->  (1)": "survived"}))
    survived:
      b.py:2:8  0  ->  (1)
    killed 1 of 2 (50 %); covered by no test: 0
    """
    lines = []
    for outcome, title in (("survived", "survived:"), ("uncovered", "covered by no test:")):
        if which := [key for key, found in outcomes.items() if found == outcome]:
            lines += [title, *(f"  {key}" for key in which)]
    found = list(outcomes.values())
    killed, bare = found.count("killed"), found.count("uncovered")
    of = len(found) - bare
    share = f" ({killed / of:.0%})".replace("%", " %") if of else ""
    return "\n".join([*lines, f"killed {killed} of {of}{share}; covered by no test: {bare}"])


def main() -> None:
    """Make the map, judge the mutations, and print the survivors."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation")
    parser.add_argument("--lines", type=int, default=200, help="How many lines to mutate.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--rooms", nargs="+", default=["slowtime", "twin_server", "edge_agent"],
        help="Packages whose lines are mutated.",
    )  # fmt: skip
    parser.add_argument(
        "--files", nargs="*", default=[],
        help="Mutate lines only of files and folders that begin so.",
    )  # fmt: skip
    parser.add_argument(
        "--tests", nargs="*", default=[],
        help="Folders or files of the tests; by default the whole default suite.",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=ROOT / "var" / "mutation")
    given = parser.parse_args()
    made = make_copy(given.out.resolve(), given.rooms)
    starts = tuple(given.files) or tuple(f"{folder}/" for folder in made.folders)
    files = {
        name: (made.tree / name).read_text()
        for name in tracked()
        if name.endswith(".py")
        and name.startswith(starts)
        and name.startswith(tuple(f"{folder}/" for folder in made.folders))
    }
    tests = folders_of_tests(made, given.tests)
    drawn = draw(files, given.lines, given.seed)
    covered = make_map(made, tests, sorted({mutation.path for mutation in drawn}))
    asked = hashlib.sha256("\n".join(tests).encode()).hexdigest()[:8]
    print(summary(measure(made, drawn, covered, made.home / f"results-{asked}.jsonl")))


class _Times:
    """Plugin: tells coverage which test runs, and keeps the times of those that passed."""

    def __init__(self, path: Path) -> None:
        self._path, self._times, self._spoilt = path, defaultdict[str, float](float), set[str]()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Begin the context of a test, its fixtures included."""
        coverage = importlib.import_module("coverage").Coverage.current()
        coverage.switch_context(nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """End it."""
        importlib.import_module("coverage").Coverage.current().switch_context("")

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add the time of one phase of a test."""
        self._times[report.nodeid] += report.duration
        if report.outcome != "passed":
            self._spoilt.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        """Write the times of the tests that passed."""
        passed = {t: s for t, s in self._times.items() if t not in self._spoilt}
        self._path.write_text(json.dumps(passed))


def pytest_configure(config: Any) -> None:
    """Join pytest, where this module is given to it as a plugin."""
    if path := os.environ.get(TIMES):
        config.pluginmanager.register(_Times(Path(path)))


if __name__ == "__main__":
    main()

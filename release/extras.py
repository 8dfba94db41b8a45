"""Install the wheel with each extra alone and type every command: `python -m release.extras`.

Each installation is an environment of its own. In it the examples that the help of each command
ends with are run, and some lines that need one extra only. A line *answers* if it ends with
success, and *names the extra* if it says what to install. Anything else is a fault: a
traceback, an internal error, or a missing library that is asked for by no command.
"""

import argparse
import contextlib
import dataclasses
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

from slowtime_cli.shared.examples import ENDLESS_VERBS, EXAMPLES

ROOT = Path(__file__).parents[1]
FOR_DEVELOPERS = frozenset({"dev", "docs", "peers", "peers-jax", "peers-torch"})
"""Extras that no command of a user needs."""
LARGE = frozenset({"ray"})
"""Extras of hundreds of megabytes, which are tried only if they are named."""
PATIENCE_S = 180.0
"""Longest time that one line may take [s]: ten times what the slowest takes on a free core."""
ENDLESS_S = 15.0
"""After so long, a command that runs until Ctrl-C has started [s]."""
TERMINATION_S = 20.0
"""Longest time in which what a line has started ends when asked [s]: the demo ends its
processes one after the other, and kills them after 8 s."""
NAMED = re.compile(r"slowtime\[\w+\]|pip install \w+")
"""How a message names what to install."""
FAULTY = re.compile(r"Traceback \(most recent call last\)|Internal error|ModuleNotFoundError")

READ = (
    'python -c "import pathlib; from slowtime_services.files import read_record; '
    "print(read_record(pathlib.Path('{name}'), rate_hz=50.0).rate_hz)\""
)
SOURCE = "timeout 10 slowtime edge --spool spool --channels x --source '{url}'"
LINES: Mapping[str, tuple[str, str]] = {
    "HDF5 file": ("hdf5", READ.format(name="a.h5")),
    "Excel file": ("formats", READ.format(name="a.xlsx")),
    "Parquet file": ("parquet", READ.format(name="a.parquet")),
    "plot": (
        "plots",
        "python -c \"import slowtime as st; st.read('a.csv', rate_hz=50.0).plot('a.png')\"",
    ),
    "table": (
        "tables",
        'python -c "import slowtime as st; '
        "print(len(st.read('a.csv', rate_hz=50.0).to_dataframe()))\"",
    ),
    "MQTT source": ("mqtt", SOURCE.format(url="mqtt://127.0.0.1:1/a?rate_hz=50")),
    "serial source": ("serial", SOURCE.format(url="serial:///dev/null?rate_hz=50")),
    "OPC UA source": ("opcua", SOURCE.format(url="opcua://127.0.0.1:1/?node=i=1&rate_hz=50")),
    "traces": (
        "telemetry",
        "OTEL_EXPORTER_OTLP_ENDPOINT=http://127.0.0.1:1 timeout 10 slowtime router "
        "--listen tcp/127.0.0.1:0",
    ),
}
"""What is tried → the extra that it needs, and the line."""


@dataclasses.dataclass(frozen=True, slots=True)
class LineResult:
    """What a line came to."""

    line: str
    verdict: str
    """"answers", "names the extra" or "fault"."""
    said: str
    """The last line of its output."""


def extras_of(project: Path = ROOT / "pyproject.toml") -> tuple[str, ...]:
    """Return the extras that users install."""
    table = tomllib.loads(project.read_text())["project"]["optional-dependencies"]
    return tuple(name for name in table if name not in FOR_DEVELOPERS)


def verdict_of(status: int, output: str, *, ended_by_us: bool = False) -> str:
    """Judge a line by its exit status and output.

    Parameters
    ----------
    status
        Exit status of the shell.
    output
        Standard output and standard error.
    ended_by_us
        Whether it was ended because it runs until Ctrl-C.

    Returns
    -------
    One of "answers", "names the extra" and "fault".

    Examples
    --------
    >>> verdict_of(0, "3.2 Hz"), verdict_of(2, "`pip install 'slowtime[twin]'` installs ...")
    ('answers', 'names the extra')
    >>> verdict_of(1, "ModuleNotFoundError: fastapi"), verdict_of(124, "", ended_by_us=True)
    ('fault', 'answers')
    >>> verdict_of(1, "ImportError: slowtime.read needs mcap. pip install 'slowtime[analysis]'")
    'names the extra'
    """
    last = next((line for line in reversed(output.splitlines()) if line.strip()), "")
    if status and NAMED.search(last):  # an exception of the Python interface says it too
        return "names the extra"
    if FAULTY.search(output):
        return "fault"
    if NAMED.search(output) and (status != 0 or "is missing" in output):
        return "names the extra"
    return "answers" if status == 0 or ended_by_us else "fault"


def shortened(line: str) -> str:
    """Return an example with shorter waits: whether it starts is asked, not what it computes.

    Examples
    --------
    >>> shortened("slowtime demo --duration 60 & sleep 25; slowtime twin alarms deliveries a.b")
    'slowtime demo --duration 40 & sleep 20; slowtime twin alarms deliveries a.b'
    """
    line = line.replace("--duration 60", "--duration 40").replace("sleep 25", "sleep 20")
    return line.replace("--duration 30", "--duration 15")


def install(wheel: Path, extra: str, folder: Path) -> Path:
    """Make an environment with the wheel and one extra; return its folder of programs."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    wanted = f"{wheel}[{extra}]" if extra else str(wheel)
    command = [
        sys.executable, "-m", "pip", "--python", str(programs / "python"), "--quiet",
        "--disable-pip-version-check", "install", "-c", str(ROOT / "constraints.txt"), wanted,
    ]  # fmt: skip
    subprocess.run(command, check=True)
    return programs


def type_line(line: str, programs: Path, folder: Path, patience_s: float) -> tuple[int, str]:
    """Run a line of bash in a folder, with an environment's programs first; status, output."""
    outer = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    path = f"{programs}{os.pathsep}{os.environ['PATH']}"
    with (folder / "said.txt").open("w+") as said:
        started = subprocess.Popen(
            ["bash", "-c", line], cwd=folder, stdout=said, stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL, env=outer | {"PATH": path}, start_new_session=True,
        )  # fmt: skip
        try:
            status = started.wait(patience_s)
        except subprocess.TimeoutExpired:
            status = 124
        end_group(started)
        said.seek(0)
        return status, said.read()


def end_group(started: "subprocess.Popen[bytes]", patience_s: float = TERMINATION_S) -> None:
    """End a line and what it has started in the background.

    Processes of `slowtime demo` are in groups of their own. Only `slowtime demo` can end them,
    so it is asked first, and killed if it has not ended in time.

    Parameters
    ----------
    started
        Shell of the line, the first of its group.
    patience_s
        How long the group may take to end by itself [s].
    """
    until_s = time.monotonic() + patience_s
    with contextlib.suppress(ProcessLookupError):
        os.killpg(started.pid, signal.SIGTERM)
        while time.monotonic() < until_s:
            started.poll()  # else the ended shell stays in its group
            os.killpg(started.pid, 0)
            time.sleep(0.05)
        os.killpg(started.pid, signal.SIGKILL)
    started.wait()


def sample_files(folder: Path) -> None:
    """Write one record in the formats that need an extra, by the libraries of this Python."""
    import h5py
    import numpy as np
    import openpyxl
    import pyarrow
    import pyarrow.parquet

    values = np.sin(0.3 * np.arange(400.0))
    np.savetxt(folder / "a.csv", values, header="x", comments="")
    with h5py.File(folder / "a.h5", "w") as file:
        file["x"] = values
    book = openpyxl.Workbook()
    for value in ("x", *values.tolist()):
        book.active.append([value])
    book.save(folder / "a.xlsx")
    pyarrow.parquet.write_table(pyarrow.table({"x": values}), folder / "a.parquet")


def answers(programs: Path, extra: str, verbs: tuple[str, ...]) -> Iterator[LineResult]:
    """Type the examples of all commands and the lines of single extras in an environment."""
    for verb in verbs:
        endless = verb in ENDLESS_VERBS
        with tempfile.TemporaryDirectory() as folder:
            status, said = type_line(
                shortened(EXAMPLES[verb]), programs, Path(folder),
                ENDLESS_S if endless else PATIENCE_S,
            )  # fmt: skip
        yield LineResult(verb, verdict_of(status, said, ended_by_us=endless), _last(said))
    for name, (needed, line) in LINES.items():
        with tempfile.TemporaryDirectory() as folder:
            sample_files(Path(folder))
            status, said = type_line(line, programs, Path(folder), PATIENCE_S)
        verdict = verdict_of(status, said, ended_by_us=status == 124 or "source" in name)
        if verdict == "names the extra" and needed == extra:
            verdict = "fault"
        yield LineResult(name, verdict, _last(said))


def _last(said: str) -> str:
    lines = [line for line in said.splitlines() if line.strip()]
    named = [line for line in lines if NAMED.search(line)]
    return (named or lines or [""])[-1].strip()[:160]


def built_wheel(folder: Path) -> Path:
    """Build the wheel of this checkout."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def main() -> int:
    """Try every extra; 1 where a line neither answers nor names what it needs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", nargs="+", help="extras to try; 'none' is the bare wheel")
    parser.add_argument("--verbs", nargs="+", default=list(EXAMPLES), help="commands to type")
    given = parser.parse_args()
    tried = given.only or ["none", *(name for name in extras_of() if name not in LARGE)]
    faults = 0
    with tempfile.TemporaryDirectory() as home:
        wheel = built_wheel(Path(home))
        for extra in tried:
            plain = "" if extra == "none" else extra
            with tempfile.TemporaryDirectory() as folder:
                programs = install(wheel, plain, Path(folder) / "venv")
                found = list(answers(programs, plain, tuple(given.verbs)))
            counts = [
                sum(one.verdict == kind for one in found) for kind in ("answers", "fault")
            ]
            print(
                f"{extra:10} {counts[0]:3} answer, {len(found) - sum(counts):3} name an extra, "
                f"{counts[1]:3} faults",
                flush=True,
            )
            for one in found:
                if one.verdict == "fault":
                    faults += 1
                    print(f"    {one.line}: {one.said}", flush=True)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

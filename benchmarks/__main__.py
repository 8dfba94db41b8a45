"""Run every benchmark, one after the other: `python -m benchmarks`."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from .methods import (
    forecasts,
    identification,
    maintenance,
    modal_accuracy,
    plant,
    repairs,
)
from .methods.calibration import bench as calibration_bench
from .processes import (
    edge_startup,
    ingestion,
    ledger,
    server,
    shared_diagnosis,
    startup,
    streaming,
    throughput,
    transport,
)

TRUTH_RUNS = 8
"""Runs of each structure of known modes [1]: a minute or two; 300 take most of an hour."""

PEERS = Path(__file__).parents[1] / ".venv-peers/bin/python"
"""Interpreter with the libraries to compare with, which `make bench` sets up."""


def main() -> int:
    """Print every figure; return 1 where one lies outside what it is held to."""
    runs: tuple[tuple[str, Callable[[], int | None]], ...] = (
        ("Start-up of the command", startup.main),
        ("An edge agent before its first sample", edge_startup.main),
        ("One diagnosis shared by two processes", lambda: shared_diagnosis.main([])),
        ("Identification at the limit", lambda: identification.main([])),
        (
            "Modes of simulated structures",
            lambda: modal_accuracy.main(["--runs", str(TRUTH_RUNS)]),
        ),
        ("Fast sensors and long files", lambda: streaming.main([])),
        (
            "Modes of many channels, beside pyOMA-2 and without end",
            lambda: _beside_peers("modal"),
        ),
        (
            "Modal tests, beside sdypy-EMA and pyOMA-2",
            lambda: _beside_peers("modal_testing", "--merging-seeds", "3"),
        ),
        (
            "Filters and streaming processes, beside filterpy and scikit-learn",
            lambda: _beside_peers("filters"),
        ),
        (
            "Reliability, beside OpenTURNS and pystra",
            lambda: _beside_peers("reliability", "--methods", "importance", "--seeds", "3"),
        ),
        ("Maintenance of simulated fleets", lambda: maintenance.main(["--fleets", "3"])),
        (
            "Fatigue, beside rainflow and fatpack, and at the edge",
            lambda: _beside_peers("fatigue"),
        ),
        ("Forecasts", lambda: forecasts.main([])),
        (
            "Forecasts of hidden laws, beside an oracle",
            lambda: calibration_bench.main(["--histories", "3"]),
        ),
        ("Forecasts across repairs", lambda: repairs.main(["--histories", "20"])),
        ("Models with effects", plant.main),
        ("Transport and recordings", transport.main),
        ("Messages of one and of a thousand assets", ingestion.main),
        ("The ledger", lambda: ledger.main([])),
        (
            "Long histories and many callers of the server",
            lambda: server.main(["--readings", "100000", "--seconds", "10", "--rest", "10"]),
        ),
        ("The whole flow", throughput.main),
    )
    status = 0
    for number, (title, run) in enumerate(runs):
        print(("\n" if number else "") + f"# {title}\n")
        sys.stdout.flush()
        status |= run() or 0
    return status


def _beside_peers(name: str, *arguments: str) -> int:
    """Run a benchmark of `methods` in the environment of the peers, where there is one."""
    python = str(PEERS) if PEERS.exists() else sys.executable
    command = [python, "-m", f"benchmarks.methods.{name}", *arguments]
    return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())

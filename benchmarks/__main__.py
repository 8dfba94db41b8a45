"""Run every benchmark, one after the other: `python -m benchmarks`."""

import subprocess
import sys
from pathlib import Path

from . import (
    door,
    edge,
    flow,
    foresight,
    identification,
    ledger,
    maintenance,
    modal_truth,
    plant,
    repairs,
    startup,
    streaming,
    transport,
)

TRUTH_RUNS = 8
"""Of each structure of known modes: a minute or two; 300 take the better part of an hour."""

PEERS = Path(__file__).parents[1] / ".venv-peers/bin/python"


def main() -> int:
    """Print every figure; 1 where one lies outside what it is held to."""
    print("# Start-up of the command\n")
    status = startup.main()
    print("\n# An edge agent before its first sample\n")
    status |= edge.main()
    print("\n# Identification at the limit\n")
    status |= identification.main([])
    print("\n# Modes of simulated structures\n")
    status |= modal_truth.main(["--runs", str(TRUTH_RUNS)])
    print("\n# Fast sensors and long files\n")
    status |= streaming.main([])
    print("\n# Modes of many channels, beside pyOMA-2 and without end\n")
    sys.stdout.flush()
    # Peers have an environment of their own, which `make bench` sets up.
    python = str(PEERS) if PEERS.exists() else sys.executable
    status |= subprocess.run([python, "-m", "benchmarks.modal"], check=False).returncode
    print("\n# Filters and streaming processes, beside filterpy and scikit-learn\n")
    sys.stdout.flush()
    status |= subprocess.run([python, "-m", "benchmarks.learning"], check=False).returncode
    print("\n# Reliability, beside OpenTURNS and pystra\n")
    sys.stdout.flush()
    reliability = ["-m", "benchmarks.reliability", "--methods", "importance", "--seeds", "3"]
    status |= subprocess.run([python, *reliability], check=False).returncode
    print("\n# Maintenance of simulated fleets\n")
    status |= maintenance.main(["--fleets", "3"])
    print("\n# Fatigue, beside rainflow and fatpack, and at the edge\n")
    sys.stdout.flush()
    status |= subprocess.run([python, "-m", "benchmarks.fatigue"], check=False).returncode
    print("\n# Forecasts\n")
    status |= foresight.main([])
    print("\n# Forecasts across repairs\n")
    status |= repairs.main(["--histories", "20"])
    print("\n# Models with effects\n")
    status = plant.main() or status
    print("\n# Transport and recordings\n")
    transport.main()
    print("\n# The ledger\n")
    ledger.main([])
    print("\n# The door: long histories, many callers\n")
    sys.stdout.flush()
    status |= door.main(["--readings", "100000", "--seconds", "10", "--rest", "10"])
    print("\n# The whole flow\n")
    flow.main()
    return status


if __name__ == "__main__":
    sys.exit(main())

"""Diagnose the same effects by all excitations: ``python -m tests.blind.excitations``."""

import sys

from tests.blind.battery import Battery, run_battery

from . import cases, verdicts

EXCITATIONS = Battery(
    "excitations", cases.draw, cases.build, verdicts.excitation_row, verdicts.line_of,
    verdicts.tabulate, verdicts.text_of,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(run_battery(EXCITATIONS, sys.argv[1:]))

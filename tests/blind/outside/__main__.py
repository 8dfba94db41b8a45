"""Diagnose laws that are in no list: ``python -m tests.blind.outside --cases 64``."""

import sys

from tests.blind.battery import Battery, run_battery

from . import cases, verdicts

OUTSIDE = Battery(
    "outside", cases.draw, cases.build, verdicts.verdict_row, verdicts.line_of,
    verdicts.tabulate, verdicts.text_of,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(run_battery(OUTSIDE, sys.argv[1:]))

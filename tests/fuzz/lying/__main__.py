"""Table of all lying files: python -m tests.fuzz.lying [NAME ...]."""

import sys

from .cases import Case
from .test_lying_files import AWAY, CASES, MOST_MIB, MOST_S, _cost, honest


def _row(case: Case) -> str:
    kind = Case("honest", case.file, case.honest, case.honest, case.command)
    usual, lying = honest(kind), _cost(case, case.lying)
    seconds, mib = lying.processor_s - usual.processor_s, lying.peak_mib - usual.peak_mib
    refused = lying.status == 2 or (case.harmless and lying.status == 0)
    refused &= AWAY not in lying.said and (usual.status == 0 or AWAY in usual.said)
    good = refused and seconds < MOST_S and mib < MOST_MIB
    said = " ".join(lying.said.split())[-160:]
    return (
        f"{'' if good else 'FAILS '}{case.name}: status {lying.status}, {seconds:+.2f} s, "
        f"{mib:+.0f} MiB beyond {usual.processor_s:.2f} s and {usual.peak_mib:.0f} MiB: {said}"
    )


if __name__ == "__main__":
    for one in CASES:
        if len(sys.argv) < 2 or any(one.name.startswith(name) for name in sys.argv[1:]):
            print(_row(one), flush=True)

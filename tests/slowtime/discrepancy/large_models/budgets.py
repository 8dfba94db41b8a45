"""Diagnoses of large models within the budget that they get by themselves."""

import resource
import time

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime.discrepancy.records import Campaign
from slowtime.dynamics.work import metered

WORK = 350 * 2.3e8
"""[units of work] Budget that a diagnosis of many coordinates gets by itself."""
MOST_S = 400.0
"""[s] Processor time of one diagnosis on a machine of two cores."""
MOST_KB = 2_000_000


def diagnosed(given: Campaign, work: float = WORK) -> tuple[Diagnosis, float, int]:
    """Diagnose a campaign; give the processor time [s] and the peak memory [KiB], too."""
    begun = time.process_time()
    with metered() as meter:
        answer = diagnose(
            given, late=lambda: meter.spent > 0.7 * work, over=lambda: meter.spent > work
        )
    spent = time.process_time() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{answer.verdict}: {spent:.0f} s of processor time, {peak / 1e6:.2f} GB")
    return answer, spent, peak

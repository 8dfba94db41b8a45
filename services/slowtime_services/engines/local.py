"""The engine of one machine: as many processes beside each other as it has cores."""

import concurrent.futures
import dataclasses
import threading
from collections.abc import Generator, Sequence

from .cores import usable_cores
from .jobs import Engine, Job, JobEnd, JobLimits, run_job


@dataclasses.dataclass(frozen=True, slots=True)
class LocalEngine(Engine):
    """Processes of this machine.

    Parameters
    ----------
    workers
        How many run beside each other; 0 for one on each core that this process may use.
    """

    workers: int = 0

    def run(
        self, jobs: Sequence[Job], limits: JobLimits, stop: threading.Event
    ) -> Generator[JobEnd, None, None]:
        """Run jobs, and give the outcome of each as it ends."""
        workers = self.workers or usable_cores()
        with concurrent.futures.ThreadPoolExecutor(workers) as pool:
            running = [pool.submit(_run_unless_stopped, job, limits, stop) for job in jobs]
            try:
                for one in concurrent.futures.as_completed(running):
                    outcome = one.result()
                    if outcome is not None and outcome.status != "cancelled":
                        yield outcome
            finally:
                # Also where the caller takes no more: no process outlives the run.
                if not all(one.done() for one in running):
                    stop.set()


def _run_unless_stopped(job: Job, limits: JobLimits, stop: threading.Event) -> JobEnd | None:
    return None if stop.is_set() else run_job(job, limits, stop)

"""The engine of several machines: Ray, which an extra installs."""

import dataclasses
import threading
from collections.abc import Iterator, Sequence
from typing import Any

from .jobs import Engine, Job, JobEnd, JobLimits, run_job
from .local import LocalEngine

WAIT_S = 0.5
"""[s] Between two looks at whether the run was stopped."""
INSTALL = "Ray is missing. Install it: pip install 'slowtime[ray]'"


@dataclasses.dataclass(frozen=True, slots=True)
class RayEngine(Engine):
    """Tasks of a Ray cluster, one core each; a task whose node is lost runs again elsewhere.

    Parameters
    ----------
    address
        Of the cluster, as `ray.init` takes it; a cluster on this machine if empty.
    """

    address: str = ""

    def run(
        self, jobs: Sequence[Job], limits: JobLimits, stop: threading.Event
    ) -> Iterator[JobEnd]:
        """Run jobs, and give the outcome of each as it ends.

        Raises
        ------
        ModuleNotFoundError
            If Ray is not installed; says how to install it.
        ConnectionError
            If no cluster answers at the address.
        """
        ray = import_ray()
        ray.init(address=self.address or "local", log_to_driver=False, logging_level="error")
        task = ray.remote(num_cpus=1, max_retries=limits.retries)(run_job)
        left = {task.remote(job, limits): job for job in jobs}
        try:
            while left and not stop.is_set():
                ended, _ = ray.wait(list(left), num_returns=1, timeout=WAIT_S)
                for one in ended:
                    yield _outcome(ray, one, left.pop(one))
        finally:
            for one in left:
                ray.cancel(one, force=True)
            ray.shutdown()


def _outcome(ray: Any, ended: Any, job: Job) -> JobEnd:
    """Give the outcome of a task; that its workers were lost in every attempt is one, too."""
    try:
        outcome: JobEnd = ray.get(ended)
    except ray.exceptions.RayError as error:
        return JobEnd(job.name, "killed", 0.0, 0, f"Ray: {type(error).__name__}")
    return outcome


def import_ray() -> Any:
    """Return the module of Ray.

    Raises
    ------
    ModuleNotFoundError
        If Ray is not installed; says how to install it.
    """
    try:
        import ray
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(INSTALL, name="ray") from error
    return ray


def engine_for(address: str, workers: int = 0) -> Engine:
    """Give the engine of an address.

    Parameters
    ----------
    address
        `local`; `ray` for a cluster of its own on this machine; `ray://HOST:PORT` for a cluster
        by its client port, `ray:auto` for one that this machine belongs to.
    workers
        Processes beside each other of the local engine; as many as cores if 0.

    Raises
    ------
    ValueError
        If it is none of these.

    Examples
    --------
    >>> engine_for("local", 2)
    LocalEngine(workers=2)
    >>> engine_for("ray://head:10001")
    RayEngine(address='ray://head:10001')
    >>> engine_for("slurm")
    Traceback (most recent call last):
    ...
    ValueError: There is no engine "slurm". Give local, ray, ray:auto or ray://HOST:PORT.
    """
    if address == "local":
        return LocalEngine(workers)
    if address == "ray":
        return RayEngine()
    if address.startswith("ray://"):
        return RayEngine(address)
    if address == "ray:auto":
        return RayEngine("auto")
    raise ValueError(
        f'There is no engine "{address}". Give local, ray, ray:auto or ray://HOST:PORT.'
    )

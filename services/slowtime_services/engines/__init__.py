"""Engines that run many jobs, each in a process of its own: on this machine, or on Ray."""

from .cores import usable_cores
from .jobs import Engine, Job, JobEnd, JobLimits, run_job
from .local import LocalEngine
from .ray import RayEngine, engine_for, import_ray

__all__ = [
    "Engine",
    "Job",
    "JobEnd",
    "JobLimits",
    "LocalEngine",
    "RayEngine",
    "engine_for",
    "import_ray",
    "run_job",
    "usable_cores",
]

"""Engines that run many jobs, each in a process of its own: on this machine, or on Ray."""

from .cores import usable_cores
from .jobs import Engine, Job, Limits, Outcome, run_job
from .local import LocalEngine
from .ray import RayEngine, engine_for, import_ray

__all__ = [
    "Engine",
    "Job",
    "Limits",
    "LocalEngine",
    "Outcome",
    "RayEngine",
    "engine_for",
    "import_ray",
    "run_job",
    "usable_cores",
]

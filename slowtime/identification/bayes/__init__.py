"""Record and candidate frequencies in; the most probable modes with posterior errors out."""

from .estimation import bayesian_modes

__all__ = [
    "bayesian_modes",
]

"""Record and candidate frequencies in; the most probable modes with posterior errors out."""

from .fft import bayesian_modes as bayesian_modes

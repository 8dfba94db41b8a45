"""Fisher information and score of a band, from the density that its model predicts."""

from slowtime.identification.spectral_likelihood.evaluation import inverse_density
from slowtime.identification.spectral_likelihood.fisher_information import (
    information_and_score,
)


def fisher_information(data, model, density):
    """Information matrix and score of all parameters; the density is positive definite."""
    precision, _ = inverse_density(density)
    assert precision is not None
    gain, bent = model.gain(data.omega, data.width)
    return information_and_score(data, model, (gain, bent, density, precision))

"""Updating of 60 parameters beside SciPy's least squares, and beside sampling by UQpy.

Run `python -m benchmarks.methods.updating [--steps 100000] [--seed 0]`. Each spring of a chain
of 60 masses is a parameter. The modes at 16 sensors go to
`slowtime.evolution.structures.estimate`; to `scipy.optimize.least_squares` with residuals
written by hand and slopes by differences; and, where it is installed, to a Markov chain of UQpy
on the posterior of the same residuals. Prints how far means and covariances differ, in standard
deviations and in sampling errors of the chain, and ratios of times of the processor.

UQpy 4.1.6 pins a release of beartype that the tests of this project are too new for. Install it
into an environment of its own with `pip install UQpy==4.1.6`.

References
----------
.. [1] D. Tsapetis et al., "UQpy v4.1: Uncertainty quantification with Python", SoftwareX 24
   (2023) 101561.
.. [2] G. O. Roberts, A. Gelman, W. R. Gilks, "Weak convergence and optimal scaling of random
   walk Metropolis algorithms", Annals of Applied Probability 7 (1997) 110-120.
"""

import argparse
import dataclasses
import importlib.util
import sys
import time
import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh_tridiagonal
from scipy.optimize import least_squares

from benchmarks.methods.finite_elements import chain, measured
from slowtime.evolution.structures import MeasuredModes, StructurePosterior, estimate

SPRINGS, MODES, SENSORS = 60, 12, 16
PRIOR_SD = 0.1
"""Standard deviation of the logarithm of each stiffness [1]."""

OPTIMAL_STEP = 2.38
"""Step of a random walk in posterior standard deviations, times the root of the number of
parameters, at which a Gaussian posterior is sampled fastest [1]; Roberts, Gelman and Gilks."""

BATCHES = 20
"""Parts of a chain whose means give the sampling error of the whole mean [1]: each has to be
many times as long as states are correlated, some 300 steps here."""

NEAR_SD, NEAR_RATIO = 0.05, 0.05
"""Largest difference from least squares, in standard deviations and in their ratio [1]."""

SAMPLING_RMS = 1.5
"""Largest root mean square of differences over their sampling errors [1]: 1 where nothing but
sampling separates two results, and the errors come from 20 batches."""

Parameters = Float[np.ndarray, " spring"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class UpdatingProblem:
    """The chain, what was measured of it, and where.

    Parameters
    ----------
    data
        Measured modes.
    sites
        Masses that have a sensor.
    """

    data: MeasuredModes
    sites: np.ndarray

    @classmethod
    def drawn(cls, seed: int) -> "UpdatingProblem":
        """Draw a chain from the prior, and its modes with errors."""
        random = np.random.default_rng(seed)
        theta = PRIOR_SD * random.standard_normal(SPRINGS)
        sites = np.linspace(2, SPRINGS - 1, SENSORS).round().astype(int)
        return cls(
            measured(chain(SPRINGS), np.eye(SPRINGS)[sites], theta, MODES, random), sites
        )

    def residual(self, white: Parameters) -> Float[np.ndarray, " row"]:
        """Residuals by hand, those of the prior at the end.

        Parameters
        ----------
        white
            Logarithms of the factors on the springs over their prior standard deviation [1].

        Returns
        -------
        Residuals in standard deviations.
        """
        data = self.data
        assert data.shapes is not None
        assert data.shape_sd is not None
        spring = float(SPRINGS) ** 2 * np.exp(PRIOR_SD * white)
        diagonal = spring + np.append(spring[1:], 0.0)
        values, vectors = eigh_tridiagonal(
            diagonal, -spring[1:], select="i", select_range=(0, MODES - 1)
        )
        frequency = np.sqrt(values) / (2.0 * np.pi)
        model = vectors[self.sites].T / data.shape_sd
        target = data.shapes / data.shape_sd
        factor = np.sum(model * target, axis=1) / np.sum(model**2, axis=1)
        off = np.log(data.frequency_hz / frequency) * data.frequency_hz / data.frequency_sd_hz
        return np.concatenate([off, (target - factor[:, None] * model).ravel(), -white])


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """A Markov chain after its burn-in.

    Parameters
    ----------
    states
        One row for each step, in prior standard deviations.
    seconds
        Time of the processor [s].
    """

    states: Float[np.ndarray, "step spring"]
    seconds: float

    def mean_error(self) -> Parameters:
        """Compute standard errors of the means by batch means."""
        return _batch_error(self.states)

    def variance_error(self) -> Parameters:
        """Compute standard errors of the variances by batch means."""
        return _batch_error((self.states - self.states.mean(axis=0)) ** 2)


def _batch_error(values: np.ndarray) -> np.ndarray:
    kept = len(values) // BATCHES * BATCHES
    means = values[:kept].reshape(BATCHES, -1, values.shape[1]).mean(axis=1)
    return np.asarray(means.std(axis=0, ddof=1) / np.sqrt(BATCHES))


def sample_by_uqpy(
    problem: UpdatingProblem,
    start: Parameters,
    covariance: Float[np.ndarray, "spring spring"],
    steps: int,
    seed: int,
) -> Sampled:
    """Sample the posterior by the Metropolis algorithm of UQpy.

    Parameters
    ----------
    problem
        What is sampled.
    start, covariance
        Where least squares ended, and the covariance there; they set the proposal only.
    steps
        Length of the chain; its first tenth is left out.
    seed
        Of the chain.

    Returns
    -------
    The chain.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from UQpy.distributions import MultivariateNormal
        from UQpy.sampling.mcmc import MetropolisHastings

    class ProposalWalk(MultivariateNormal):  # type: ignore[misc]  # UQpy has no types
        """Steps that are drawn without a factorisation of their covariance at each."""

        def rvs(
            self, nsamples: int = 1, random_state: np.random.RandomState | None = None
        ) -> np.ndarray:
            assert random_state is not None
            drawn = random_state.standard_normal((nsamples, SPRINGS))
            return np.asarray(OPTIMAL_STEP / np.sqrt(SPRINGS) * drawn)

    lower = np.linalg.cholesky(covariance)

    def log_density(states: np.ndarray) -> np.ndarray:
        found = [problem.residual(start + lower @ state) for state in states]
        return np.array([-0.5 * float(one @ one) for one in found])

    begin = time.process_time()
    walk = MetropolisHastings(
        log_pdf_target=log_density,
        seed=[[0.0] * SPRINGS],
        proposal=ProposalWalk(mean=[0.0] * SPRINGS),
        proposal_is_symmetric=True,
        burn_length=steps // 10,
        random_state=seed,
        nsamples=steps - steps // 10,
    )
    states = start + np.asarray(walk.samples) @ lower.T
    return Sampled(states, time.process_time() - begin)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; return 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    problem, structure = UpdatingProblem.drawn(given.seed), chain(SPRINGS)
    begin = time.process_time()
    ours = estimate(structure, problem.data, PRIOR_SD, starts=0)
    own = time.process_time() - begin
    begin = time.process_time()
    peer = least_squares(problem.residual, np.zeros(SPRINGS), xtol=1e-12, ftol=1e-12)
    theirs = time.process_time() - begin
    slope = np.asarray(peer.jac, dtype=np.float64)
    covariance = np.linalg.inv(slope.T @ slope)
    print(f"{SPRINGS} parameters, {MODES} modes at {SENSORS} sensors")
    good = _show_least_squares(ours, peer.x, covariance, theirs / own)
    if importlib.util.find_spec("UQpy") is None:
        print("UQpy is not installed: no sampling. See `--help`.")
        return 0 if good else 1
    sampled = sample_by_uqpy(problem, peer.x, covariance, given.steps, given.seed)
    return 0 if _show_sampled(ours, sampled, own) and good else 1


def _show_least_squares(
    ours: StructurePosterior,
    white: Parameters,
    covariance: Float[np.ndarray, "spring spring"],
    times: float,
) -> bool:
    sd = PRIOR_SD * np.sqrt(np.diag(covariance))
    apart = float((np.abs(ours.theta - PRIOR_SD * white) / sd).max())
    ratio = np.sqrt(np.diag(ours.covariance)) / sd
    correlated = np.abs(_correlation(ours.covariance) - _correlation(covariance)).max()
    print("Beside scipy.optimize.least_squares:")
    print(f"  largest difference of a mean {apart:.1e} standard deviations")
    print(f"  standard deviations over theirs {ratio.min():.4f} to {ratio.max():.4f}, "
          f"correlations within {correlated:.4f}")  # fmt: skip
    print(f"  their time over ours {times:.1f}")
    return apart <= NEAR_SD and bool((np.abs(ratio - 1.0) <= NEAR_RATIO).all())


def _show_sampled(ours: StructurePosterior, sampled: Sampled, own: float) -> bool:
    states = sampled.states
    mean, variance = states.mean(axis=0), states.var(axis=0)
    accepted = float(np.mean(np.any(np.diff(states, axis=0) != 0.0, axis=1)))
    mean_off = (mean - ours.theta / PRIOR_SD) / sampled.mean_error()
    variance_off = (
        variance - np.diag(ours.covariance) / PRIOR_SD**2
    ) / sampled.variance_error()
    effective = float(np.median(variance / sampled.mean_error() ** 2))
    rms = [float(np.sqrt(np.mean(one**2))) for one in (mean_off, variance_off)]
    shift = float((np.abs(mean - ours.theta / PRIOR_SD) / np.sqrt(variance)).max())
    ratio = np.sqrt(np.diag(ours.covariance) / variance) / PRIOR_SD
    correlated = np.abs(_correlation(ours.covariance) - np.corrcoef(states.T)).max()
    print(f"Beside {len(states)} steps of UQpy ({accepted:.0%} accepted, worth "
          f"{effective:.0f} independent samples):")  # fmt: skip
    print(f"  means differ by {rms[0]:.2f} sampling errors (rms), at most {shift:.3f} "
          "standard deviations")  # fmt: skip
    print(f"  variances differ by {rms[1]:.2f} sampling errors (rms); standard deviations over "
          f"theirs {ratio.min():.3f} to {ratio.max():.3f}")  # fmt: skip
    print(f"  correlations within {correlated:.3f}")
    print(f"  their time over ours {sampled.seconds / own:.0f}")
    return max(rms) <= SAMPLING_RMS


def _correlation(covariance: np.ndarray) -> np.ndarray:
    sd = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(sd, sd))


if __name__ == "__main__":
    sys.exit(main())

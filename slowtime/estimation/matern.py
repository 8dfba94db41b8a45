r"""A Gaussian process over slow time: a trend plus a Matérn process.

.. math:: y(t_i) = \underbrace{a(t_i)}_{\text{trend}} + g(t_i) + \varepsilon_i, \qquad
          g \sim GP(0, \sigma^2 k_\nu(|t - t'| / \ell)), \quad \varepsilon_i \sim N(0, s_i^2)

The state is (level, slope, g and its derivatives); what the trend does not use has variance
zero.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from . import kernels
from .algebra import check_ascending
from .state_space import Advanced, Belief

Parameter = float | Float[np.ndarray, " family"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SlowProcess:
    """A trend plus a Matérn process.

    Parameters
    ----------
    smoothness
        0.5 (rough, as after jumps), 1.5 or 2.5 (twice differentiable).
    length
        Length scale, in the unit of time.
    sd
        Standard deviation of the Matérn process, in the unit of the readings.
    centre
        Mean of the level at `start`, in the unit of the readings.
    level_sd
        Standard deviation of that level; 0 for a known mean.
    slope_sd
        Standard deviation of the slope of the mean [reading / time]; 0 for a constant mean.
    slope_drift
        How the slope wanders: the standard deviation of its change over one unit of time
        [reading / time]; it grows with the root of the time. 0 for a straight mean.
    """

    smoothness: float = 1.5
    length: Parameter
    sd: Parameter
    centre: float = 0.0
    level_sd: float = 0.0
    slope_sd: float = 0.0
    slope_drift: Parameter = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a process."""
        if self.smoothness not in kernels.SMOOTHNESSES:
            raise ValueError(
                f"smoothness={self.smoothness} is none of 0.5, 1.5, 2.5. Give 1.5 when unsure."
            )
        if not np.all(np.asarray(self.length) > 0.0):
            raise ValueError(
                f"length={self.length} is not a length scale. Give a positive one, in the unit "
                "of the times."
            )
        spreads = (self.sd, self.level_sd, self.slope_sd, self.slope_drift)
        if not all(np.all(np.asarray(spread) >= 0.0) for spread in spreads):
            raise ValueError(
                f"sd={self.sd}, level_sd={self.level_sd}, slope_sd={self.slope_sd}, "
                f"slope_drift={self.slope_drift} must not be negative. Give 0 to leave one out."
            )

    @property
    def observation(self) -> Float[np.ndarray, " state"]:
        """What of the state a reading sees."""
        seen = np.zeros(3 + round(self.smoothness - 0.5))
        seen[[0, 2]] = 1.0
        return seen

    def observation_row(
        self, time: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, "time state"]:
        """See `StateSpace.observation_row`."""
        return np.broadcast_to(self.observation, (len(time), len(self.observation)))

    def start(self, time: float) -> Belief:
        """See `StateSpace.start`."""
        family = np.broadcast_shapes(np.shape(self.length), np.shape(self.sd))
        size = len(self.observation)
        mean, covariance = np.zeros((*family, size)), np.zeros((*family, size, size))
        mean[..., 0] = self.centre
        covariance[..., 0, 0] = self.level_sd**2
        covariance[..., 1, 1] = self.slope_sd**2
        covariance[..., 2:, 2:] = kernels.per_member(self.sd) ** 2 * kernels.stationary(
            self.smoothness
        )
        return Belief(float(time), mean, covariance)

    def advance(self, step: Float[np.ndarray, " time"]) -> Advanced:
        """See `StateSpace.advance`."""
        check_ascending(step)
        apart = step.reshape(-1, *([1] * np.ndim(self.length)))
        scaled = apart * kernels.rate(self.smoothness, self.length)
        inner = kernels.matern_transition(self.smoothness, scaled)
        rest = kernels.stationary(self.smoothness)
        noise_inner = rest - inner @ rest @ np.swapaxes(inner, -1, -2)
        size = len(self.observation)
        move = np.zeros((*inner.shape[:-2], size, size))
        noise = np.zeros_like(move)
        move[..., 0, 0] = move[..., 1, 1] = 1.0
        move[..., 0, 1] = apart
        move[..., 2:, 2:] = inner
        noise[..., :2, :2] = kernels.per_member(self.slope_drift) ** 2 * kernels.trend_noise(
            apart
        )
        noise[..., 2:, 2:] = kernels.per_member(self.sd) ** 2 * noise_inner
        return move, noise

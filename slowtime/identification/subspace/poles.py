"""Poles of models of several orders, with standard deviations from error draws."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float, Inexact, Int
from scipy.special import stdtrit

FLAT = 0.22
"""Draws per decay time: the density of the products is then flat to within 5 %."""

FEWEST_DRAWS = 6
"""Least number of draws."""

GAUSSIAN = 1.959964
"""Quantile of the 95 % interval."""

MOST_DAMPING = 0.25
"""Largest damping ratio of a pole that may be a mode [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class PoleLimits:
    """Frequencies [Hz] and damping ratios [1] between which modes are looked for."""

    low_hz: float
    high_hz: float
    most_damping: float = MOST_DAMPING

    def inside(self, pole: Complex[np.ndarray, " pole"]) -> Int[np.ndarray, " chosen"]:
        """Find the poles within the limits."""
        size = np.abs(pole)
        frequency, damping = size / (2 * np.pi), -pole.real / size
        fit = (frequency >= self.low_hz) & (frequency <= self.high_hz)
        return np.flatnonzero(fit & (damping > 0) & (damping < self.most_damping))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Poles:
    r"""Poles of models of many orders, side by side.

    Parameters
    ----------
    order
        Of the model that each pole belongs to.
    pole
        s [rad/s], only those of positive frequency.
    draws
        Errors of s [rad/s]; nan where they were not asked for.
    shape_draws
        Errors of the shapes; None where they were not asked for.
    """

    order: Int[np.ndarray, " pole"]
    pole: Complex[np.ndarray, " pole"]
    shape: Complex[np.ndarray, "channel pole"]
    draws: Complex[np.ndarray, "draw pole"]
    shape_draws: Complex[np.ndarray, "draw channel pole"] | None
    duration_s: float

    @property
    def frequency_hz(self) -> Float[np.ndarray, " pole"]:
        """Undamped natural frequencies [Hz]."""
        return np.asarray(np.abs(self.pole) / (2 * np.pi))

    @property
    def damping_ratio(self) -> Float[np.ndarray, " pole"]:
        """Damping ratios; negative where a model is unstable."""
        return np.asarray(-self.pole.real / np.abs(self.pole))

    def errors(
        self,
    ) -> tuple[Float[np.ndarray, "draw pole"], Float[np.ndarray, "draw pole"]]:
        """Errors of frequency [Hz] and of damping ratio, draw by draw."""
        size = np.abs(self.pole)
        along = (self.pole.conj() * self.draws).real / size
        damping = -self.draws.real / size - self.damping_ratio * along / size
        return along / (2 * np.pi), damping

    def standard_deviations(
        self,
    ) -> tuple[Float[np.ndarray, " pole"], Float[np.ndarray, " pole"], np.ndarray]:
        """Of frequency [Hz] and damping ratio, and the correlation of the two errors."""
        frequency, damping = self.errors()
        # As many draws count as the memory of the pole leaves flat; the values are enlarged so
        # that 1.96 of them are an interval of 95 % under Student's law.
        used, student = self._used()
        ff = np.sum(frequency**2 * used, axis=0)
        zz = np.sum(damping**2 * used, axis=0)
        fz = np.sum(frequency * damping * used, axis=0)
        correlation = fz / np.sqrt(np.maximum(ff * zz, np.finfo(float).tiny))
        return student * np.sqrt(ff), student * np.sqrt(zz), correlation

    def shape_sd(self) -> Float[np.ndarray, "channel pole"]:
        """Square root of the mean squared modulus of the deviation of each component."""
        if self.shape_draws is None:
            raise ValueError("These poles came without errors of shapes. Ask with shapes=True.")
        used, student = self._used()
        power = np.einsum("kcp,kp->cp", np.abs(self.shape_draws) ** 2, used)
        return np.asarray(student * np.sqrt(power))

    def _used(self) -> tuple[np.ndarray, np.ndarray]:
        """Weights of the draws, which average them, and Student's factor."""
        most = len(self.draws)
        number = np.floor(FLAT * np.abs(self.pole.real) * self.duration_s).astype(int)
        number = np.clip(number, min(FEWEST_DRAWS, most), most)
        used = (np.arange(most)[:, None] < number) / number
        return used, stdtrit(number.astype(float), 0.975) / GAUSSIAN


def rescale_channels(poles: Poles, scale: Float[np.ndarray, " channel"]) -> Poles:
    """Shapes for channels that are scaled by `scale`."""
    return combine_poles(poles, np.diag(scale))


def combine_poles(poles: Poles, mixing: Inexact[np.ndarray, "sensor channel"]) -> Poles:
    """Shapes of channels that are linear combinations of those identified.

    Weights are new channel by identified channel; shapes have unit norm.
    """
    shape = mixing @ poles.shape
    size = np.linalg.norm(shape, axis=0)
    shape = shape / size
    moved = None
    if poles.shape_draws is not None:
        moved = np.einsum("sc,kcp->ksp", mixing, poles.shape_draws) / size
        # What only lengthens or turns a shape of unit norm is no error of it.
        along = np.einsum("cp,kcp->kp", shape.conj(), moved)
        moved = moved - along[:, None, :] * shape
    return dataclasses.replace(poles, shape=shape, shape_draws=moved)

r"""Response of an ageing nonlinear structure at future slow times (Chapter 9).

Each constant that was estimated epoch by epoch (`estimation.epochs`) becomes a process over
slow time of its logarithm, known errors and all; the processes give the constants at any slow
time, past or to come, and the structure with constants drawn from them, under white forces of
its own, gives the response with its bands.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.plant.parameter_names import Name
from slowtime.dynamics.stochastic import Springs, WhiteForce, simulate
from slowtime.estimation import filtering
from slowtime.estimation.epochs import Constants
from slowtime.evolution.change import Series, check_level
from slowtime.evolution.forecasting import forecast
from slowtime.evolution.forecasting.forecast import Forecast, Outlook

Epochs = Float[np.ndarray, " epoch"]


@dataclasses.dataclass(frozen=True, slots=True)
class ConstantBand:
    """A constant over slow time, in its unit: median, and ends of its interval."""

    value: Series
    lo: Series
    hi: Series


@dataclasses.dataclass(frozen=True, slots=True)
class AgedResponse:
    """What the structure would do: mean, and ends of the interval, by sample and node.

    Parameters
    ----------
    mean, lo, hi
        Displacements [m].
    """

    mean: Float[np.ndarray, "time node"]
    lo: Float[np.ndarray, "time node"]
    hi: Float[np.ndarray, "time node"]


@dataclasses.dataclass(frozen=True, slots=True)
class Ageing:
    """A structure whose constants age.

    Parameters
    ----------
    springs
        The structure, with nominal values.
    slow_time
        Of the epochs, ascending.
    constants
        As each epoch told them.
    outlooks
        For each constant, processes that its logarithm over the nominal value allows.
    """

    springs: Springs
    slow_time: Epochs
    constants: Constants
    outlooks: Mapping[Name, Outlook]

    def past(self, name: Name, level: float = 0.95) -> ConstantBand:
        """Estimate of one constant at the epochs, given all of them.

        Parameters
        ----------
        name
            Name of the constant.
        level
            Probability of the interval.

        Returns
        -------
        Mean and interval at each epoch.
        """
        log, sd = self._readings(name)
        found = filtering.smooth(self.outlooks[name].likeliest, self.slow_time, log, sd)
        return self._band(name, found.mean, check_level(level) * found.sd)

    def future(
        self, name: Name, slow_time: Float[np.ndarray, " later"], level: float = 0.95
    ) -> ConstantBand:
        """Forecast of one constant.

        Parameters
        ----------
        name
            Name of the constant.
        slow_time
            Times not before the last epoch.
        level
            Probability of the interval.

        Returns
        -------
        Mean and interval at each time.
        """
        found = self._foretold(name, slow_time, level)
        return self._band(name, found.mean, found.hi - found.mean)

    def draw(
        self, slow_time: float, count: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "path parameter"]:
        """Draw values of all constants at a future time.

        Constants are drawn independently of each other; those that were not estimated are as
        the structure has them.

        Parameters
        ----------
        slow_time
            Time not before the last epoch.
        count
            Number of draws.
        rng
            Generator of the draws.

        Returns
        -------
        One row per draw.
        """
        values = np.repeat(self.springs.values[None], count, axis=0)
        for name in self.outlooks:
            found = self._foretold(name, np.array([slow_time]), 0.95)
            log = found.mean[0] + found.sd[0] * rng.standard_normal(count)
            values[:, self.springs.where([name])[0]] *= np.exp(log)
        return values

    def respond(
        self,
        slow_time: float,
        forces: Float[np.ndarray, "time 1 node"],
        rate_hz: float,
        white: WhiteForce,
        rng: np.random.Generator,
        *,
        paths: int = 400,
        level: float = 0.95,
    ) -> AgedResponse:
        """Simulate the response from rest at a future slow time.

        Parameters
        ----------
        slow_time
            Slow time of the response.
        forces
            Known forces on the nodes [N] at the samples.
        rate_hz
            Sampling rate of the forces [Hz].
        white
            Forces that nobody knows.
        rng
            Generator of constants and of white forces.
        paths
            How many are drawn, each with constants of its own.
        level
            Probability of the interval [1].

        Returns
        -------
        Mean displacement [m] with its interval.
        """
        check_level(level)
        start = np.zeros((paths, 2 * len(self.springs.nodes)))
        drawn = self.draw(slow_time, paths, rng)
        moved = simulate(self.springs, forces, rate_hz, white, rng, values=drawn, start=start)
        own = moved[:, :, : len(self.springs.nodes)]
        lo, hi = np.quantile(own, [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=1)
        return AgedResponse(own.mean(axis=1), lo, hi)

    def _readings(self, name: Name) -> tuple[Epochs, Epochs]:
        place = self.constants.names.index(name)
        log, sd = self.constants.record_alone()
        return np.ascontiguousarray(log[:, place]), np.ascontiguousarray(sd[:, place])

    def _foretold(self, name: Name, slow_time: np.ndarray, level: float) -> Forecast:
        log, sd = self._readings(name)
        return forecast.predict(
            self.outlooks[name], self.slow_time, log, sd, slow_time, level=level
        )

    def _band(self, name: Name, log: np.ndarray, half: np.ndarray) -> ConstantBand:
        nominal = float(self.constants.nominal[self.constants.names.index(name)])
        ends = nominal * np.exp(log - half), nominal * np.exp(log + half)
        return ConstantBand(nominal * np.exp(log), np.minimum(*ends), np.maximum(*ends))


def learn_ageing(
    springs: Springs,
    slow_time: Epochs,
    constants: Constants,
    *,
    of: tuple[str, ...] = ("stiffness", "damping"),
) -> Ageing:
    """Learn how constants of some kinds age, from their estimates at each epoch.

    Parameters
    ----------
    springs
        The structure, with the nominal values that the constants were measured by.
    slow_time
        Of the epochs, ascending.
    constants
        Of one twin, one row an epoch, each from readings of its own; what the prior has put
        into each is taken out.
    of
        Kinds of constants that age.

    Returns
    -------
    Constants as functions of slow time.
    """
    if constants.log_ratio.shape[:-1] != slow_time.shape:
        raise ValueError(
            f"Constants of {constants.log_ratio.shape[:-1]} epochs were given for "
            f"{len(slow_time)} slow times. Give one row for each."
        )
    log, sd = constants.record_alone()
    outlooks = {
        name: forecast.fit(
            slow_time, np.ascontiguousarray(log[:, i]), np.ascontiguousarray(sd[:, i])
        )
        for i, name in enumerate(constants.names)
        if name[0] in of
    }
    return Ageing(springs, slow_time, constants, outlooks)

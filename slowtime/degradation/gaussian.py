"""The mixture of Gaussian processes of `evolution.forecast` as one more degradation law."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, logsumexp

from slowtime.estimation.filtering import filtered
from slowtime.estimation.matern import SlowProcess
from slowtime.evolution.events.known_events import KnownEvent
from slowtime.evolution.forecasting import continuation, forecast
from slowtime.evolution.forecasting.continuation import Continuation
from slowtime.evolution.forecasting.outlook import Outlook
from slowtime.evolution.life import threshold_crossing

from .fleet import FleetPrior
from .history import History, Series
from .law import Drawn

NAME = "Gaussian process"


@dataclasses.dataclass(frozen=True, slots=True)
class GaussianLaw:
    """Gaussian processes with weights as a law that learns: see `law.Law`.

    Parameters
    ----------
    outlook
        What `forecast.fit` has learnt from the same readings, where that is known.
    known
        Repairs and inspections among the readings.
    """

    outlook: Outlook | None = None
    known: tuple[KnownEvent, ...] = ()
    name: str = NAME

    def learn(self, history: History, fleet: FleetPrior | None = None) -> "GaussianPosterior":
        """Learn processes, unless they are given; see `law.Law.learn`."""
        readings = history.time, history.value, history.sd
        outlook = self.outlook
        if outlook is None:
            known = [event.time for event in history.events]
            outlook = forecast.fit(*readings, suspected=known)
        begun = continuation.begin(outlook, *readings, known=self.known)
        # Innovations over a known jump are no misfit, and are not looked at.
        fits = 1.0 if self.known else _p_value(outlook, *readings)
        return GaussianPosterior(begun, outlook.log_evidence, fits)


@dataclasses.dataclass(frozen=True, slots=True)
class GaussianPosterior:
    """What is believed of Gaussian processes: see `law.Posterior`."""

    begun: Continuation
    log_evidence: float
    p_value: float

    def follow(self, time: Series, value: Series, sd: Series) -> "GaussianPosterior":
        """Update the belief by further readings, at a constant cost each."""
        # The evidence grows by what the members predicted together.
        gained = self.log_evidence
        begun = self.begun
        for i in range(len(time)):
            one = slice(i, i + 1)
            if not (np.isfinite(value[i]) and np.isfinite(sd[i])):
                continue
            logs = []
            for process, belief, weight in begun.kinds():
                log = filtered(process, time[one], value[one], sd[one], belief=belief)[1]
                with np.errstate(divide="ignore"):
                    logs.append(np.atleast_1d(log) + np.log(weight))
            gained += float(logsumexp(np.concatenate(logs)))
            begun = begun.follow(time[one], value[one], sd[one])
        return dataclasses.replace(self, begun=begun, log_evidence=gained)

    def draw(
        self, later: Float[np.ndarray, " later"], count: int, rng: np.random.Generator
    ) -> Drawn:
        """Sample paths at future slow times, the first of which is the last reading's."""
        if not count:
            return Drawn(np.zeros((0, len(later))), np.zeros(0))
        seed = int(rng.integers(2**31))
        futures = threshold_crossing.draw_futures_at(self.begun, later, paths=count, seed=seed)
        return Drawn(futures.paths, futures.roughness)

    def hyperparameters(self) -> FleetPrior | None:
        """Give None: processes are learnt from each asset alone."""
        return None


def _p_value(outlook: Outlook, time: Series, value: Series, sd: Series) -> float:
    """Probability of a larger sum of squared innovations under the likeliest process [1]."""
    if outlook.wave_share > 0.5:
        return 1.0
    likeliest = outlook.likeliest
    assert isinstance(likeliest, SlowProcess)
    found = filtered(likeliest, time, value, sd, jumps=outlook.jumps, innovations=True)
    squares = found.residual**2 / found.spread
    vague = 2 + len(outlook.jumps)
    return float(chdtrc(max(len(squares) - vague, 1), squares.sum()))

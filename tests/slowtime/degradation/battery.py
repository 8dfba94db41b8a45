"""Hidden histories by the hundred: how often remaining life is held, how wide, how scored.

Run as ``python -m tests.slowtime.degradation.battery --seed 1 --cases 200``.
"""

import argparse
import dataclasses
import time
import zlib

import numpy as np

from slowtime import degradation
from slowtime.evolution.forecasting import forecast
from tests.slowtime.degradation.histories import KINDS, TRUE_LAW, Hidden, hidden
from tests.slowtime.evolution.life.crossings import first_crossing

SHARES = (0.1, 0.5, 0.9)
SURE = 0.9
"""Posterior weight of the true law from which its width is compared."""


@dataclasses.dataclass(frozen=True)
class Score:
    """One history: times are remaining lives over the true one, infinite beyond the horizon."""

    kind: str
    ours: np.ndarray
    today: np.ndarray
    told: np.ndarray
    weights: dict[str, float]
    within: float
    p_value: float
    seconds: float

    @property
    def weight(self):
        """Posterior weight of the true law."""
        return self.weights[TRUE_LAW[self.kind]]


CAP = 3.0
"""The horizon, over the true remaining life: the true time is always within it."""


def capped(times):
    """Times beyond the horizon count as the horizon."""
    return np.minimum(times, CAP)


def holds(times):
    """Whether the interval holds the true time."""
    return capped(times[0]) <= 1.0 <= capped(times[2])


def width(times):
    """Width of the interval, capped at the horizon."""
    return capped(times[2]) - capped(times[0])


def pinball(times):
    """Mean pinball loss at 10, 50 and 90 %."""
    away = 1.0 - capped(times)
    shares = np.array(SHARES)
    return float(np.mean(np.maximum(shares * away, (shares - 1.0) * away)))


def judge(case: Hidden) -> Score:
    """Foretell one remaining life: by all laws, by the true law, and by Gaussian processes."""
    readings = case.time, case.value, case.sd
    outlook = forecast.fit(*readings)
    since = float(case.time[-1])
    today = first_crossing(
        outlook, *readings, case.threshold, case.horizon, toward="below", points=120, paths=2000
    )
    begin = time.process_time()
    mixture = degradation.learn(*readings, outlook=outlook)
    life = mixture.remaining_life(case.threshold, case.horizon, toward="below")
    seconds = time.process_time() - begin
    told = mixture.remaining_life(
        case.threshold, case.horizon, toward="below", only=TRUE_LAW[case.kind]
    )
    true = case.life - since
    ours, now, alone = (
        np.asarray((one.quantile(np.array(SHARES)) - since) / true, dtype=float)
        for one in (life, today, told)
    )
    weights, p_value = mixture.weights, mixture.p_value
    return Score(case.kind, ours, now, alone, weights, life.within, p_value, seconds)


def cases(kind: str, count: int, seed: int):
    """Histories of a kind."""
    for index in range(count):
        yield hidden(kind, np.random.default_rng([seed, zlib.crc32(kind.encode()), index]))


def line(name: str, scores: list[Score]) -> str:
    """Figures of a kind."""
    held = [
        np.mean([holds(getattr(s, who)) for s in scores]) for who in ("ours", "today", "told")
    ]
    loss = [
        np.mean([pinball(getattr(s, who)) for s in scores]) for who in ("ours", "today", "told")
    ]
    wide = [
        np.median([width(getattr(s, who)) for s in scores]) for who in ("ours", "today", "told")
    ]
    low = np.mean([capped(s.ours[0]) > 1 for s in scores])
    high = np.mean([capped(s.ours[2]) < 1 for s in scores])
    sure = [s for s in scores if s.weight >= SURE]
    ratio = (
        np.median([width(s.ours) / max(width(s.told), 1e-9) for s in sure]) if sure else np.nan
    )
    rest = [s for s in scores if s.weight < SURE]
    other = (
        np.median([width(s.ours) / max(width(s.told), 1e-9) for s in rest]) if rest else np.nan
    )
    lacking = sum(s.within >= 0.5 and not np.isfinite(s.ours[1]) for s in scores)
    misfit = np.mean([s.p_value < 0.005 for s in scores])
    names = list(scores[0].weights)
    mean = {n: np.mean([s.weights[n] for s in scores]) for n in names}
    return (
        f"{name:<14}{100 * held[0]:7.1f}{100 * held[1]:7.1f}{100 * held[2]:7.1f}"
        f"{100 * low:6.1f}{100 * high:6.1f}"
        f"{wide[0]:8.3f}{wide[1]:8.3f}{wide[2]:8.3f}"
        f"{loss[0]:9.4f}{loss[1]:8.4f}{loss[2]:8.4f}"
        f"{len(sure):5d}{ratio:7.2f}{other:7.2f}{lacking:4d}{100 * misfit:5.1f}"
        f"{np.mean([s.seconds for s in scores]):7.3f}  "
        + " ".join(f"{n[:6]}={100 * v:.0f}" for n, v in mean.items())
    )


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--kind", nargs="*", default=list(KINDS), choices=list(KINDS))
    arguments = parser.parse_args()
    print(
        "10-90 % interval holds [%]: all laws, today, told the law; too late, too early [%]; "
        "median width over the true remaining life; pinball loss; cases sure of the law, width "
        "ratio there and elsewhere; medians lacking; misfits [%]; seconds; mean weights [%]"
    )
    pooled: list[Score] = []
    for kind in arguments.kind:
        scores = [judge(case) for case in cases(kind, arguments.cases, arguments.seed)]
        pooled += scores
        print(line(kind, scores), flush=True)
    print(line("pooled", pooled))


if __name__ == "__main__":
    main()

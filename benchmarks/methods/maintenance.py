"""Maintenance: what the plan's decisions cost over simulated fleets, beside other policies.

`python -m benchmarks.methods.maintenance` simulates 20 fleets of 200 assets over 20 years in
some minutes, `--fleets 3` fewer. Truth is simulated here and shares no code with `slowtime`:
damage grows in jumps (a gamma process) at a rate that each asset keeps; in half of the fleets
it grows faster the more damage there is, which the planner's model does not know. Each month an
asset that reached a damage of 1 has failed and is replaced; a reading has an error; policies
then inspect or repair. All policies meet the same jumps and the same errors.
"""

import argparse
import dataclasses
import sys
import time

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from slowtime.decisions import Cost, Costs, EstimateError, Lookahead, drift, fleet

ASSETS, YEARS, STEP = 200, 20, 1.0 / 12.0
MONTHS = 12 * YEARS
INSPECTION_SD = 0.02
GUESS, GUESS_SD = 0.1, 0.05
"""First guess of the mean rate [1/year] that every policy with a filter begins with."""

INTERVALS = tuple(range(12, 12 * 20, 6))
LEVELS = tuple(np.arange(0.3, 0.99, 0.03).tolist())
PROBABILITIES = tuple(np.geomspace(2e-4, 0.3, 16).tolist())
UNTUNED = 0.5
"""Threshold on the estimate that nobody has tuned: half of the damage at failure."""

SAVING = 0.10
"""Of the plan against the best fixed interval and against the untuned threshold, at least."""


@dataclasses.dataclass(frozen=True)
class Fleet:
    """Truth of a fleet, and what it costs."""

    jumps: Float[np.ndarray, "month asset"]
    errors: Float[np.ndarray, "month asset"]
    inspection_errors: Float[np.ndarray, "month asset"]
    reading_sd: float
    acceleration: float
    costs: Costs


def simulated_fleet(seed: int) -> Fleet:
    """Draw a fleet."""
    rng = np.random.default_rng([32, seed])
    mean = 1.0 / rng.uniform(6.0, 14.0)
    spread = rng.uniform(0.2, 0.5)
    scale = np.exp(rng.uniform(np.log(0.005), np.log(0.04)))
    rates = mean * rng.lognormal(-(spread**2) / 2, spread, ASSETS)
    costs = Costs(
        failure=Cost(float(np.exp(rng.uniform(np.log(8.0), np.log(40.0))))),
        repair=Cost(1.0),
        inspection=Cost(float(np.exp(rng.uniform(np.log(0.02), np.log(0.1))))),
        discount_rate=0.03,
    )
    return Fleet(
        rng.gamma(rates * STEP / scale, scale, (MONTHS, ASSETS)),
        rng.standard_normal((MONTHS, ASSETS)),
        rng.standard_normal((MONTHS, ASSETS)),
        float(np.exp(rng.uniform(np.log(0.03), np.log(0.12)))),
        0.0 if seed % 2 == 0 else 1.0,
        costs,
    )


@dataclasses.dataclass
class PolicyAccount:
    """What each row (a policy, or one of its parameters) has paid in a fleet."""

    cost: Float[np.ndarray, " row"]
    failures: Float[np.ndarray, " row"]
    repairs: Float[np.ndarray, " row"]
    inspections: Float[np.ndarray, " row"]

    @classmethod
    def of(cls, rows: int) -> "PolicyAccount":
        """Begin with nothing paid."""
        return cls(*(np.zeros(rows) for _ in range(4)))


class World:
    """A fleet under rows of policies: damage of each, and what is paid."""

    def __init__(self, truth: Fleet, rows: int) -> None:
        self.truth, self.month = truth, 0
        self.damage = np.zeros((rows, ASSETS))
        self.account = PolicyAccount.of(rows)
        prices = truth.costs
        self._prices = prices.failure.mean, prices.repair.mean, prices.inspection.mean

    def grow(self) -> Bool[np.ndarray, "row asset"]:
        """Let a month pass, replace the assets that fail, and tell which did."""
        faster = 0.6 + 0.8 * self.damage
        share = faster if self.truth.acceleration else 1.0
        self.damage = self.damage + share * self.truth.jumps[self.month]
        self.month += 1
        failed = self.damage >= 1.0
        self.account.failures += failed.sum(axis=1)
        self._pay(failed, self._prices[0])
        self.damage[failed] = 0.0
        return failed

    def readings(self) -> Float[np.ndarray, "row asset"]:
        """Read each asset."""
        return np.asarray(
            self.damage + self.truth.reading_sd * self.truth.errors[self.month - 1]
        )

    def inspect(self, which: Bool[np.ndarray, "row asset"]) -> Float[np.ndarray, "row asset"]:
        """Measure some assets; NaN for the others."""
        self.account.inspections += which.sum(axis=1)
        self._pay(which, self._prices[2])
        errors = INSPECTION_SD * self.truth.inspection_errors[self.month - 1]
        return np.where(which, self.damage + errors, np.nan)

    def repair(self, which: Bool[np.ndarray, "row asset"]) -> None:
        """Repair some assets, which are as new then."""
        self.account.repairs += which.sum(axis=1)
        self._pay(which, self._prices[1])
        self.damage[which] = 0.0

    def _pay(self, which: Bool[np.ndarray, "row asset"], price: float) -> None:
        rate = self.truth.costs.discount_rate
        self.account.cost += which.sum(axis=1) * price * np.exp(-rate * self.month * STEP)


class PolicyFilter:
    """What the policies with a filter know of a world."""

    def __init__(self, truth: Fleet, rows: int) -> None:
        self._sd = truth.reading_sd
        self.belief = drift.start((rows, ASSETS), GUESS)

    def take(
        self,
        failed: Bool[np.ndarray, "row asset"],
        readings: Float[np.ndarray, "row asset"],
    ) -> drift.Pooled:
        """Take in a month: who failed had reached a damage of 1 and is new."""
        self.belief = drift.advance(self.belief, STEP)
        self.belief = drift.read(self.belief, np.where(failed, 1.03, np.nan), 0.05)
        self.belief = drift.renew(self.belief, failed)
        self.belief = drift.read(self.belief, readings, self._sd)
        return drift.pool(self.belief, GUESS, GUESS_SD)

    def inspected(self, measured: Float[np.ndarray, "row asset"]) -> drift.Pooled:
        """Take in inspections."""
        self.belief = drift.read(self.belief, measured, INSPECTION_SD)
        return drift.pool(self.belief, GUESS, GUESS_SD)

    def repaired(self, which: Bool[np.ndarray, "row asset"]) -> None:
        """Take in repairs."""
        self.belief = drift.renew(self.belief, which)


def under_plan(truth: Fleet) -> PolicyAccount:
    """Let the product decide: `slowtime.decisions.fleet.decide`, month by month."""
    world, known = World(truth, 1), PolicyFilter(truth, 1)
    follow: fleet.Continuations | None = None
    for month in range(1, MONTHS + 1):
        pooled = _row(known.take(world.grow(), world.readings()))
        if follow is None or month % 24 == 0:
            follow = _follow(truth, pooled)
        left = MONTHS - month
        if left < 1:
            break
        chosen = _decide(truth, pooled, follow, left, inspection=True)
        if chosen.inspect.any():
            measured = world.inspect(chosen.inspect[None])
            again = _decide(truth, _row(known.inspected(measured)), follow, left)
            repair = np.where(chosen.inspect, again.repair, chosen.repair)
        else:
            repair = chosen.repair
        world.repair(repair[None])
        known.repaired(repair[None])
    return world.account


def _row(pooled: drift.Pooled) -> drift.Pooled:
    each = {field.name: getattr(pooled, field.name)[0] for field in dataclasses.fields(pooled)}
    return drift.Pooled(**each)


def _follow(truth: Fleet, pooled: drift.Pooled) -> fleet.Continuations:
    sd = float(np.sqrt(np.median(pooled.pdd)))
    return fleet.continuations(
        truth.costs,
        mean_rate=float(pooled.mean_rate),
        variance=float(pooled.variance),
        acceleration=float(pooled.acceleration),
        epochs=MONTHS,
        step=STEP,
        error=EstimateError(sd, 0.5),
    )


def _decide(
    truth: Fleet,
    pooled: drift.Pooled,
    follow: fleet.Continuations,
    left: int,
    *,
    inspection: bool = False,
) -> Lookahead:
    sd = INSPECTION_SD if inspection else None
    return fleet.decide(
        pooled,
        truth.costs,
        follow,
        epochs=left,
        step=STEP,
        reading_sd=truth.reading_sd,
        inspection_sd=sd,
    )


def under_intervals(truth: Fleet) -> PolicyAccount:
    """Repair at fixed intervals, one row each; assets take turns from the start."""
    world = World(truth, len(INTERVALS))
    every = np.array(INTERVALS)[:, None]
    for month in range(1, MONTHS + 1):
        world.grow()
        world.repair(np.broadcast_to(month % every == 0, world.damage.shape))
    return world.account


def under_levels(truth: Fleet) -> PolicyAccount:
    """Repair at a threshold on the filtered estimate of the damage, one row each."""
    world, known = World(truth, len(LEVELS) + 1), PolicyFilter(truth, len(LEVELS) + 1)
    levels = np.array([*LEVELS, UNTUNED])[:, None]
    for _ in range(MONTHS):
        pooled = known.take(world.grow(), world.readings())
        repair = pooled.damage >= levels
        world.repair(repair)
        known.repaired(repair)
    return world.account


def under_probabilities(truth: Fleet) -> PolicyAccount:
    """Repair at a threshold on the probability to fail within a month, one row each."""
    rows = len(PROBABILITIES)
    world, known = World(truth, rows), PolicyFilter(truth, rows)
    limits = np.array(PROBABILITIES)[:, None]
    for _ in range(MONTHS):
        pooled = known.take(world.grow(), world.readings())
        place, rate = drift.states_of(pooled)
        failing = drift.failure_cdf(pooled, place, rate, np.array([STEP]))
        repair = failing[..., 0].mean(axis=-1) >= limits
        world.repair(repair)
        known.repaired(repair)
    return world.account


@dataclasses.dataclass
class FleetResult:
    """Cost and failures of each policy, a row each fleet."""

    plan: PolicyAccount
    intervals: PolicyAccount
    levels: PolicyAccount
    probabilities: PolicyAccount


def simulate(seed: int) -> FleetResult:
    """Run all policies on one fleet."""
    truth = simulated_fleet(seed)
    return FleetResult(
        under_plan(truth),
        under_intervals(truth),
        under_levels(truth),
        under_probabilities(truth),
    )


def interval(values: Float[np.ndarray, " fleet"]) -> tuple[float, float, float]:
    """Mean of a difference over fleets, and its 95 % interval by Student's t."""
    mean, half = float(values.mean()), 0.0
    if len(values) > 1:
        spread = float(values.std(ddof=1)) / np.sqrt(len(values))
        half = spread * float(stats.t.ppf(0.975, len(values) - 1))
    return mean, mean - half, mean + half


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 where the plan saves less than it is held to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fleets", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="Seed of the first fleet.")
    given = parser.parse_args(arguments)
    began = time.perf_counter()
    found = [simulate(seed) for seed in range(given.first, given.first + given.fleets)]
    plan = np.array([one.plan.cost[0] for one in found])
    rivals = {
        "fixed interval, best of each fleet": [
            (r.intervals, _least(r.intervals)) for r in found
        ],
        f"threshold {UNTUNED:g} on the estimate": [(r.levels, -1) for r in found],
        "threshold on the estimate, tuned per fleet": [
            (r.levels, _least(r.levels)) for r in found
        ],
        "threshold on P_f, tuned per fleet": [
            (r.probabilities, _least(r.probabilities)) for r in found
        ],
        "threshold on the estimate, tuned over all": _over_all([r.levels for r in found]),
        "threshold on P_f, tuned over all": _over_all([r.probabilities for r in found]),
    }
    print("| policy | cost | failures | repairs | inspections | plan costs less by (95 %) |")
    print("|---|---|---|---|---|---|")
    _line("plan", [(one.plan, 0) for one in found], plan)
    saved = {}
    for name, rows in rivals.items():
        saved[name] = _line(name, rows, plan)
    print(f"\n{given.fleets} fleets, {time.perf_counter() - began:.0f} s.")
    for one, cost in zip(found, plan, strict=True):
        print(
            f"plan {cost:.1f}, interval {one.intervals.cost.min():.1f}, "
            f"estimate {one.levels.cost.min():.1f}, P_f {one.probabilities.cost.min():.1f}",
            file=sys.stderr,
        )
    names = list(rivals)
    enough = all(saved[name][0] >= SAVING for name in names[:2])
    no_worse = all(saved[name][2] >= 0.0 for name in names[2:])
    return 0 if enough and no_worse else 1


def _least(account: PolicyAccount) -> int:
    return int(account.cost.argmin())


def _over_all(accounts: list[PolicyAccount]) -> list[tuple[PolicyAccount, int]]:
    """Choose one parameter for all fleets, by relative cost."""
    relative = np.array([one.cost / one.cost.min() for one in accounts]).mean(axis=0)
    return [(one, int(relative.argmin())) for one in accounts]


def _line(
    name: str, rows: list[tuple[PolicyAccount, int]], plan: Float[np.ndarray, " fleet"]
) -> tuple[float, float, float]:
    cost = np.array([account.cost[row] for account, row in rows])
    counts = [
        float(np.mean([getattr(account, what)[row] for account, row in rows]))
        for what in ("failures", "repairs", "inspections")
    ]
    saved = interval(1.0 - plan / cost)
    told = "" if name == "plan" else "{:.1%} ({:.1%} to {:.1%})".format(*saved)
    print(
        f"| {name} | {cost.mean():.1f} | "
        + " | ".join(f"{n:.1f}" for n in counts)
        + f" | {told} |"
    )
    return saved


if __name__ == "__main__":
    sys.exit(main())

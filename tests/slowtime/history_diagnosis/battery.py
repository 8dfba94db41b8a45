"""Hidden histories by the hundred: what was named, what was made up, what the bands hold.

Run as ``python -m tests.slowtime.history_diagnosis.battery --seed 1``.
"""

import argparse
import dataclasses
from collections.abc import Iterator

import numpy as np
from scipy import stats

from slowtime import history_diagnosis as slow
from tests.slowtime.history_diagnosis.histories import KINDS, PAIRS, SENSORS, Case, hidden

GROUPS: dict[str, tuple[tuple[str, ...], ...]] = {
    "single": tuple((kind,) for kind in KINDS),
    "none": ((),),
    "sensor": tuple((kind,) for kind in SENSORS),
    "pair": PAIRS,
}


@dataclasses.dataclass(frozen=True)
class Score:
    """One case: what it was, what was said, and what the bands did on later epochs."""

    truth: tuple[str, ...]
    named: tuple[str, ...]
    verdict: str
    undecided: tuple[str, ...]
    probability: float
    held: tuple[int, int]
    later: int
    width: tuple[float, float]

    @property
    def exact(self) -> bool:
        """Whether the names, and no others, were given."""
        return self.verdict != "undecided" and sorted(self.named) == sorted(self.truth)

    @property
    def right(self) -> bool:
        """Likewise, where a drift is a drift whatever its curve."""
        return self.verdict != "undecided" and families(self.named) == families(self.truth)


def cases(group: str, count: int, seed: int) -> Iterator[Case]:
    """Cases of a group, its truths in turn."""
    for index in range(count):
        truths = GROUPS[group]
        yield hidden(truths[index % len(truths)], np.random.default_rng([seed, index]))


def covariates(case: Case, first: int, last: int | None) -> tuple[slow.Covariate, ...]:
    """What was read beside, between two epochs."""
    return tuple(
        slow.Covariate(name, values[first:last], unit)
        for name, (unit, values) in case.covariates.items()
    )


def judge(case: Case) -> Score:
    """Diagnose what was there at the time, adopt it, and foretell the rest."""
    k = case.split
    report = slow.diagnose_history(
        case.time[:k], case.value[:k], case.sd[:k], covariates(case, 0, k)
    )
    later = case.time[k:], case.sd[k:], covariates(case, k, None)
    values = case.value[k:]
    nominal = slow.forecast(report.nominal, *later)
    band = slow.forecast(slow.adopt(report), *later)
    steps = slow.follow(slow.adopt(report), later[0], values, *later[1:])
    return Score(
        case.truth,
        tuple(one.effect.kind for one in report.effects),
        report.verdict,
        tuple(dict.fromkeys(rival.effect for rival in report.undecided)),
        min((e.probability for e in report.effects), default=report.nothing_probability),
        tuple(int(((values >= b.lo) & (values <= b.hi)).sum()) for b in (band, steps)),  # type: ignore[arg-type]
        len(values),
        (float(np.mean(nominal.hi - nominal.lo)), float(np.mean(band.hi - band.lo))),
    )


def share(count: int, of: int) -> str:
    """Rate with its binomial interval of 95 % (Clopper and Pearson)."""
    low = stats.beta.ppf(0.025, count, of - count + 1) if count else 0.0
    high = stats.beta.ppf(0.975, count + 1, of - count) if count < of else 1.0
    return f"{count}/{of} = {100 * count / of:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def table(group: str, scores: list[Score]) -> str:
    """Figures of a group."""
    lines = [f"## {group}: {len(scores)} cases"]
    if group == "none":
        false = [s for s in scores if s.named]
        lines.append(f"claimed for nothing    {share(len(false), len(scores))}")
        lines += [f"    {s.named} p={s.probability:.2f}" for s in false]
        open_ = sum(s.verdict == "undecided" for s in scores)
        lines.append(f"undecided              {share(open_, len(scores))}")
    else:
        lines.append(
            f"named                  {share(sum(s.right for s in scores), len(scores))}"
        )
        lines.append(
            f"named to the curve     {share(sum(s.exact for s in scores), len(scores))}"
        )
        for truth in GROUPS[group]:
            own = [s for s in scores if s.truth == truth]
            missed = [s for s in own if not s.right]
            told = ", ".join(f"{'+'.join(s.named) or '-'} ({s.verdict})" for s in missed)
            lines.append(
                f"    {'+'.join(truth):<40} {len(own) - len(missed)}/{len(own)} {told}"
            )
        sure = [s for s in scores if s.named and s.probability >= 0.9]
        if sure:
            lines.append(
                f"right where p >= 0.9   {share(sum(s.right for s in sure), len(sure))}"
            )
    adopted = [s for s in scores if s.named] if group != "none" else scores
    if adopted:
        later = sum(s.later for s in adopted)
        held = [sum(s.held[i] for s in adopted) / later for i in (0, 1)]
        ratio = np.array([s.width[1] / s.width[0] for s in adopted])
        lines.append(
            f"95 % forecast holds    {100 * held[0]:.1f} %, step by step {100 * held[1]:.1f} %"
        )
        lines.append(
            f"band over nominal band median {np.median(ratio):.2f}, "
            f"narrower in {share(int((ratio < 1).sum()), len(ratio))}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--cases",
        type=int,
        default=100,
        help="with one effect; and 1.5 times as many with none",
    )
    parser.add_argument("--groups", nargs="*", default=list(GROUPS), choices=list(GROUPS))
    arguments = parser.parse_args()
    sizes = {"single": 1.0, "none": 1.5, "sensor": 0.2, "pair": 0.4}
    for group in arguments.groups:
        size = sizes[group]
        chosen = cases(group, max(1, round(size * arguments.cases)), arguments.seed)
        print(table(group, [judge(case) for case in chosen]), flush=True)


def families(names: tuple[str, ...]) -> list[str]:
    return sorted("drift" if name.startswith("drift") else name for name in names)


if __name__ == "__main__":
    main()

"""What each proposer and refiner of the diagnosis is worth: ``python -m tests.blind.ablation``.

Every case of a battery is diagnosed once; which proposers gave candidates, and which refiners
changed the hypothesis, is noted. Then it is diagnosed again without each of those that did.
"""

import argparse
import dataclasses
import json
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import PROPOSERS, Proposal, Proposer, Round
from slowtime.discrepancy.refinement.after_effect import REFINERS, Refiner
from slowtime.discrepancy.search import SearchOptions
from slowtime.dynamics.effects import Kind
from slowtime_services.diagnose.results import write_results
from slowtime_services.diagnose.run import diagnose_records
from slowtime_services.diagnose.sources import read_any
from slowtime_services.models import read_description

from .answers import judge, read_report
from .files import CASES, SEALED


@dataclasses.dataclass(frozen=True)
class WatchedProposer:
    """A proposer whose proposals are counted."""

    inner: Proposer
    fired: Counter[str]

    @property
    def name(self) -> str:
        """Name of the proposer that is watched."""
        return self.inner.name

    def __call__(self, given: Round) -> Proposal:
        """Propose what it proposes."""
        proposal = self.inner(given)
        self.fired[label(self.inner)] += bool(proposal.candidates)
        return proposal


def watched(refiner: Refiner, fired: Counter[str]) -> Refiner:
    """Give a refiner whose changes are counted."""

    def refine(
        hypothesis: Hypothesis, kinds: Mapping[str, Kind], monitor: Monitor
    ) -> Hypothesis:
        better = refiner.refine(hypothesis, kinds, monitor)
        fired[label(refiner)] += better is not hypothesis
        return better

    return dataclasses.replace(refiner, refine=refine)


def label(step: Proposer | Refiner) -> str:
    """Give the name of a step, unique among both kinds."""
    kind = "refiner" if isinstance(step, Refiner) else "proposer"
    before = ", before the shortlist" if getattr(step, "only", False) else ""
    return f"{kind}: {step.name}{before}"


def diagnose_without(
    folder: Path, sealed: Path, out: Path, leave_out: str | None
) -> tuple[dict[str, Any], list[str]]:
    """Diagnose one case; its row of the score, and the steps that fired."""
    fired: Counter[str] = Counter()
    listing = json.loads((folder / "case.json").read_text())
    description = read_description(folder / listing["model"])
    records = [read_any(folder / name) for name in listing["records"]]
    found, document = diagnose_records(
        description,
        records,
        [read_any(folder / listing["holdout"])],
        options=SearchOptions(
            proposers=tuple(
                WatchedProposer(one, fired) for one in PROPOSERS if label(one) != leave_out
            ),
            refiners=tuple(watched(one, fired) for one in REFINERS if label(one) != leave_out),
        ),
    )
    write_results(out, found, document)
    truth = json.loads((sealed / "truth.json").read_text())
    row = judge(truth, read_report(out), sealed, out)
    return row, sorted(name for name, count in fired.items() if count)


def ablate(battery: Path, name: str) -> dict[str, Any]:
    """Diagnose one case with all steps, then without each that fired; cached by file."""
    kept = battery / "ablation" / name / "rows.json"
    if kept.exists():
        return dict(json.loads(kept.read_text()))
    folder, sealed = battery / CASES / name, battery / SEALED / name
    whole, fired = diagnose_without(folder, sealed, kept.parent / "all", None)
    rows: dict[str, Any] = {"all": whole, "fired": fired, "without": {}}
    for number, step in enumerate(fired):
        row, _ = diagnose_without(folder, sealed, kept.parent / str(number), step)
        rows["without"][step] = row
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(rows, default=str))
    return rows


def table(every: list[dict[str, Any]]) -> str:
    """Put together in how many cases each step fires, decides, wins and loses."""
    lines = [
        "| step | fires in | decides in | lost without it | won without it |",
        "|---|---|---|---|---|",
    ]
    for step in [*map(label, PROPOSERS), *map(label, REFINERS)]:
        pairs = [(c["all"], c["without"][step]) for c in every if step in c["without"]]
        decides = sum(told(one) != told(other) for one, other in pairs)
        lost = sum(bool(one["exact"]) and not other["exact"] for one, other in pairs)
        won = sum(bool(other["exact"]) and not one["exact"] for one, other in pairs)
        lines.append(f"| {step} | {len(pairs)} | {decides} | {lost} | {won} |")
    return "\n".join(lines)


def told(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Give what a person is told: the verdict and the names."""
    return row["verdict"], tuple(row["named"]), tuple(row["undecided"])


def main() -> None:
    """Ablate a battery, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.blind.ablation", description=__doc__)
    parser.add_argument("battery", type=Path, help="folder that `tests.blind generate` made")
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    names = sorted(folder.name for folder in (given.battery / CASES).iterdir())[: given.cases]
    with ProcessPoolExecutor(given.jobs) as pool:
        every = list(pool.map(ablate, [given.battery] * len(names), names))
    print(f"{len(every)} cases\n\n{table(every)}")


if __name__ == "__main__":
    main()

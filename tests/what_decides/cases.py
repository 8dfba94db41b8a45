"""Cases of the batteries, as they lie in folders, and what is told of each."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slowtime.discrepancy.search import SearchOptions
from slowtime.history_diagnosis import diagnose_history
from slowtime_services.diagnose.results import write_results
from slowtime_services.diagnose.run import diagnose_records
from slowtime_services.diagnose.sources import read_any
from slowtime_services.models import read_description
from tests.blind.answers import judge, read_report
from tests.blind.files import CASES, SEALED
from tests.slowtime.history_diagnosis.battery import GROUPS, covariates, families
from tests.slowtime.history_diagnosis.battery import cases as drawn
from tests.slowtime.history_diagnosis.histories import Case as History
from tests.third_party_rigs.battery import scored

from .steps import PACKAGE

Told = dict[str, Any]
OF_HISTORIES = "slowtime.history_diagnosis"


@dataclass(frozen=True)
class Case:
    """One case: what a person would have, and the folder with the truth.

    Parameters
    ----------
    folder
        Of model and records.
    sealed
        Of the truth.
    listing
        File names: `model`, `records`, `holdout`.
    """

    folder: Path
    sealed: Path
    listing: dict[str, Any]

    @property
    def name(self) -> str:
        """Unique among those of all batteries."""
        return f"{self.folder.parent.name}-{self.folder.name}"

    @property
    def package(self) -> str:
        """Whose thresholds are tried."""
        return PACKAGE

    def diagnosed(self, options: SearchOptions, out: Path) -> Told:
        """Diagnose the case; give what a person is told, and whether that is right."""
        found, document = diagnose_records(
            read_description(self.folder / self.listing["model"]),
            [read_any(self.folder / name) for name in self.listing["records"]],
            [read_any(self.folder / self.listing["holdout"])],
            options=options,
        )
        write_results(out / "found", found, document)
        return {
            "verdict": found.verdict,
            "named": sorted(
                f"{one.effect.kind} at {one.effect.place}" for one in found.effects
            ),
            "undecided": sorted(one.effect for one in found.undecided),
            "left": found.gap.augmented,
            "right": self._is_right(out),
        }

    def _is_right(self, out: Path) -> bool:
        truth = self.sealed / "truth.json"
        if self.sealed != self.folder:
            report = read_report(out / "found")
            row = judge(json.loads(truth.read_text()), report, self.sealed, out / "found")
            return bool(row["exact"])
        (out / "truth.json").write_text(truth.read_text())
        (out / "rig.yaml").write_text((self.folder / "rig.yaml").read_text())
        return bool(scored(out)["outcome"] == "exact")


@dataclass(frozen=True, eq=False)
class HistoryCase:
    """A hidden history, of which only its first part is diagnosed.

    Parameters
    ----------
    name
        Unique among those of all batteries.
    hidden
        The history, and what was put into it.
    """

    name: str
    hidden: History
    package: str = OF_HISTORIES

    def diagnosed(self, options: SearchOptions, out: Path) -> Told:
        """Diagnose the history; give what a person is told, and whether that is right."""
        one, end = self.hidden, self.hidden.split
        read = covariates(one, 0, end)
        found = diagnose_history(one.time[:end], one.value[:end], one.sd[:end], read)
        named = tuple(sorted(each.effect.kind for each in found.effects))
        right = found.verdict != "undecided" and families(named) == families(one.truth)
        undecided = sorted({rival.effect for rival in found.undecided})
        return {
            "verdict": found.verdict, "named": [*named], "undecided": undecided, "left": 0.0,
            "right": right,
        }  # fmt: skip


def histories(count: int, seed: int) -> Iterator[HistoryCase]:
    """Draw so many histories of each group: one effect, none, a sensor's fault, two effects."""
    for group in GROUPS:
        for number, one in enumerate(drawn(group, count, seed)):
            yield HistoryCase(f"history-{seed}-{group}-{number}", one)


def is_same(one: Told, other: Told) -> bool:
    """Whether a person is told the same: the verdict, the names and their places."""
    return all(one[key] == other[key] for key in ("verdict", "named", "undecided"))


def cases_of(battery: Path) -> Iterator[Case]:
    """List the cases of a folder that `tests.blind` or `tests.third_party_rigs` has written."""
    for folder in sorted((battery / CASES).glob("*")):
        listing = json.loads((folder / "case.json").read_text())
        yield Case(folder, battery / SEALED / folder.name, listing)
    for truth in sorted(battery.glob("*/truth.json")):
        names = {"model": "rig.yaml", "records": ["a.npz", "b.npz"], "holdout": "held.npz"}
        yield Case(truth.parent, truth.parent, names)

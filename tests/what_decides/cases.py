"""Cases of the batteries, as they lie in folders, and what is told of each."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slowtime.discrepancy.search import SearchOptions
from slowtime_services.diagnose.results import write_results
from slowtime_services.diagnose.run import diagnose_records
from slowtime_services.diagnose.sources import read_any
from slowtime_services.models import read_description
from tests.blind.answers import judge, read_report
from tests.blind.files import CASES, SEALED
from tests.third_party_rigs.battery import scored

Told = dict[str, Any]


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

"""One case without each step that acts in it, and with other thresholds."""

import hashlib
import json
import random
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from slowtime.discrepancy.search import DEFAULT_OPTIONS, SearchOptions

from .cases import Told, is_same
from .steps import without
from .thresholds import Change, changes, with_changes

AT_ONCE = 64
"""[changes] Of thresholds that are tried at once."""


class Diagnosed(Protocol):
    """A case that can be diagnosed."""

    @property
    def name(self) -> str:
        """Unique among all."""
        ...

    @property
    def package(self) -> str:
        """Whose thresholds are tried."""
        ...

    def diagnosed(self, options: SearchOptions, out: Path) -> Told:
        """Diagnose it; give what a person is told, and whether that is right."""
        ...


class Ablation:
    """What is known of one case; kept in a file, so that nothing is computed twice.

    Parameters
    ----------
    case
        To be diagnosed.
    kept
        File of the results.
    goes_on
        Asked before each diagnosis; `TimeoutError` is raised where it says no.
    """

    def __init__(self, case: Diagnosed, kept: Path, goes_on: Callable[[], bool]) -> None:
        self._case, self._kept, self._goes_on = case, kept, goes_on
        self.known: dict[str, Any] = {"case": case.name, "without": {}, "changed": {}}
        if kept.exists():
            self.known = json.loads(kept.read_text())

    def run(self, *, thresholds: bool = True) -> None:
        """Find what decides this case."""
        if "whole" not in self.known:
            acts: set[str] = set()
            self.known["whole"] = self._diagnosed(None, acts)
            self.known["acts"] = sorted(acts)
            self._keep()
        for step in self.known["acts"]:
            if step not in self.known["without"]:
                self.known["without"][step] = self._diagnosed(step, set())
                self._keep()
        if thresholds:
            self._find_thresholds()

    def _find_thresholds(self) -> None:
        """Try thresholds by the dozen; halve a dozen with which the answer differs."""
        tried = set(self.known.setdefault("tried", []))
        every = [one for one in changes(self._case.package) if one.label not in tried]
        random.Random(1).shuffle(every)
        every.sort(key=lambda one: one.factor)  # stable: none stands beside its own opposite
        waiting = [every[i : i + AT_ONCE] for i in range(0, len(every), AT_ONCE)]
        deciding: dict[str, Told] = self.known.setdefault("deciding", {})
        while waiting:
            group = waiting.pop()
            told = self._changed(group)
            if is_same(told, self.known["whole"]):
                continue
            if len(group) == 1:
                deciding[group[0].label] = told
                continue
            middle = len(group) // 2
            waiting += [group[:middle], group[middle:]]
        self.known["tried"] = sorted({*tried, *(one.label for one in every)})
        self._keep()

    def _changed(self, group: Sequence[Change]) -> Told:
        labels = "\n".join(sorted(one.label for one in group))
        key = hashlib.sha256(labels.encode()).hexdigest()[:16]
        if key not in self.known["changed"]:
            with with_changes(group):
                self.known["changed"][key] = self._told(DEFAULT_OPTIONS)
            self._keep()
        told: Told = self.known["changed"][key]
        return told

    def _diagnosed(self, left_out: str | None, acts: set[str]) -> Told:
        with without(left_out, acts) as options:
            return self._told(options)

    def _told(self, options: Any) -> Told:
        if not self._goes_on():
            raise TimeoutError
        with tempfile.TemporaryDirectory() as out:
            try:
                return self._case.diagnosed(options, Path(out))
            except Exception as error:  # a step that others cannot do without
                return {
                    "verdict": f"failed: {type(error).__name__}", "named": [], "undecided": [],
                    "left": float("nan"), "right": False,
                }  # fmt: skip

    def _keep(self) -> None:
        self._kept.parent.mkdir(parents=True, exist_ok=True)
        self._kept.write_text(json.dumps(self.known, indent=1))

"""The table: in how many cases each step and threshold acts, and in how many it decides."""

from collections.abc import Iterable, Mapping
from typing import Any

from .cases import is_same
from .steps import every_step
from .thresholds import changes

Known = Mapping[str, Any]


def table(every: Iterable[Known]) -> str:
    """Tell of all cases what acts and what decides, as Markdown."""
    known = [one for one in every if "whole" in one]
    right = sum(one["whole"]["right"] for one in known)
    parts = [f"{len(known)} cases, {right} of them answered rightly.", _steps(known)]
    return "\n\n".join([*parts, *_thresholds([one for one in known if "deciding" in one])])


def _steps(known: list[Known]) -> str:
    rows = ["| step | acts in | decides in | lost without it | won without it |",
            "|---|---:|---:|---:|---:|"]  # fmt: skip
    idle = []
    for step in every_step():
        acts = sum(step in one["acts"] for one in known)
        pairs = [
            (one["whole"], one["without"][step]) for one in known if step in one["without"]
        ]
        decides = sum(not is_same(*pair) for pair in pairs)
        lost = sum(whole["right"] and not other["right"] for whole, other in pairs)
        won = sum(other["right"] and not whole["right"] for whole, other in pairs)
        if acts:
            rows.append(f"| {step} | {acts} | {decides} | {lost} | {won} |")
        else:
            idle.append(step)
    return "\n".join(rows) + f"\n\nIn no case: {'; '.join(idle) or 'none'}."


def _thresholds(known: list[Known]) -> list[str]:
    if not known:
        return []
    rows = ["| threshold | decides in | right answers lost | won |", "|---|---:|---:|---:|"]
    for label in (one.label for one in changes()):
        told = [
            (one["whole"], one["deciding"][label]) for one in known if label in one["deciding"]
        ]
        if told:
            lost = sum(whole["right"] and not other["right"] for whole, other in told)
            won = sum(other["right"] and not whole["right"] for whole, other in told)
            rows.append(f"| {label} | {len(told)} | {lost} | {won} |")
    count = len(changes()) // 2
    deciding = len({row.rpartition(" x ")[0] for row in rows[2:]})
    told_of = (
        f"Of {count} thresholds, halved and doubled in {len(known)} cases, {deciding} change "
        "an answer:"
    )
    return [told_of, "\n".join(rows)]

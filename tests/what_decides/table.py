"""The table: in how many cases each step and threshold acts, and in how many it decides."""

from collections.abc import Iterable, Mapping
from typing import Any

from .cases import OF_HISTORIES, is_same
from .steps import PACKAGE, every_step
from .thresholds import changes

Known = Mapping[str, Any]


def table(every: Iterable[Known]) -> str:
    """Tell of all cases what acts and what decides, as Markdown."""
    known = [one for one in every if "whole" in one]
    right = sum(one["whole"]["right"] for one in known)
    parts = [f"{len(known)} cases, {right} of them answered rightly."]
    parts += [_steps(searched)] if (searched := [one for one in known if one["acts"]]) else []
    for package in (PACKAGE, OF_HISTORIES):
        parts += _thresholds([one for one in known if one.get("tried")], package)
    return "\n\n".join(parts)


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


def _thresholds(known: list[Known], package: str) -> list[str]:
    own = {one.label for one in changes(package)}
    known = [one for one in known if own & set(one["tried"])]
    if not known:
        return []
    rows = ["| threshold | decides in | right answers lost | won |", "|---|---:|---:|---:|"]
    broken = set()
    for label in sorted(own):
        told = [
            (one["whole"], one["deciding"][label]) for one in known if label in one["deciding"]
        ]
        if told and all(other["verdict"].startswith("failed") for _, other in told):
            broken.add(label)
        elif told:
            lost = sum(whole["right"] and not other["right"] for whole, other in told)
            won = sum(other["right"] and not whole["right"] for whole, other in told)
            rows.append(f"| {label} | {len(told)} | {lost} | {won} |")
    count = len({label.rpartition(" x ")[0] for one in known for label in one["tried"]})
    deciding = len({row.rpartition(" x ")[0] for row in rows[2:]})
    told_of = (
        f"Of {count} thresholds of `{package}`, halved and doubled in {len(known)} cases, "
        f"{deciding} change an answer:"
    )
    alone = f"Cannot have another value by itself: {'; '.join(sorted(broken)) or 'none'}."
    return [told_of, "\n".join(rows), alone]

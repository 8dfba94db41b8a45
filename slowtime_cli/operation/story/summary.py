"""What the story was, and what the twin made of it: as a document, and in words."""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from slowtime_services.client import Client

from .run import DIAGNOSES, Story
from .scenario import TWIN, YEAR, HiddenEffect, Scenario, years_of

Document = dict[str, Any]

SHOWN = (
    "disagreement",
    "agreement",
    "diagnosed",
    "policy",
    "adopted",
    "undone",
    "model_changed",
)
"""Events of the twin that belong to the story."""


@dataclasses.dataclass(frozen=True, slots=True)
class Gathered:
    """What the twin server answered at the end of a run.

    Parameters
    ----------
    calendar
        Clock of the server [ns since 1970] and years of the twin's calendar, in order.
    done
        Faults and acts of people.
    held_s
        How long a sped-up calendar stood still, while the twin computed [s].
    """

    digest: Mapping[str, Any]
    gap: Mapping[str, Any]
    diagnoses: Sequence[Mapping[str, Any]]
    events: Sequence[Mapping[str, Any]]
    states: Sequence[Mapping[str, Any]]
    outlooks: Mapping[str, Any]
    done: Sequence[Mapping[str, Any]]
    calendar: Sequence[tuple[int, float]]
    held_s: float

    def years_at(self, t_ns: int) -> float:
        """Years of the calendar at an instant of the server's clock."""
        clock, years = zip(*self.calendar, strict=True)
        return float(np.interp(t_ns, clock, years))


def gather(client: Client, story: Story) -> Gathered:
    """Ask the twin server for all that the summary is made of."""
    history = client.json("GET", f"/twins/{TWIN}/history", {"max_points": 100_000})
    events = client.json("GET", f"/twins/{TWIN}/events", {"limit": 10_000})["events"]
    return Gathered(
        digest=client.digest(TWIN).model_dump(),
        gap=client.json("GET", f"/twins/{TWIN}/gap"),
        diagnoses=client.json("GET", DIAGNOSES)["diagnoses"][::-1],
        events=events,
        states=history["points"],
        outlooks=story.outlooks,
        done=story.done,
        calendar=story.calendar,
        held_s=story.held_s,
    )


def summary(of: Scenario, found: Gathered, replayed: str) -> Document:
    """Return the summary of a run.

    Parameters
    ----------
    replayed
        Hash of the history that a replay of the recording gives.

    Returns
    -------
    What entered when, when it was noticed, what was named, the gap before and after, and what
    was lost, as JSON has it.
    """
    gap = gap_readings(of, found)
    judged = [_judged(of.effect, one, found) for one in found.diagnoses]
    return {
        "slowtime_story": 1,
        "seed": of.seed,
        "records": of.records,
        "days_per_record": of.days_per_record,
        "real_time": of.real_time,
        "calendar_held_s": round(found.held_s, 1),
        "entered": {
            "effect": of.effect.kind,
            "place": of.effect.place,
            "parameters": {
                name: value for name, value in of.effect.entry.items() if _is_number(value)
            },
            "years": round(of.effect.enters, 3),
            "left_years": of.effect.leaves,
        },
        "noticed": _noticed(of, gap),
        "named": _named(of, found, judged),
        "diagnoses": judged,
        "gap": _gap_figures(of, found, gap),
        "false_alarms_before": _false_alarms(of, found, judged),
        "decisions": list(_decisions(found)),
        "faults": _faults(of, found),
        "outlooks": dict(found.outlooks),
        "hash": {
            "run": found.digest["sha256"],
            "replay": replayed,
            "equal": found.digest["sha256"] == replayed,
        },
        "timeline": timeline(of, found),
    }


def gap_readings(of: Scenario, found: Gathered) -> list[dict[str, Any]]:
    """Return the readings of the gap, each with its time on the calendar [years]."""
    return [
        {**reading, "years": years_of(of, reading["t_ns"])} for reading in found.gap["readings"]
    ]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _noticed(of: Scenario, gap: Sequence[Mapping[str, Any]]) -> Document | None:
    """When two records in a row were beyond the limit; None where they never were."""
    for before, after in itertools.pairwise(gap):
        both = before["disagrees"] and after["disagrees"]
        if both and of.effect.enters <= before["years"] < of.effect.leaves:
            days = (after["years"] - of.effect.enters) * YEAR
            return {
                "years": round(after["years"], 3),
                "days_after": round(days, 1),
                "records_after": round(days / of.days_per_record, 1),
            }
    return None


def _judged(effect: HiddenEffect, one: Mapping[str, Any], found: Gathered) -> Document:
    """Return a diagnosis in short, with its outcome against the truth."""
    report = one["report"]
    return {
        "number": one["number"],
        "years": round(found.years_at(one["asked_ns"]), 3),
        "state": one["state"],
        "seconds": round(((one["ended_ns"] or one["asked_ns"]) - one["asked_ns"]) / 1e9, 1),
        "outcome": one["state"] if report is None else outcome(effect, report),
        "sentence": one["error"] if report is None else report["sentence"],
        "adopted": one["adopted"],
    }


def outcome(effect: HiddenEffect, report: Mapping[str, Any]) -> str:
    """Judge the report of a diagnosis by the truth.

    Returns
    -------
    ``"named"``, ``"undecided with the truth"``, ``"undecided without the truth"``,
    ``"named wrongly"``, or ``"not named"``.
    """
    truth = effect.kind, _ends(effect.place)
    if report["verdict"] == "undecided":
        may_be = [_what_and_where(one) for one in report["undecided"]]
        return "undecided with the truth" if truth in may_be else "undecided without the truth"
    named = [_what_and_where(one) for one in report["effects"]]
    if named == [truth]:
        return "named"
    return "named wrongly" if named else "not named"


def _what_and_where(one: Mapping[str, Any]) -> tuple[str, frozenset[str]]:
    return one["effect"], _ends(one["where"]["id"])


def _ends(place: str) -> frozenset[str]:
    """Two joined points have no order."""
    return frozenset(place.split("-"))


def _named(
    of: Scenario, found: Gathered, judged: Sequence[Mapping[str, Any]]
) -> Document | None:
    """Return the diagnosis that counts; None where none was made while the effect was there.

    That is the one that was adopted first, else the first with an answer, else the last.
    """
    during = [
        one
        for one in judged
        if one["state"] == "done" and of.effect.enters <= one["years"] < of.effect.leaves
    ]
    adopted = [one["details"]["diagnosis"] for one in found.events if one["kind"] == "adopted"]
    first = [one for one in during if one["number"] in adopted[:1]]
    told = [one for one in during if one["outcome"] != "not named"]
    return dict((first or told or during[-1:])[0]) if during else None


def _gap_figures(of: Scenario, found: Gathered, gap: Sequence[Mapping[str, Any]]) -> Document:
    during = [one for one in gap if of.effect.enters <= one["years"] < of.effect.leaves]
    adopted = [one for one in during if one["in_use"] != one["nominal"]]
    return {
        "usual": found.gap["expected"],
        "limit": found.gap["limit"],
        "without_adoption": _median([one["nominal"] for one in during]),
        "with_adoption": _median([one["in_use"] for one in adopted]),
        "records_with_adoption": len(adopted),
        "after_repair": _median([one["nominal"] for one in gap if one["years"] >= 7.2]),
    }


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def _false_alarms(
    of: Scenario, found: Gathered, judged: Sequence[Mapping[str, Any]]
) -> Document:
    told = [one for one in found.events if one["kind"] == "disagreement"]
    before = [one for one in told if found.years_at(one["t_ns"]) < of.effect.enters]
    return {
        "disagreements": len(before),
        "diagnoses": sum(one["years"] < of.effect.enters for one in judged),
    }


def _decisions(found: Gathered) -> Iterator[Document]:
    """Yield what was adopted and undone, with the reasons."""
    for one in found.events:
        if one["kind"] in ("adopted", "undone", "policy"):
            yield {
                "kind": one["kind"],
                "years": round(found.years_at(one["t_ns"]), 3),
                "diagnosis": one["details"].get("diagnosis"),
                "message": one["message"],
            }


def _faults(of: Scenario, found: Gathered) -> Document:
    states = found.states
    return {
        "records_measured": of.records,
        "records_in_history": len(states),
        "lost": sum(one["missing_before"] for one in states),
        "survived": [one["what"] for one in found.done if one["what"].startswith(("r", "e"))],
    }


def timeline(of: Scenario, found: Gathered) -> list[Document]:
    """Return all that happened, in order: truth, people and faults, and the twin."""
    effect = of.effect
    hidden = [
        (effect.enters, f"{effect.kind} enters at {effect.place}; nobody is told."),
        (effect.leaves, f"{effect.kind} is gone."),
    ]
    told: list[dict[str, Any]] = [
        {"years": years, "by": "truth", "text": text} for years, text in hidden
    ]
    told += [
        {"years": one["years"], "by": "people and faults", "text": one["text"]}
        for one in found.done
    ]
    told += [
        {"years": found.years_at(one["t_ns"]), "by": "twin", "text": one["message"]}
        for one in found.events
        if one["kind"] in SHOWN
    ]
    return sorted(
        ({**one, "years": round(one["years"], 3)} for one in told),
        key=lambda one: one["years"],
    )


def in_words(document: Mapping[str, Any]) -> list[str]:
    """Return the summary as sentences."""
    entered, noticed = document["entered"], document["noticed"]
    named, gap, hashes = document["named"], document["gap"], document["hash"]
    said = [f"Year {entered['years']:.2f}: {entered['effect']} enters at {entered['place']}."]
    if noticed is None:
        said.append("It was not noticed.")
    else:
        said.append(
            f"Noticed {noticed['days_after']:.0f} days later, in record "
            f"{noticed['records_after']:.0f} after it entered."
        )
    if named is not None:
        said.append(f"Diagnosis {named['number']}, {named['outcome']}: {named['sentence']}")
    if gap["with_adoption"] is not None:
        said.append(
            f"On later records the error of the free run is {gap['with_adoption']:.1%} with "
            f"the adopted model and {gap['without_adoption']:.1%} without; "
            f"{gap['usual']:.1%} was usual before."
        )
    false, faults = document["false_alarms_before"], document["faults"]
    said.append(
        f"Before it entered: {false['disagreements']} false alarms, {false['diagnoses']} "
        "diagnoses."
    )
    undone = [one["message"] for one in document["decisions"] if "undone" in one["message"]]
    said += undone
    said.append(
        f"{faults['records_in_history']} of {faults['records_measured']} records are in the "
        f"history, {faults['lost']} are lost."
    )
    said.append(
        f"The replay in another process gives {'the same' if hashes['equal'] else 'another'} "
        f"hash: {hashes['replay'][:16]}…"
    )
    return said

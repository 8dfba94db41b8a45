"""How a run is summed up: when it was noticed, what was named, which alarms were false."""

from typing import Any

import pytest

from slowtime_cli.operation.story.page import write_story_page
from slowtime_cli.operation.story.scenario import YEAR, scenario, structure
from slowtime_cli.operation.story.summary import Gathered, in_words, outcome, summary
from slowtime_services.simulate import ORIGIN_NS, simulated_structure

OF = scenario(2, 300.0)  # a spring between the ground and a floor
ENTERS, LEAVES = OF.effect.enters, OF.effect.leaves
T0 = 1_800_000_000_000_000_000


def at(years):
    """Clock of the server, a minute a year."""
    return T0 + round(60e9 * years)


def effect(kind, place):
    return {"effect": kind, "where": {"kind": "element", "id": place}, "probability": 0.99}


def report(effects=(), undecided=(), verdict="missing_effect"):
    return {
        "verdict": verdict, "sentence": "Said.", "effects": list(effects),
        "undecided": list(undecided),
    }  # fmt: skip


RIGHT = effect("missing_spring", OF.effect.place)
TURNED = effect("missing_spring", "-".join(reversed(OF.effect.place.split("-"))))
WRONG = effect("coulomb", "storey1")


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        (report([RIGHT]), "named"),
        (report([TURNED]), "named"),
        (report([RIGHT, WRONG]), "named wrongly"),
        (report([WRONG]), "named wrongly"),
        (report([WRONG], [WRONG, RIGHT], "undecided"), "undecided with the truth"),
        (report([RIGHT], [WRONG], "undecided"), "undecided without the truth"),
        (report(), "not named"),
    ],
)
def test_a_diagnosis_is_judged_by_the_truth(told, expected):
    assert outcome(OF.effect, told) == expected


def reading(years, nominal, in_use=None, disagrees=False):
    interval_s = structure(OF)["interval_s"]
    t_ns = ORIGIN_NS + round(years * YEAR / OF.days_per_record * interval_s * 1e9)
    in_use = nominal if in_use is None else in_use
    return {"t_ns": t_ns, "nominal": nominal, "in_use": in_use, "disagrees": disagrees}


def event(years, kind, message, **details):
    return {"t_ns": at(years), "kind": kind, "message": message, "details": details}


def gathered(**changed):
    readings = [
        reading(1.0, 0.02), reading(ENTERS + 0.02, 0.2, disagrees=True),
        reading(ENTERS + 0.05, 0.2, disagrees=True), reading(ENTERS + 0.2, 0.21, 0.021),
        reading(5.0, 0.22, 0.022), reading(LEAVES + 0.5, 0.02),
    ]  # fmt: skip
    block = simulated_structure(structure(OF)).epoch(0)[0]
    state = {
        "valid": True, "slow_time": 0.0, "missing_before": 0, "truth": dict(block.truth),
        "stiffness_change": {"value": -0.01},
    }  # fmt: skip
    given: dict[str, Any] = {
        "digest": {"sha256": "ab" * 32, "features": 1500},
        "gap": {"readings": readings, "expected": 0.02, "limit": 0.024},
        "diagnoses": [
            {
                "number": 1, "asked_ns": at(ENTERS + 0.06), "ended_ns": at(ENTERS + 0.1),
                "state": "done", "error": "", "report": report([RIGHT]), "adopted": True,
            }
        ],
        "events": [
            event(ENTERS + 0.05, "disagreement", "The model no longer explains what arrives."),
            event(ENTERS + 0.1, "adopted", "Adopted diagnosis 1.", diagnosis=1),
            event(LEAVES + 0.3, "undone", "Undone: diagnosis 1.", diagnosis=1),
        ],
        "states": [state] * 3,
        "outlooks": {"before": {"years": 2.9, "forecast": ["No."], "storm": "unknown"}},
        "done": [{"what": "router_restarted", "years": 1.5, "text": "The router is ended."}],
        "calendar": [(at(0.0), 0.0), (at(10.0), 10.0)],
        "held_s": 12.0,
    }  # fmt: skip
    return Gathered(**(given | changed))


def test_the_second_record_beyond_the_limit_is_when_it_was_noticed():
    told = summary(OF, gathered(), "ab" * 32)
    assert told["noticed"]["days_after"] == pytest.approx(0.05 * YEAR, abs=0.1)
    assert told["named"]["outcome"] == "named"
    gap = told["gap"]
    assert gap["with_adoption"] == pytest.approx(0.0215)
    assert gap["without_adoption"] == pytest.approx(0.205)
    assert gap["records_with_adoption"] == 2
    assert told["false_alarms_before"] == {"disagreements": 0, "diagnoses": 0}
    assert [one["kind"] for one in told["decisions"]] == ["adopted", "undone"]
    assert told["hash"]["equal"] is True
    years = [one["years"] for one in told["timeline"]]
    assert years == sorted(years)


def test_alarms_before_it_entered_are_false():
    early = event(2.0, "disagreement", "The model no longer explains what arrives.")
    diagnosis = dict(gathered().diagnoses[0], asked_ns=at(2.1), report=report([WRONG]))
    told = summary(OF, gathered(events=[early], diagnoses=[diagnosis]), "cd" * 32)
    assert told["false_alarms_before"] == {"disagreements": 1, "diagnoses": 1}
    assert told["named"] is None
    assert told["hash"]["equal"] is False


def test_what_was_never_noticed_is_said():
    quiet = {"readings": [reading(1.0, 0.02)], "expected": 0.02, "limit": 0.024}
    told = summary(OF, gathered(gap=quiet, diagnoses=[], events=[]), "ab" * 32)
    assert (told["noticed"], told["named"]) == (None, None)
    assert "It was not noticed." in in_words(told)


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_page_shows_the_run(tmp_path, language):
    found = gathered()
    told = summary(OF, found, "ab" * 32)
    write_story_page(tmp_path / "story.html", OF, found, told, language)
    text = (tmp_path / "story.html").read_text()
    assert text.count('class="chart"') == 2
    for part in ("missing_spring", "The router is ended.", "Undone: diagnosis 1."):
        assert part in text

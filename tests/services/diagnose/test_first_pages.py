"""The first page of a diagnosis tells what a fit did to constants, and the best rival."""

import dataclasses
import re

import pytest

from slowtime.discrepancy.diagnosis import Rival, Suspect, Verdict
from slowtime.dynamics.effects import Place
from slowtime_services.diagnose import document_of, write_report
from slowtime_services.diagnose.constants import changes_of
from slowtime_services.diagnose.first_pages import diagnosis_page
from slowtime_services.reports import Words

from .slide import SLIDE, told


def fitted(stiffness=800.0, damping=1.6):
    spring = dataclasses.replace(
        SLIDE.elements[0], stiffness_n_per_m=stiffness, damping_n_s_per_m=damping
    )
    return dataclasses.replace(SLIDE, elements=(spring,))


def page_of(language="en", **changes):
    found = dataclasses.replace(told(), **changes)
    return diagnosis_page(found, document_of(found), Words(language))


@pytest.mark.parametrize(
    ("stiffness", "said"),
    [
        (796.0, "Within its tolerance, the fit moved most: stiffness of j by −0.5 % "
                "(800 → 796 N/m)."),
        (600.0, "Constants that the fit moved beyond their tolerance: stiffness of j by −25 % "
                "(800 → 600 N/m)."),
        (800.0, ""),
    ],
)  # fmt: skip
def test_moved_constants_are_on_the_first_page(stiffness, said):
    assert page_of(augmented=fitted(stiffness)).definition == said


def test_a_fit_of_absurd_constants_is_not_to_be_used_where_an_effect_is_unknown():
    unknown = {"verdict": "unknown_effect", "effects": ()}
    assert page_of(**unknown, augmented=fitted(0.3)).actions[0] == (
        "Do not use the fitted model (augmented.yaml): its constants are not those of the "
        "structure, stiffness of j by −99.96 % (800 → 0.3 N/m)."
    )
    page = page_of("de", **unknown, augmented=fitted(-1.0))
    assert page.actions[0].startswith("Das angepasste Modell (augmented.yaml) nicht verwenden")
    usual = page_of(**unknown, augmented=fitted(780.0))
    assert not any("Do not use" in action for action in usual.actions)


def test_the_best_rival_is_named_however_far_behind():
    [effect] = told().effects
    far = dataclasses.replace(
        effect, rivals=(Rival("gap_symmetric", Place("element", "j"), 1e-6),)
    )
    [rival] = page_of(effects=(far,)).alternatives
    assert rival.name == "gap symmetric at element j"
    assert rival.measure == "the most probable of those tried, probability < 0.1 %"
    weak = Suspect(Place("element", "j"), 0.31, 0.8, 1.0)
    [rival] = page_of(verdict="nothing_missing", effects=(), where=(weak,)).alternatives
    assert rival.name == "an unknown force at element j"
    assert "by 0.31 nats (p-value 0.8)" in rival.measure
    assert not page_of(effects=(dataclasses.replace(effect, rivals=()),)).alternatives


def test_a_faulty_sensor_has_no_force(tmp_path):
    found = told()
    when = dataclasses.replace(found.when, amplitude="The force acts at 14 m.")
    verdicts: dict[Verdict, bool] = {"missing_effect": True, "sensor_fault": False}
    for verdict, forces in verdicts.items():
        one = dataclasses.replace(found, verdict=verdict, when=when)
        write_report(tmp_path / "r.html", one, document_of(one))
        page = (tmp_path / "r.html").read_text(encoding="utf-8")
        assert ("The force acts" in page) == forces
        assert bool(re.search(r"<h2[^>]*>The force recovered", page)) == forces


def test_constants_of_rotations_have_their_units():
    turning = dataclasses.replace(SLIDE, unit_of_coordinate="rad", inputs=(), sensors=())
    assert [one.label for one in changes_of(turning, turning)] == [
        "mass of m [kg m²]", "stiffness of j [N m/rad]", "damping of j [N m s/rad]",
    ]  # fmt: skip

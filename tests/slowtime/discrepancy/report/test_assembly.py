"""Verdict and words follow from an outcome in the same way, whatever the likelihood."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import Experiment, Number, Rival, Spectra
from slowtime.discrepancy.report.assembly import assemble
from slowtime.discrepancy.report.outcome import (
    NOTHING,
    CampaignOutcome,
    ErrorMeasure,
    gap_of,
)
from slowtime.discrepancy.report.sentences import CONTRADICTED
from slowtime.dynamics.effects import Effect, catalogue
from tests.slowtime.discrepancy.protocol import named_effect
from tests.slowtime.discrepancy.rigs import ONE, PLACE

KINDS = catalogue()
FRICTION = named_effect(Effect("coulomb", PLACE, {"friction_n": 1.0}), KINDS, 0.9)
RIVALS = (Rival("coulomb", PLACE, 0.5), Rival("quadratic_damping", PLACE, 0.4))
MOVED = {"stiffness k1": Number(25.0, 0.1, "N/m")}
CLIPPED = Finding(
    fault="clipped", channel="x", spans_s=((1.0, 3.0),), share=0.1, level=5.0, level_sd=0.2
)
FORCES = ErrorMeasure(" of the force", "{:.2f}".format, "as expected", "expected were")
EMPTY = np.zeros((0, 1))


def outcome(*errors, **changed):
    """Give what a likelihood says: nothing is missing, and errors are those of noise."""
    effects = changed.get("effects", ())
    known = {
        "effects": effects, "undecided": (), "unknown": "", "moved": {},
        "gap": gap_of(effects, errors or (0.1,), nominal=0.5, floor=0.1, held_out=True),
        "refitted": ONE, "augmented": ONE, "nothing_probability": 0.5, "chi2_per_datum": 1.0,
        "residual_white": True, "white_p_value": 0.5, "traces": (), "notes": ("noted",),
        "spectra": Spectra(np.zeros(0), EMPTY, EMPTY, EMPTY, EMPTY),
    }  # fmt: skip
    return CampaignOutcome(**(known | changed))


@pytest.mark.parametrize(
    ("said", "findings", "verdict", "told"),
    [
        ({}, (), "nothing_missing", "Nothing is missing"),
        ({}, (CLIPPED,), "sensor_fault", "Channel 'x'"),
        ({"moved": MOVED}, (), "parameters_only", "stiffness k1 = 25.00 ± 0.10 N/m"),
        ({"moved": MOVED}, (CLIPPED,), "sensor_fault", "Channel 'x'"),
        ({"effects": (FRICTION,)}, (CLIPPED,), "missing_effect", "as named Channel 'x'"),
        ({"undecided": RIVALS}, (CLIPPED,), "undecided", "(coulomb) at element"),
        ({"unknown": "Something else."}, (CLIPPED,), "unknown_effect", "Something else."),
        ({"unknown": "All else.", "undecided": RIVALS}, (), "unknown_effect", "All else."),
    ],
)
def test_the_verdict_is_the_first_that_holds_of_one_order(said, findings, verdict, told):
    found = assemble(ONE, outcome(**said), findings, KINDS)
    assert found.verdict == verdict
    assert told in found.sentence
    assert found.undecided == (RIVALS if verdict == "undecided" else ())
    faults = [one for one in found.effects if one.effect.kind == "sensor_saturation"]
    assert len(faults) == len(findings)
    assert found.findings == findings
    assert found.notes == ("noted",)


@pytest.mark.parametrize(
    ("error", "measure", "told"),
    [
        (0.1, ErrorMeasure(), "falls from 50 % to 10 %, the noise floor."),
        (0.2, ErrorMeasure(), "falls from 50 % to 20 %; noise alone would give 10 %."),
        (0.48, ErrorMeasure(), "The error on the held-out record is 48 %; noise alone"),
        (0.1, FORCES, "the error of the force on the held-out record falls from 0.50 to 0.10, "
         "as expected."),
    ],
)  # fmt: skip
def test_the_gap_is_told_in_the_measure_of_the_likelihood(error, measure, told):
    said = outcome(0.5, error, effects=(FRICTION,), measure=measure)
    found = assemble(ONE, said, (), KINDS)
    assert told in found.sentence
    (step,) = found.gap.steps
    assert (step.effect, step.place, step.nrmse) == ("coulomb", PLACE, error)


def test_a_model_that_lacks_nothing_is_contradicted_by_held_out_records_alone():
    missed = outcome(0.6)
    assert CONTRADICTED in assemble(ONE, missed, (), KINDS).sentence
    tail = dataclasses.replace(missed, gap=dataclasses.replace(missed.gap, on="tail"))
    assert CONTRADICTED not in assemble(ONE, tail, (), KINDS).sentence


def test_an_experiment_is_said_to_decide_where_something_is_undecided():
    measure = Experiment("Measure the force.")
    doubted = outcome(undecided=RIVALS, experiment=measure)
    assert "would decide: Measure the force." in assemble(ONE, doubted, (), KINDS).sentence
    sure = assemble(ONE, outcome(experiment=measure), (), KINDS)
    assert "would decide" not in sure.sentence
    assert "Measure the force." in sure.sentence


def test_it_is_not_said_that_something_is_missing_where_nothing_is_a_rival():
    nothing = Rival(NOTHING, PLACE, 0.4)
    found = assemble(ONE, outcome(undecided=(nothing, RIVALS[1])), (), KINDS)
    assert "do not tell whether something is missing" in found.sentence
    assert "Possible explanations: nothing or " in found.sentence
    assert "Something is missing" not in found.sentence

"""One report of each kind, of made-up results, for tests of what all reports have in common."""

import copy
from pathlib import Path

import numpy as np

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.estimates import Measured
from slowtime.identification.modes import Mode
from slowtime.identification.subspace.stabilisation import Stabilisation
from slowtime.reliability import Problem, estimate, marginal
from slowtime_cli.records import mode_tables
from slowtime_schemas.answers.plans import PLAN_EXAMPLE
from slowtime_services.diagnose import document_of, write_report
from slowtime_services.problem_files.stated import Stated
from slowtime_services.reports import Section, Sketch, Words
from slowtime_services.reports.kinds.modes import modes_page
from slowtime_services.reports.kinds.plan import write_plan_report
from slowtime_services.reports.kinds.reliability import write_reliability_report
from slowtime_services.reports.kinds.state import write_state_report
from slowtime_services.reports.page import write_page
from tests.services.diagnose.slide import told

MEASURED_NS = 1_772_619_600_000_000_000
"""2026-03-04 10:20 UTC [ns]."""

CHANNELS = ("roof", "middle", "ground")


def mode_at(hz, kind="structural", flags=(), shape=(1.0, 0.6, 0.1)):
    shape = np.array(shape, dtype=complex) / np.linalg.norm(shape)
    return Mode(
        frequency_hz=Measured(hz, 0.002 * hz),
        damping_ratio=Measured(0.012, 0.001),
        correlation=0.1,
        shape=shape,
        shape_sd=np.full(3, 0.01),
        kind=kind,
        quality=0.9,
        flags=flags,
    )


def modal_result():
    """Two modes, one of them doubted, and the line of a machine."""
    doubted = mode_at(7.0, flags=("few_orders",), shape=(1.0, -0.9, 0.3))
    return modal_result_of((mode_at(2.5), doubted, mode_at(10.0, "harmonic")))


def modal_result_of(modes):
    """Modes with a spectrum of two peaks."""
    empty = np.zeros(0)
    none = Stabilisation(
        np.zeros(0, dtype=int), empty, empty, empty, empty, np.zeros(0, dtype=int)
    )
    hz = np.linspace(0.0, 20.0, 200)
    values = 1.0 / (0.01 + (hz[:, None] - np.array([2.5, 7.0])) ** 2)
    return ModalResult(modes=modes, stabilisation=none, spectrum_hz=hz, singular_values=values)


def modes(path: Path, language: str) -> None:
    """Write a report on modes, as `slowtime identify` does, with a sketch."""
    result, words = modal_result(), Words(language)
    sketch = Sketch([("1", 0.0, 0.0), ("2", 0.0, 3.0)], [("1–2", "1", "2")], ("2",))
    first = modes_page(
        "tower.csv",
        result,
        CHANNELS,
        words,
        rate_hz=40.0,
        duration_s=600.0,
        start_ns=MEASURED_NS,
        sketch=sketch,
    )
    table = mode_tables.mode_table(result, (), words)
    spectra = mode_tables._spectra(result, "Spectra.")
    sections = [Section("Modes", (), [table]), *mode_tables.line_sections(result)]
    write_page(
        path, "Modes", first.answer, sections, first=first, picture=spectra, language=language
    )


def modes_with_shapes(path: Path, language: str) -> None:
    """Write a report on modes with their shapes, whose legend switches them."""
    result, words = modal_result(), Words(language)
    first = modes_page("tower.csv", result, CHANNELS, words)
    shapes = Section("Shapes", (), [mode_tables._shapes(result, CHANNELS)])
    write_page(path, "Modes", first.answer, [shapes], first=first, language=language)


def diagnosis(path: Path, language: str) -> None:
    """Write the report of a slide that grows stiffer."""
    found = told()
    document = document_of(found, records=["learn.npz"], holdout=["judge.npz"])
    write_report(path, found, document, language=language)


def reliability(path: Path, language: str) -> None:
    """Write the report of a difference of two normal numbers."""
    inputs = {
        "strength": marginal("normal", mean=200.0, sd=20.0),
        "load": marginal("normal", mean=150.0, sd=20.0),
    }
    problem = Problem(inputs, lambda x: x[:, 0] - x[:, 1])
    found = [estimate(problem, name, seed=1) for name in ("form", "monte-carlo")]
    refused = {"system": "No part has a design point. Use a sampling method instead."}
    write_reliability_report(
        path, "beam.yaml", problem, found, refused, seed=1,
        stated=Stated(
            name="Beam", failure="the beam breaks", period="50 years", accepted=0.01,
            units={"strength": "MPa", "load": "MPa"},
        ),
        language=language,
    )  # fmt: skip


def plan_answer():
    """Give the plan of the reference, with an option of about its cost, and its alternative."""
    plan = copy.deepcopy(PLAN_EXAMPLE)
    other = copy.deepcopy(plan["options"][0])
    other |= {"name": "age", "words": "order a repair for an age of 3 years from now on"}
    other["cost"]["value"] = 63000.0
    now = copy.deepcopy(plan["options"][0])
    now |= {"name": "repair_now", "words": "repair now", "now": "repair"}
    now |= {"parameters": {"at": 0.5, "order": 0.0}}
    now["cost"]["value"] = 73600.0
    plan["options"] += [other, now]
    return plan


def plan(path: Path, language: str) -> None:
    """Write the report of a plan."""
    write_plan_report(path, plan_answer(), language=language)


LEARNING = (
    "The nominal model is still being learnt from the first epochs. Wait, or give the "
    "nominal frequency and damping ratio in the twin's registration."
)


def states(loss=0.25, sd=0.01):
    """Epochs of a beam that loses stiffness evenly."""
    return [
        {
            "slow_time": float(k),
            "slow_time_unit": "d",
            "valid": k > 2,
            "reasons": [] if k > 2 else [LEARNING],
            "frequency_hz": {"value": 3.0 * (1 - loss * k / 40) ** 0.5, "sd": 0.01},
            "stiffness_change": {"value": -loss * k / 40, "sd": sd},
        }
        for k in range(41)
    ]


def state(path: Path, language: str) -> None:
    """Write the report of a state."""
    write_state_report(
        path, "beam.csv", states(), "stiffness", structure="lab.beam", language=language
    )


WRITERS = {
    "modes": modes,
    "diagnosis": diagnosis,
    "reliability": reliability,
    "plan": plan,
    "state": state,
}

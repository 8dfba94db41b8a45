"""A diagnosis as files: what others script against, what people read, what simulators run."""

import dataclasses
import json
import math

import numpy as np
import pytest

from slowtime.discrepancy.diagnosis import Experiment, Rival
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.effects import Place
from slowtime_schemas.files.diagnosis import DiagnosisFile
from slowtime_services.diagnose import document_of, write_results
from slowtime_services.diagnose.charts import residual_charts, run_charts
from slowtime_services.models import read_description
from tests.services.diagnose.slide import CUBIC, SAMPLES, SLIDE, told


@pytest.fixture(scope="module")
def answer():
    diagnosis = told()
    return diagnosis, document_of(diagnosis, records=["learn.npz"], holdout=["judge.npz"])


@pytest.fixture
def out(tmp_path, answer):
    write_results(tmp_path / "found", *answer)
    return tmp_path / "found"


def test_the_report_for_machines_holds_what_was_found(out):
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"] == "missing_effect"
    (effect,) = report["effects"]
    assert effect["where"] == {"kind": "element", "id": "j"}
    assert effect["parameters"] == {
        "k3_n_per_m3": {"value": 1.99e5, "sd": 300.0, "unit": "N/m^3"}
    }
    assert effect["alternatives"][0]["effect"] == "gap_symmetric"
    assert report["gap"]["measure"] == "nrmse"
    assert report["gap"]["on"] == "holdout"
    assert report["moved"][0]["name"] == "stiffness j"
    assert (report["records"], report["holdout"]) == (["learn.npz"], ["judge.npz"])
    assert DiagnosisFile.model_validate(report).seconds == 2.5


def test_the_augmented_model_reads_back_with_its_effect(out):
    text = (out / "augmented.yaml").read_text()
    assert text.startswith("# missing_effect\n# Cubic hardening (cubic_hardening) at element j")
    effect = read_description(out / "augmented.yaml").effects[0]
    assert effect["effect"] == "cubic_hardening"
    assert effect["k3_n_per_m3"] == pytest.approx(CUBIC["k3_n_per_m3"], rel=0.02)


def test_a_diagnosis_without_free_runs_is_written_without_them(tmp_path, answer):
    imposed = dataclasses.replace(answer[0], traces=())
    write_results(tmp_path, answer[0], answer[1])
    write_results(tmp_path, imposed, answer[1])
    assert (tmp_path / "report.json").exists()
    assert not (tmp_path / "holdout.npz").exists()


def test_free_runs_on_what_was_held_out_are_whole(out, answer):
    trace = answer[0].traces[0]
    with np.load(out / "holdout.npz") as runs:
        assert runs["channels"].tolist() == ["x", "a"]
        assert set(runs["record"].tolist()) == {0}
        for name, run in (
            ("nominal", trace.nominal),
            ("refitted_nominal", trace.refitted),
            ("augmented", trace.augmented),
            ("measured", trace.measured),
            ("t", trace.times_s),
        ):
            np.testing.assert_array_equal(runs[name], run)


def test_runs_of_an_imposed_motion_are_those_of_its_force(tmp_path, answer):
    """Two sensors, one force: the column is called after the input, and no chart shows it."""
    found, document = answer
    (trace,) = found.traces
    force = {
        name: getattr(trace, name)[:, :1]
        for name in ("measured", "nominal", "refitted", "augmented")
    }
    imposed = dataclasses.replace(
        found, traces=(dataclasses.replace(trace, of_force=True, **force),)
    )
    write_results(tmp_path, imposed, document)
    with np.load(tmp_path / "holdout.npz") as runs:
        assert runs["channels"].tolist() == ["u"]
        np.testing.assert_array_equal(runs["measured"], force["measured"])
        assert runs["augmented"].shape == (len(trace.times_s), 1)
    assert run_charts(imposed) == []
    assert len(residual_charts(imposed)) == len(residual_charts(found)) - len(SLIDE.sensors)


def test_pictures_are_thinned_without_losing_an_extreme(answer):
    diagnosis, _ = answer
    spiked = diagnosis.traces[0].measured.copy()
    spiked[777, 0] = 5.0
    trace = dataclasses.replace(diagnosis.traces[0], measured=spiked)
    charts = residual_charts(dataclasses.replace(diagnosis, traces=(trace,)))
    assert max(charts[0].data[1]["y"]) == pytest.approx(5.0, rel=0.01)
    assert len(charts[0].data[1]["y"]) <= 2 * SAMPLES


def test_the_page_stands_alone_and_begins_with_the_answer(out, answer):
    page = (out / "report.html").read_text()
    assert "<title>Diagnosis: slide</title>" in page
    assert "<h1>The model lacks: cubic hardening at element j (cubic stiffness " in page
    assert (
        page.index("<h1")
        < page.index("The gap")
        < page.index("Cubic hardening (cubic_hardening)")
    )
    for heading in ("The force recovered", "What is left", "Where and when", "Constants"):
        assert f"<h2>{heading}</h2>" in page
    assert 'src="http' not in page
    assert "<td>cubic stiffness = " in page


def test_names_out_of_models_are_shown_and_never_run(tmp_path, answer):
    diagnosis, _ = answer
    evil = dataclasses.replace(
        diagnosis, nominal=dataclasses.replace(diagnosis.nominal, name="<script>alert(1)")
    )
    write_results(tmp_path, evil, document_of(evil))
    assert "<script>alert(1)" not in (tmp_path / "report.html").read_text()


def test_what_is_not_finite_is_written_as_json_can(answer):
    diagnosis, _ = answer
    gap = dataclasses.replace(diagnosis.gap, nominal=math.inf)
    document = document_of(dataclasses.replace(diagnosis, gap=gap, white_p_value=math.nan))
    text = json.dumps(document.plain(), allow_nan=False)
    assert DiagnosisFile.model_validate_json(text) == document


def test_an_experiment_is_said_for_people_and_for_machines(answer):
    diagnosis, _ = answer
    asked = Experiment(
        "Shake more.", level=2.0, band_hz=(1.0, 4.0), excitation="multisine",
        start_s=200.0,
        add_sensors=(Sensor(channel="a_m", quantity="acceleration", node="m", unit="m/s^2"),),
        add_inputs=(Input(channel="f_m", kind="force", node="m", unit="N"),),
    )  # fmt: skip
    place = Place("element", "j")
    document = document_of(
        dataclasses.replace(
            diagnosis, verdict="undecided", experiment=asked,
            undecided=(Rival("coulomb", place, 0.5), Rival("stribeck", place, 0.5)),
        )
    )  # fmt: skip
    assert document.experiment == "Shake more."
    assert document.experiment_request == {
        "level_factor": 2.0,
        "band_hz": [1.0, 4.0],
        "excitation": "multisine",
        "add_sensors": [
            {
                "channel": "a_m", "quantity": "acceleration", "node": "m",
                "frame": "absolute", "unit": "m/s^2",
            }
        ],
        "add_inputs": [{"channel": "f_m", "kind": "force", "unit": "N", "node": "m"}],
        "start_s": 200.0,
    }  # fmt: skip


def test_nothing_is_written_for_what_was_not_held_out(tmp_path, answer):
    diagnosis, document = answer
    (tmp_path / "holdout.npz").write_bytes(b"old")
    tail = dataclasses.replace(diagnosis, gap=dataclasses.replace(diagnosis.gap, on="tail"))
    write_results(tmp_path, tail, document)
    assert not (tmp_path / "holdout.npz").exists()

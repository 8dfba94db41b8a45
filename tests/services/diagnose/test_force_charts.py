"""The chart of a measured force surface, and the figure of the Python interface."""

import dataclasses

import numpy as np
import pytest

import slowtime as st
from slowtime.discrepancy.diagnosis import ForceCut, MeasuredForce
from slowtime.dynamics.effects import Place
from slowtime_api.diagnoses import DiagnosisResult
from slowtime_services.diagnose import document_of, write_results
from slowtime_services.diagnose.force_charts import OUTSIDE, force_charts
from tests.services.diagnose.slide import told


def cut(most, law=None):
    at = np.linspace(-1.4 * most, 1.4 * most, 29)
    sd = 0.1 + np.maximum(np.abs(at) / most - 1, 0)
    return ForceCut(at=at, held=0.0, force=np.sin(at / most), sd=sd, law=law)


def surface(**changed):
    rng = np.random.default_rng(1)
    e, v = 2e-3 * rng.uniform(-1, 1, 50), 0.1 * rng.uniform(-1, 1, 50)
    grid = np.linspace(-1, 1, 5)
    shown = MeasuredForce(
        place=Place("element", "j"), over_e=cut(2e-3, law=np.full(29, 0.5)), over_v=cut(0.1),
        low=-2e-3, high=2e-3, most=0.1, e=e, v=v, grid_e=2e-3 * grid, grid_v=0.1 * grid,
        grid_force=np.where(np.eye(5) > 0, 1.0, np.nan), shape="odd", remembers=False,
        law="Play (gap)", share=0.8, limits="0.001 m",
    )  # fmt: skip
    return dataclasses.replace(shown, **changed)


def test_the_measured_range_is_shaded_and_what_lies_beyond_is_called_so():
    chart, _ = force_charts(surface(), "m")
    spans = {one["xref"]: (one["x0"], one["x1"]) for one in chart.layout["shapes"]}
    assert spans == {"x": (-2e-3, 2e-3), "x2": (-0.1, 0.1)}
    told = [(one["xref"], one["x"]) for one in chart.layout["annotations"]]
    assert {one["text"] for one in chart.layout["annotations"]} == {OUTSIDE}
    assert told == [("x", -2e-3), ("x", 2e-3), ("x2", -0.1), ("x2", 0.1)]
    drawn = chart.data[2]["x"]
    assert min(drawn) < -2e-3 < 2e-3 < max(drawn)


def test_the_band_is_of_95_percent_about_the_force():
    chart, _ = force_charts(surface(), "m")
    low, high, force, law = chart.data[:4]
    wide = (np.array(high["y"]) - np.array(low["y"])) / 2
    np.testing.assert_allclose(wide, 1.96 * surface().over_e.sd, rtol=1e-4)
    np.testing.assert_allclose(force["y"], np.sin(np.array(force["x"]) / 2e-3), atol=1e-4)
    assert high["fill"] == "tonexty"
    assert (law["name"], law["line"]["dash"]) == ("Play (gap)", "dash")


def test_the_words_say_shape_law_and_range():
    chart, _ = force_charts(surface(), "m")
    assert "The surface is odd." in chart.words
    assert (
        "Dashed: Play (gap), the law that it most resembles (80 % of its force" in chart.words
    )
    assert "not above 0.001 m" in chart.words
    alone, _ = force_charts(surface(law="", shape="", over_e=cut(2e-3)), "m")
    assert "No law of the catalogue resembles it." in alone.words
    past, _ = force_charts(surface(over_e=cut(2e-3), remembers=True), "m")
    assert "Not drawn, as it depends on past motion: Play (gap)" in past.words
    assert "The part of the force that depends on past motion is left out here." in past.words


def test_the_map_is_empty_where_no_record_comes():
    _, chart = force_charts(surface(), "rad")
    force, samples = chart.data
    assert [[z is None for z in row] for row in force["z"]] == (np.eye(5) == 0).tolist()
    assert len(samples["x"]) == 50
    assert "N m" in force["colorbar"]["title"]["text"]


def test_a_report_and_a_file_hold_the_surface(tmp_path):
    diagnosis = dataclasses.replace(told(), measured_force=surface())
    write_results(tmp_path, diagnosis, document_of(diagnosis))
    page = (tmp_path / "report.html").read_text()
    assert "The measured force surface" in page
    assert OUTSIDE in page
    with np.load(tmp_path / "measured_force.npz") as kept:
        np.testing.assert_array_equal(kept["over_e"][:, 2], surface().over_e.sd)
        assert kept["range"].tolist() == [-2e-3, 2e-3, 0.1]
    write_results(tmp_path, told(), document_of(told()))
    assert not (tmp_path / "measured_force.npz").exists()
    assert "The measured force surface" not in (tmp_path / "report.html").read_text()


def test_the_python_interface_draws_it(tmp_path):
    pytest.importorskip("matplotlib").use("Agg")
    diagnosis = dataclasses.replace(told(), measured_force=surface())
    figure = DiagnosisResult(diagnosis, document_of(diagnosis)).plot_force(tmp_path / "f.png")
    assert (tmp_path / "f.png").stat().st_size > 10_000
    over_e, over_v, plane = figure.axes[:3]
    lines = {line.get_label(): line.get_xydata() for line in over_e.lines}
    np.testing.assert_allclose(lines["measured force surface"][:, 1], surface().over_e.force)
    assert any("Play (gap)" in label for label in lines)
    assert {text.get_text() for text in (*over_e.texts, *over_v.texts)} == {OUTSIDE}
    assert over_e.get_xlim()[1] > 2e-3
    assert plane.get_xlabel() == "elongation [m]"


def test_the_python_interface_says_where_there_is_no_surface():
    found = DiagnosisResult(told(), document_of(told()))
    with pytest.raises(ValueError, match="adopted no force surface"):
        found.plot_force()


def test_the_python_interface_refuses_a_shape_that_there_is_not(tmp_path):
    model = st.Model(told().nominal)
    with pytest.raises(ValueError, match="No shape of a surface is called 'round'"):
        st.diagnose(model, [], surface="round")

"""`identify --select`: a person's choice of modes, reproducible and stated."""

import json
from pathlib import Path

import numpy as np
import pytest

from slowtime_services.modal import ENDING, SelectionFileError, read_selection
from slowtime_services.reports.page import charts_in
from tests.slowtime.identification.modal_fit.structures import frame, response_to

RATE = 32.0


@pytest.fixture
def three_storeys():
    rng = np.random.default_rng(5)
    y = response_to(frame(3), rng.standard_normal((round(100 * RATE), 2)), RATE)
    y += 0.02 * y.std() * rng.standard_normal(y.shape)
    np.savetxt("frame.csv", y, delimiter=",", header="a1,a2,a3", comments="")
    return "frame.csv"


def test_the_file_beside_a_report_can_be_edited_and_gives_the_same_bytes(run, three_storeys):
    flags = ("--rate-hz", RATE)
    first = run("identify", three_storeys, *flags, "--report", "r.html", "--out", "auto.json")
    assert first.status == 0
    written = Path("r" + ENDING).read_text()
    modes = json.loads(Path("auto.json").read_text())["modes"]
    assert all(f"{mode['frequency_hz']['value']:.5g}" in written for mode in modes)
    again = run("identify", three_storeys, *flags, "--select", "r" + ENDING, "--out", "b.json")
    assert again.status == 0
    assert json.loads(Path("b.json").read_text())["modes"] == modes
    drop = f"edits:\n- drop: {modes[1]['frequency_hz']['value']:.4g}\n"
    Path("mine.yaml").write_text(written.replace("edits:\n", drop))
    for name in ("one", "two"):
        files = ("--report", f"{name}.html", "--out", f"{name}.json")
        done = run("identify", three_storeys, *flags, "--select", "mine.yaml", *files)
        assert "note: Modes chosen by hand, from the automatic choice: drop" in done.err
    for ending in (".html", ".json", ENDING):
        assert Path(f"one{ending}").read_bytes() == Path(f"two{ending}").read_bytes()
    chosen = json.loads(Path("one.json").read_text())
    assert chosen["modes"] == [modes[0], modes[2]]
    assert chosen["assumptions"][-1].startswith("Modes chosen by hand")
    assert "Modes chosen by hand" in Path("one.html").read_text()
    assert "- drop: " in Path("one" + ENDING).read_text()


def test_the_diagram_lies_over_the_spectrum_and_shapes_have_a_mac_matrix(run, three_storeys):
    run("identify", three_storeys, "--rate-hz", RATE, "--report", "r.html")
    charts = list(charts_in(Path("r.html").read_text()))
    (diagram,) = [chart for heading, chart in charts if heading == "Stabilisation"]
    assert [trace["name"] for trace in diagram.data] == [
        "singular value 1", "other pole", "mode",
    ]  # fmt: skip
    assert diagram.data[0]["yaxis"] == "y2"
    assert diagram.layout["yaxis2"]["overlaying"] == "y"
    matrix = charts[-1][1].data[0]["z"]
    assert np.diag(matrix) == pytest.approx(np.ones(3))
    assert np.array(matrix)[0, 1] < 0.2


@pytest.mark.browser
def test_poles_clicked_in_the_report_are_the_file_of_the_choice(run, three_storeys, browser):
    flags = ("--rate-hz", RATE)
    run("identify", three_storeys, *flags, "--report", "r.html", "--out", "auto.json")
    modes = json.loads(Path("auto.json").read_text())["modes"]
    page = browser.new_page()
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(Path("r.html").resolve().as_uri())
    choice = page.locator(".choice")
    choice.locator(".main-svg").first.wait_for(timeout=300_000)
    save = choice.get_by_role("button", name="Save the choice of modes")
    assert save.is_disabled()

    # A pole of the second mode, by the pointer; taken back, and clicked again.
    at = modes[1]["frequency_hz"]["value"]
    spot = choice.locator(".chart").evaluate(
        """(chart, hz) => {
          chart.scrollIntoView({ block: 'center' });
          const trace = chart.data.findIndex(({ name }) => name === 'mode');
          const far = chart.data[trace].x.map((x) => Math.abs(x - hz));
          const one = far.indexOf(Math.min(...far)), box = chart.getBoundingClientRect();
          const { xaxis, yaxis, _size } = chart._fullLayout;
          return [box.x + _size.l + xaxis.d2p(chart.data[trace].x[one]),
                  box.y + _size.t + yaxis.d2p(chart.data[trace].y[one])];
        }""",
        at,
    )
    told = choice.get_by_role("status")
    for said in ("Chosen: drop", "Taken back: drop", "Chosen: drop"):
        page.mouse.move(spot[0] - 40, spot[1])
        page.mouse.move(*spot, steps=4)
        page.wait_for_timeout(500)  # a click means what the pointer has rested on
        page.mouse.click(*spot)
        told.filter(has_text=said).wait_for()

    # Another, by keys; what is no frequency is refused.
    field = choice.get_by_label("Frequency [Hz]")
    choice.get_by_role("button", name="Drop", exact=True).press("Enter")
    told.filter(has_text="Give a frequency above 0 Hz").wait_for()
    field.fill(f"{modes[2]['frequency_hz']['value']:.3f}")
    choice.get_by_role("button", name="Drop", exact=True).press("Enter")
    assert choice.locator("ol > li").count() == 2
    with page.expect_download() as saved:
        save.press("Enter")
    assert saved.value.suggested_filename == "r" + ENDING
    saved.value.save_as("mine.yaml")
    assert complaints == []
    page.close()

    done = run("identify", three_storeys, *flags, "--select", "mine.yaml", "--out", "b.json")
    assert done.status == 0
    assert json.loads(Path("b.json").read_text())["modes"] == [modes[0]]


def test_frequency_responses_are_chosen_from_alike(run):
    hz = np.linspace(0.5, 15, 600)
    h = frame(3).acceleration(2j * np.pi * hz)[:, :, 0]
    noise = np.random.default_rng(1).standard_normal((2, *h.shape))
    h += 0.01 * np.abs(h).mean() * (noise[0] + 1j * noise[1])
    columns = np.column_stack([hz, *(part for one in h.T for part in (one.real, one.imag))])
    names = ",".join(f"a{k} {part}" for k in (1, 2, 3) for part in ("re", "im"))
    np.savetxt("h.csv", columns, delimiter=",", header=f"frequency Hz,{names}", comments="")
    Path("s.yaml").write_text("slowtime_selection: 1\nautomatic: true\nedits:\n- drop: 2.0\n")
    refused = run("identify", "h.csv", "--select", "s.yaml")
    assert "drop 2 Hz: there is no mode within 1 % of 2 Hz. Modes [Hz]:" in refused.err
    there = run("identify", "h.csv", "--out", "-").json["modes"]
    drop = there[0]["frequency_hz"]["value"]
    Path("s.yaml").write_text(f"slowtime_selection: 1\nedits:\n- drop: {drop:.4g}\n")
    chosen = run("identify", "h.csv", "--select", "s.yaml", "--report", "r.html", "--out", "-")
    assert chosen.json["modes"] == there[1:]
    assert read_selection(Path("r" + ENDING)).edits[0].action == "drop"


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ("- drop: 2\n  keep: 3", "line 3: .*Give one of `keep`, `drop`, `merge` and `split`"),
        ("- split: 2", "line 3: .*together with `into: "),
        ("- drop: 2\n  order: 3", "line 3: .*`order` goes with `keep` and `split`"),
        ("- merge: [2]", "line 3: .*at least 2 items"),
        ("- lose: 2", "line 3: unknown key `lose`"),
        ("- keep: -2", "line 3: .*greater than 0"),
    ],
)
def test_files_that_say_nothing_are_refused_by_line(tmp_path, edit, said):
    path = tmp_path / "s.yaml"
    path.write_text(f"slowtime_selection: 1\nedits:\n{edit}\n")
    with pytest.raises(SelectionFileError, match=said):
        read_selection(path)


def test_options_that_have_no_poles_refuse_a_choice(run, three_storeys):
    Path("s.yaml").write_text("slowtime_selection: 1\n")
    for flags in (("--method", "efdd"), ("--window-s", 10), ("--stream",)):
        done = run("identify", three_storeys, "--rate-hz", RATE, "--select", "s.yaml", *flags)
        assert done.status == 2
        assert "--select" in done.err

"""Measured frequency responses out of files of other programs, and of slowtime."""

import json
from pathlib import Path

import numpy as np
import pytest

from slowtime.identification.frequency_response.response import FrequencyResponse, Kind
from slowtime.identification.modal_fit.identification import identify_responses
from slowtime_services.exports.frequency_responses import write_responses
from slowtime_services.files.record import RecordError
from slowtime_services.frequency_responses import MeasuredResponses, read_responses

HZ = 1.0 + np.arange(400) / 30.0
POLES = 2 * np.pi * np.array([3.2, 6.9, 11.4]) * (-0.01 + 1j)
SHAPES = np.array([[0.4, 1.0, -0.8], [0.8, 0.3, 1.0], [1.0, -0.9, -0.5]])


def read(path: Path, kind: Kind | None = None) -> MeasuredResponses:
    found = read_responses(path, kind)
    assert found is not None
    return found


def responses(inputs: int = 2) -> np.ndarray:
    """Acceleration per force of three modes, with a little noise."""
    s = 2j * np.pi * HZ[:, None, None]
    found = np.zeros((len(HZ), 3, inputs), dtype=complex)
    for pole, shape in zip(POLES, SHAPES.T, strict=True):
        found += s**2 * np.outer(shape, shape[:inputs]) / ((s - pole) * (s - pole.conj()))
    noise = np.random.default_rng(4).standard_normal((2, *found.shape))
    return np.asarray(found + 0.01 * (noise[0] + 1j * noise[1]))


def measured(values: np.ndarray) -> FrequencyResponse:
    lines, outputs, _ = values.shape
    return FrequencyResponse(
        frequency_hz=HZ, response=values, sd=np.full(values.shape, 0.014),
        coherence=np.linspace(0.5, 1.0, lines)[:, None] * np.ones(outputs), averages=7,
        kind="acceleration", decay_rate=0.25,
    )  # fmt: skip


OUTPUTS = (("a1", "m/s^2"), ("a2", "m/s^2"), ("a3", "m/s^2"))
INPUTS = (("f1", "N"), ("f2", "N"))


def test_what_is_written_is_read_back_in_all_digits(tmp_path):
    given = measured(responses())
    write_responses(tmp_path / "h.uff", given, OUTPUTS, INPUTS)
    found = read(tmp_path / "h.uff")
    np.testing.assert_allclose(found.response.response, given.response, rtol=1e-9)
    np.testing.assert_allclose(found.response.frequency_hz, HZ, rtol=1e-12)
    np.testing.assert_allclose(found.response.coherence, given.coherence, rtol=1e-9)
    assert (found.outputs, found.inputs) == (OUTPUTS, INPUTS)
    assert (found.response.kind, found.response.averages) == ("acceleration", 7)
    assert found.response.decay_rate == 0.25


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of pyuff
@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("binary", [0, 1])
def test_universal_files_of_pyuff_are_read(tmp_path, double, even, binary):
    pyuff = pytest.importorskip("pyuff")
    values, hz = responses(1), HZ.copy()
    if not even:
        hz[200:] += 0.5
    file = pyuff.UFF(str(tmp_path / "h.uff"))
    for o in range(3):
        file.write_sets(
            pyuff.prepare_58(
                binary=binary, func_type=4, rsp_node=o + 1, rsp_dir=3, ref_node=1, ref_dir=-3,
                data=values[:, o, 0], x=hz, id1="", id2="", ord_data_type=6 if double else 5,
                abscissa_spacing=int(even), abscissa_min=hz[0], abscissa_inc=hz[1] - hz[0],
                num_pts=len(hz), ordinate_spec_data_type=12, ordinate_axis_units_lab="m/s^2",
                orddenom_spec_data_type=13, orddenom_axis_units_lab="N",
            ),
            "add",
        )  # fmt: skip
    found = read(tmp_path / "h.uff")
    tolerance = 1e-9 if double else 1e-5
    np.testing.assert_allclose(found.response.response, values, rtol=tolerance)
    np.testing.assert_allclose(found.response.frequency_hz, hz, rtol=2e-5)
    assert [name for name, _ in found.outputs] == ["node 1 +Z", "node 2 +Z", "node 3 +Z"]
    assert found.inputs == (("node 1 -Z", "N"),)
    assert found.response.kind == "acceleration"


def table(path, head, columns, delimiter=";"):
    lines = [head] * bool(head)
    for row in zip(*columns, strict=True):
        lines.append(
            delimiter.join(one if isinstance(one, str) else f"{one:.17g}" for one in row)
        )
    path.write_text("\n".join(lines) + "\n")


def cells(values, unit="j"):
    return [f"{v.real:.17g}{v.imag:+.17g}{unit}" for v in values]


@pytest.mark.parametrize("unit", ["j", "i"])
def test_complex_cells_without_a_heading_are_read(tmp_path, unit):
    values = responses(1)
    columns = [cells(HZ + 0j, unit), *(cells(values[:, o, 0], unit) for o in range(3))]
    table(tmp_path / "h.csv", "", columns)
    found = read(tmp_path / "h.csv")
    np.testing.assert_allclose(found.response.response, values, rtol=1e-12)
    np.testing.assert_allclose(found.response.frequency_hz, HZ, rtol=1e-12)
    assert any("accelerations per force" in note for note in found.notes)


@pytest.mark.parametrize(
    ("names", "parts"),
    [
        (("re", "im"), lambda h: (h.real, h.imag)),
        (("Real", "Imaginary"), lambda h: (h.real, h.imag)),
        (("mag", "phase (deg)"), lambda h: (np.abs(h), np.degrees(np.angle(h)))),
        (("mag [dB]", "phase [deg]"), lambda h: (
            20 * np.log10(np.abs(h)), np.degrees(np.angle(h)))),
        (("amplitude", "phase [rad]"), lambda h: (np.abs(h), np.angle(h))),
    ],
)  # fmt: skip
@pytest.mark.parametrize("delimiter", [",", "\t"])
def test_two_columns_of_parts_are_one_response(tmp_path, names, parts, delimiter):
    values = responses(1)
    heads, columns = ["Frequency (Hz)"], [HZ]
    for o in range(3):
        heads += [f"a{o} {name}" for name in names]
        columns += parts(values[:, o, 0])
    table(tmp_path / "h.txt", delimiter.join(heads), columns, delimiter)
    found = read(tmp_path / "h.txt")
    np.testing.assert_allclose(found.response.response, values, rtol=1e-9)
    assert [name for name, _ in found.outputs] == ["a0", "a1", "a2"]


def test_columns_that_may_be_parts_or_phases_are_a_question(tmp_path):
    values = responses(1)[:, 0, 0]
    table(tmp_path / "h.txt", "", [HZ, np.abs(values), np.degrees(np.angle(values))], "\t")
    assert read_responses(tmp_path / "h.txt") is None  # three channels in time, for all it says
    with pytest.raises(RecordError, match="magnitude and phase"):
        read_responses(tmp_path / "h.txt", "acceleration")


def test_arrays_are_read_whatever_their_order_and_names(tmp_path):
    values = responses()
    np.savez(tmp_path / "h.npz", frequency_hz=HZ, H=values.transpose(1, 2, 0))
    np.savez(tmp_path / "parts.npz", freq=HZ, H_re=values.real, H_im=values.imag)
    for name in ("h.npz", "parts.npz"):
        found = read(tmp_path / name)
        np.testing.assert_array_equal(found.response.response, values)
    np.savez(tmp_path / "x.npz", t=HZ, x=values[:, 0, 0].real)
    assert read_responses(tmp_path / "x.npz") is None


def test_hdf5_and_matlab_files_are_read(tmp_path):
    h5py, scipy_io = pytest.importorskip("h5py"), pytest.importorskip("scipy.io")
    values = responses()
    with h5py.File(tmp_path / "h.h5", "w") as file:
        file["test/frequency_hz"], file["test/H"] = HZ, values
        file["test/outputs"] = ["a [m/s]", "b [m/s]", "c [m/s]"]
    found = read(tmp_path / "h.h5")
    np.testing.assert_array_equal(found.response.response, values)
    assert (found.outputs[1], found.response.kind) == (("b", "m/s"), "velocity")
    scipy_io.savemat(tmp_path / "h.mat", {"f": HZ, "H": values})
    found = read(tmp_path / "h.mat")
    np.testing.assert_array_equal(found.response.response, values)


def test_a_workbook_is_read(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    values = responses(1)
    book = openpyxl.Workbook()
    book.active.append(["Hz", "top re", "top im"])
    for hz, one in zip(HZ, values[:, 2, 0], strict=True):
        book.active.append([hz, one.real, one.imag])
    book.save(tmp_path / "h.xlsx")
    found = read(tmp_path / "h.xlsx")
    np.testing.assert_allclose(found.response.response[:, 0, 0], values[:, 2, 0], rtol=1e-12)


def test_a_roving_hammer_gives_shapes_over_its_points(tmp_path):
    values = responses(1)
    columns = [HZ, *(c for o in range(3) for c in (values[:, o, 0].real, values[:, o, 0].imag))]
    heads = ["freq", *(f"{part} a/f{o}" for o in range(3) for part in ("re", "im"))]
    table(tmp_path / "h.csv", ",".join(heads), columns, ",")
    found = read(tmp_path / "h.csv")
    assert [name for name, _ in found.outputs] == ["f0", "f1", "f2"]
    np.testing.assert_allclose(found.response.response, values, rtol=1e-12)
    modes = identify_responses(found.response).result.modes
    for mode, pole, shape in zip(modes, POLES, SHAPES.T, strict=True):
        assert abs(mode.frequency_hz.value - abs(pole) / (2 * np.pi)) < 4 * mode.frequency_hz.sd
        like = np.abs(np.vdot(mode.shape, shape)) / np.linalg.norm(mode.shape)
        assert like == pytest.approx(np.linalg.norm(shape), rel=1e-3)


def test_damaged_files_and_others_are_refused_or_left_alone(tmp_path):
    given = measured(responses())
    write_responses(tmp_path / "h.uff", given, OUTPUTS, INPUTS)
    text = (tmp_path / "h.uff").read_text().splitlines()
    (tmp_path / "cut.uff").write_text("\n".join(text[:40] + text[-1:]) + "\n")
    with pytest.raises(RecordError, match="cut short"):
        read_responses(tmp_path / "cut.uff")
    (tmp_path / "x.json").write_text(json.dumps({"slowtime_modes": 1}))
    assert read_responses(tmp_path / "x.json") is None
    (tmp_path / "t.csv").write_text("".join(f"{k / 100},{k % 7}\n" for k in range(100)))
    assert read_responses(tmp_path / "t.csv") is None
    with pytest.raises(RecordError):
        read_responses(tmp_path / "t.csv", "acceleration")

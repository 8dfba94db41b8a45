"""Auto- and cross-spectra of universal files, of blows simulated by SciPy, written by pyuff."""

import numpy as np
import pytest
import scipy.signal

from slowtime.identification.modal_fit.identification import identify_responses
from slowtime_services.files.record import RecordError
from slowtime_services.frequency_responses import read_responses
from slowtime_services.frequency_responses.measured import FrfCurve
from slowtime_services.frequency_responses.spectra import PowerSpectrum, curves_of_spectra

RATE, COUNT = 256.0, 4096
TRUE_HZ = np.array([6.0, 21.0, 47.0])
SHAPES = np.array([[0.4, 1.0, -0.8], [0.8, 0.3, 1.0], [1.0, -0.9, -0.5]])

pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


def blows(seed=0, averages=12):
    """Force and accelerations at three points, blow by blow."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * TRUE_HZ
    below = np.hstack([-np.diag(omega**2), -np.diag(0.02 * omega)])
    a = np.vstack([np.hstack([np.zeros((3, 3)), np.eye(3)]), below])
    b = np.concatenate([np.zeros(3), SHAPES[2]])[:, None]
    system = (a, b, SHAPES @ below, (SHAPES @ SHAPES[2])[:, None])
    fine = np.arange(8 * COUNT) / (8 * RATE)
    pulse = np.where(fine < 0.01, np.sin(np.pi * fine / 0.01), 0.0)
    _, y, _ = scipy.signal.lsim(system, pulse, fine)
    both = scipy.signal.decimate(np.column_stack([pulse, y]), 8, ftype="fir", axis=0)
    for size in rng.uniform(50, 90, averages):
        noise = 0.01 * both.std(axis=0) * rng.standard_normal(both.shape)
        yield size * (both + noise)


def spectra(seed=0):
    transforms = np.fft.rfft(list(blows(seed)), axis=1)[:, :1200]
    cross = np.einsum("blo,bl->lo", transforms, transforms[:, :, 0].conj()) / len(transforms)
    autos = np.mean(np.abs(transforms) ** 2, axis=0)
    return np.arange(1200) * RATE / COUNT, autos, cross


def write(path, functions):
    """Functions are (type, response node, its code, reference node, its code, values)."""
    pyuff = pytest.importorskip("pyuff")
    hz = np.arange(1200) * RATE / COUNT
    file = pyuff.UFF(str(path))
    for kind, node, code, reference, of_reference, values in functions:
        file.write_sets(
            pyuff.prepare_58(
                binary=0, func_type=kind, rsp_node=node, rsp_dir=3, ref_node=reference,
                ref_dir=3, data=values, x=hz, id1="", id2="", abscissa_spacing=1,
                ord_data_type=6 if np.iscomplexobj(values) else 4, abscissa_min=hz[0],
                abscissa_inc=hz[1], num_pts=len(hz), ordinate_spec_data_type=code,
                ordinate_axis_units_lab="NONE", orddenom_spec_data_type=of_reference,
                orddenom_axis_units_lab="NONE",
            ),
            "add",
        )  # fmt: skip
    return path


@pytest.mark.parametrize("conjugated", [False, True])
def test_cross_spectra_over_that_of_the_force_are_frequency_responses(tmp_path, conjugated):
    """The driving point's force and motion have one node and direction."""
    _, autos, cross = spectra()
    cross = cross.conj() if conjugated else cross
    functions = [(2, 3, 13, 3, 13, autos[:, 0])]
    functions += [(2, o + 1, 12, o + 1, 12, autos[:, o + 1]) for o in range(3)]
    functions += [(3, o + 1, 12, 3, 13, cross[:, o + 1]) for o in range(3)]
    found = read_responses(write(tmp_path / "s.uff", functions))
    assert found is not None
    assert found.response.response.shape == (1199, 3, 1)
    assert "H1" in found.notes[0]
    assert ("turned" in found.notes[0]) is conjugated
    coherence = found.response.coherence
    assert 0.9 < np.median(coherence) < 1.0
    modes = identify_responses(found.response, band_hz=(2.0, 60.0)).result.modes
    assert len(modes) == 3
    for mode, hz in zip(modes, TRUE_HZ, strict=True):
        assert abs(mode.frequency_hz.value - hz) < 4 * mode.frequency_hz.sd + 2e-4 * hz
        assert abs(mode.damping_ratio.value - 0.01) < 4 * mode.damping_ratio.sd + 1e-4


def test_auto_spectra_alone_are_refused_with_what_to_export(tmp_path):
    _, autos, _ = spectra()
    path = write(tmp_path / "a.uff", [(2, 1, 12, 1, 12, autos[:, 1])])
    with pytest.raises(RecordError, match=r"auto-spectra alone\. .*no phases.*Export time"):
        read_responses(path)


def test_spectra_of_responses_alone_are_refused_with_the_reason(tmp_path):
    _, autos, cross = spectra()
    functions = [(9, 1, 12, 1, 12, autos[:, 1]), (3, 2, 12, 1, 12, cross[:, 2])]
    path = write(tmp_path / "o.uff", functions)
    with pytest.raises(RecordError, match=r"references: node 1 \+Z.*errors are not known"):
        read_responses(path)


def test_frequency_responses_go_before_spectra(tmp_path):
    _, autos, cross = spectra()
    functions = [(2, 3, 13, 3, 13, autos[:, 0]), (4, 1, 12, 3, 13, cross[:, 1] / autos[:, 0])]
    found = read_responses(write(tmp_path / "h.uff", functions))
    assert found is not None
    assert found.notes == ("1 datasets that are no frequency responses were left out.",)


def test_two_forces_at_once_are_refused():
    hz, autos, cross = spectra()

    def spectrum(output, driven, values, unit, is_force):
        curve = FrfCurve(
            output=(output, unit), input=(driven, ""), frequency_hz=hz, values=values + 0j
        )
        return PowerSpectrum(curve=curve, is_force=is_force)

    forces = [spectrum(name, name, autos[:, 0], "N^2", False) for name in "fg"]
    crosses = [spectrum("a", name, cross[:, 1], "", False) for name in "fg"]
    with pytest.raises(RecordError, match="several forces"):
        curves_of_spectra("s.uff", forces, crosses)

"""Wrong arguments of ``import slowtime`` are named, with what is allowed."""

import importlib
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

# Without its types, which forbid what is tried here.
st: Any = importlib.import_module("slowtime")
pd, xr = pytest.importorskip("pandas"), pytest.importorskip("xarray")
RATE = 50.0
TIMES = np.arange(1_500) / RATE
DECAY = np.exp(-0.1 * TIMES) * np.sin(2 * np.pi * 3.0 * TIMES)
GAP = np.ma.masked_array(DECAY, TIMES < 0.1)


@pytest.fixture(scope="module")
def signals():
    """A free decay."""
    return st.Signals(DECAY, RATE, channels=["a"], units="m/s^2")


@pytest.fixture(scope="module")
def chain():
    """Two masses."""
    return st.Model.chain([1.0, 1.0], [400.0, 400.0], rayleigh=(0.1, 1e-4))


@pytest.mark.parametrize(
    "samples",
    [
        DECAY.tolist(), DECAY.astype(np.float32), pd.Series(DECAY), xr.DataArray(DECAY),
        np.asfortranarray(DECAY[:, None]), DECAY.astype(object),
    ],
)  # fmt: skip
def test_whatever_is_like_an_array_of_numbers_becomes_signals(samples):
    found = st.Signals(samples, np.float32(RATE))
    np.testing.assert_allclose(found.samples[:, 0], DECAY, rtol=1e-6)
    assert found.channels == ("ch0",)


def test_columns_of_pandas_keep_their_names():
    assert st.Signals(pd.DataFrame({"x": DECAY, 7: DECAY}), RATE).channels == ("x", "7")
    assert st.Signals(pd.Series(DECAY, name="acc"), RATE).channels == ("acc",)


def test_samples_that_are_read_only_are_neither_changed_nor_refused(signals):
    locked = DECAY.copy()
    locked.flags.writeable = False
    modes = st.identify(st.Signals(locked, RATE, units="m/s^2"))
    np.testing.assert_array_equal(modes.frequencies_hz, st.identify(signals).frequencies_hz)


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (DECAY + 1j, "complex128. Give real numbers"),
        (["a", "b"], "Give real numbers"),
        ([[1, 2], [3]], "no array of numbers.*inhomogeneous.*[^.]. Give real numbers"),
        (np.array(["2020-01-01"], dtype="M8[s]"), "datetime64.*Give real numbers"),
        (pd.DataFrame({"a": ["x", "y"]}), "type DataFrame, are no array of numbers"),
        (xr.Dataset({"a": ("t", DECAY)}), "type Dataset, are no array"),
        (GAP, "5 samples are not finite"),
        (np.zeros((5, 0)), "one column per channel"),
        ([], "at least two rows"),
    ],
)  # fmt: skip
def test_samples_that_are_no_real_numbers_are_refused(samples, message):
    with pytest.raises(ValueError, match=message):
        st.Signals(samples, RATE)


@pytest.mark.parametrize("rate", ["50", None, [50.0], 50 + 0j])
def test_a_rate_that_is_no_number_is_named(rate):
    with pytest.raises(TypeError, match=r"rate_hz=.* was given. Give one number"):
        st.Signals(DECAY, rate)


@pytest.mark.parametrize(
    ("use", "error", "message"),
    [
        (lambda s: s[0:5:2], ValueError, r"step 2 was given. Give two times in seconds"),
        (lambda s: s["a":"b"], TypeError, "first_s='a' was given"),
        (lambda s: s[29.99:], ValueError, "fewer than two samples"),
        (lambda s: s[0:5, "b"], KeyError, "has no|no channel|b"),
        (lambda s: s[[]], KeyError, "No channel was named. There are: a"),
        (lambda s: s[[1.5]], TypeError, "Give a text, or a list of texts"),
        (lambda s: list(s), TypeError, "not iterable"),
        (lambda s: s.between("a", 5), TypeError, "first_s='a' was given"),
        (lambda s: s.between(5, 1), ValueError, "The span from 5 to 1 s was given"),
        (lambda s: s.between(29.99, 30), ValueError, "fewer than two samples"),
        (lambda s: s.psd(np.nan), ValueError, "segment_s=nan was given. Give a finite number"),
        (lambda s: s.psd(0.01), ValueError, "A segment of 0.01 s was given. Give between"),
        (lambda s: s.psd("a"), TypeError, "segment_s='a' was given"),
        (lambda s: s.between(0, 0.1).psd(), ValueError, "A density needs 8"),
        (lambda s: s.plot("."), IsADirectoryError, "is a folder. Give a file"),
        (lambda s: st.Signals(DECAY, RATE, channels=["time_s"]).to_xarray(), ValueError,
         "as the axis is"),
        (lambda s: st.Signals(DECAY, RATE, units=5), TypeError, "units=5 was given"),
        (lambda s: st.identify(DECAY), TypeError,
         r"signals of type ndarray was given\. Give Signals: .*slowtime\.read"),
        (lambda s: st.identify(s, method="foo"), ValueError, "method='foo'.*Allowed: auto"),
        (lambda s: st.identify(s, band_hz=5), TypeError, "band_hz=5 was given. Give two"),
        (lambda s: st.identify(st.Signals(1e300 * DECAY, RATE)), ValueError,
         "beyond double precision; scale"),
    ],
)  # fmt: skip
def test_wrong_use_of_signals_is_answered_in_a_sentence(signals, use, error, message):
    with pytest.raises(error, match=message):
        use(signals)


def test_channels_are_selected_by_number_too_and_known_by_name(signals):
    assert signals[0].channels == signals[[0]].channels == ("a",)
    assert "a" in signals
    assert "b" not in signals


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({}, ValueError, "Give rate_hz, or name the clock with time_column"),
        ({"rate_hz": "x"}, TypeError, "rate_hz='x' was given"),
        ({"rate_hz": 50, "channels": []}, ValueError, "Name at least one"),
        ({"rate_hz": 50, "channels": 5}, TypeError, "channels=5 was given"),
        ({"rate_hz": 50, "skip_lines": -1}, ValueError, "Give a whole number from 0"),
        ({"rate_hz": 50, "date_order": "ydm"}, ValueError, "Allowed: dmy, mdy, ymd"),
    ],
)
def test_wrong_options_of_reading_name_arguments_not_flags(tmp_path, options, error, message):
    path = tmp_path / "a.csv"
    np.savetxt(path, DECAY, header="x", comments="")
    with pytest.raises(error, match=message) as refused:
        st.read(path, **options)
    assert "--" not in str(refused.value)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    for read in (st.read, st.Model.from_file):
        with pytest.raises(FileNotFoundError, match=r"There is no file .*nothing\.csv"):
            read(tmp_path / "nothing.csv")
        with pytest.raises(IsADirectoryError, match=r"is a folder. Give a file"):
            read(tmp_path)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: st.Model.chain("ab", [1, 1]), TypeError, "masses_kg='ab'"),
        (
            lambda: st.Model.chain([1], [np.nan]),
            ValueError,
            r"stiffnesses_n_per_m\[0\]=nan was given. Give a finite number",
        ),
        (lambda: st.Model.chain([1], [4], rayleigh=5), TypeError, "rayleigh=5.*two numbers"),
        (lambda: st.Model.shear_frame(1, 1), TypeError, "floors_kg=1 was given"),
        (lambda: st.Model.beam(0, 1, 1), ValueError, "length_m=0 was given"),
        (lambda: st.Model.beam(1, 1, 1, elements=2.5), ValueError, "whole number from 2"),
        (
            lambda: st.simulate("a.yaml", rate_hz=5),
            TypeError,
            r"model='a.yaml' was given. Give Model: .*Model.from_file",
        ),
        (
            lambda: st.diagnose(None, "a.csv"),
            TypeError,
            "model=None was given. Give Model or a text",
        ),
        (lambda: st.connect(ca="/nowhere/ca.pem"), FileNotFoundError, "/nowhere/ca.pem"),
    ],
)
def test_wrong_numbers_of_a_model_are_named(make, error, message):
    with pytest.raises(error, match=message):
        make()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"rate_hz": -1}, ValueError, "rate_hz=-1 was given. Give a number above 0"),
        ({"duration_s": "a"}, TypeError, "duration_s='a' was given"),
        ({"duration_s": np.inf}, ValueError, "duration_s=inf was given"),
        ({"duration_s": 0.001}, ValueError, "is 0 sample"),
        ({"seed": 1.5}, ValueError, "seed=1.5 was given. Give a whole number"),
        ({"hold": "foo"}, ValueError, "Allowed: first, zero, band_limited"),
        ({"inputs": {"q": DECAY}}, ValueError, "The model has no inputs; q was given"),
        (
            {"inputs": DECAY},
            TypeError,
            "inputs of type ndarray was given. Give Signals or a mapping",
        ),
    ],
)
def test_wrong_options_of_a_simulation_are_named(chain, options, error, message):
    with pytest.raises(error, match=message):
        st.simulate(chain, **({"rate_hz": 50.0, "duration_s": 10.0, "seed": 1} | options))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"signals": DECAY}, TypeError, "signals of type ndarray was given"),
        ({"signals": [5]}, TypeError, "signals.*5.* was given|signals of type list"),
        ({"signals": []}, ValueError, "No signals were given"),
        ({"channels": ["a"]}, TypeError, r"channels=\['a'\] was given"),
        ({"patience_s": -1}, ValueError, "patience_s=-1 was given"),
        ({"surface": None}, TypeError, "surface=None was given"),
        ({}, ValueError, "Say which it is with channels={'a_m1': 'NAME'}"),
    ],
)
def test_wrong_options_of_a_diagnosis_are_named(chain, signals, options, error, message):
    with pytest.raises(error, match=message):
        st.diagnose(chain, **({"signals": signals} | options))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"nominal_hz": -3}, "nominal_hz=-3 was given. Give a number above 0"),
        ({"nominal_damping": 0.02}, "without nominal_hz"),
        ({"changes": "foo"}, "Allowed: stiffness, mass, both"),
        ({"learn_readings": 0}, "learn_readings=0 was given"),
    ],
)
def test_wrong_options_of_a_twin_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        st.Twin(**options)


def test_wrong_readings_of_a_twin_leave_it_as_it_was():
    twin = st.Twin(nominal_hz=3.0, nominal_damping=0.02)
    twin.update(1.0, 3.0, 0.01)
    before = twin.history()
    for reading, error, message in (
        (("a", 3, 0.01), TypeError, "slow_time='a' was given"),
        ((0.0, 3, 0.01), ValueError, "in ascending order"),
        ((2.0, -3, 0.01), ValueError, "frequency_hz=-3 was given. Give a number from 0"),
        ((2.0, 3, np.nan), ValueError, "frequency_sd=nan was given. Give a finite"),
        ((2.0, 3, 0.01, 0.02), ValueError, "Give both or none"),
    ):
        with pytest.raises(error, match=message):
            twin.update(*reading)
    for options, message in (
        ({"horizon": -1}, "horizon=-1 was given"),
        ({"points": 0}, "points=0 was given"),
        ({"threshold": np.nan}, "threshold=nan was given. Give a finite"),
    ):
        with pytest.raises(ValueError, match=message):
            twin.forecast(**options)
    assert twin.history() == before
    twin.close()
    with pytest.raises(ValueError, match=r"The twin was closed. Make another"):
        twin.history()


def test_text_is_read_and_identified_without_the_libraries_of_recordings(tmp_path):
    path = tmp_path / "a.csv"
    np.savetxt(path, DECAY, header="x", comments="")
    code = f"""
import sys
for name in ("mcap", "numba", "yaml", "plotly", "rich"):
    sys.modules[name] = None
import slowtime as st
print(len(st.identify(st.read({str(path)!r}, rate_hz=50.0))))
open("b.mcap", "wb").close()
try:
    st.read("b.mcap")
except ImportError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    count, message = done.stdout.splitlines()
    assert count == "1"
    assert message.endswith("pip install 'slowtime[analysis]'")


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"near_hz": -1.0}, ValueError, "near_hz=-1.0 was given. Give a number above 0"),
        ({"near_hz": "low"}, TypeError, "near_hz='low' was given. Give one number"),
        ({"band_hz": 3.0}, TypeError, "Give two numbers"),
        ({"band_hz": (20.0, 24.0)}, ValueError, "half-overlapping windows|No motion"),
        ({"start_s": 40.0}, ValueError, "Give seconds from 0 to 30"),
    ],
)
def test_what_a_fit_of_a_decay_does_not_take_is_named(signals, given, error, message):
    with pytest.raises(error, match=message):
        st.fit_decay(signals, **given)


def test_a_fit_of_a_decay_wants_signals_without_gaps():
    with pytest.raises(TypeError, match="Signals"):
        st.fit_decay(DECAY)

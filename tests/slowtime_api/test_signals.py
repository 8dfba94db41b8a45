import numpy as np
import pytest

import slowtime as st

RATE = 100.0


def two_channels(seconds=60.0):
    t = np.arange(int(seconds * RATE)) / RATE
    white = np.random.default_rng(1).standard_normal(len(t))
    return np.stack([np.sin(2 * np.pi * 5 * t), 3.0 * white], axis=1)


def test_the_integral_of_a_density_is_the_variance():
    signals = st.Signals(two_channels(), RATE)
    frequency, density = signals.psd(segment_s=2.0)
    power = np.trapezoid(density, frequency, axis=0)
    np.testing.assert_allclose(power, signals.samples.var(axis=0), rtol=0.05)
    assert frequency[np.argmax(density[:, 0])] == pytest.approx(5.0)


def test_spans_and_channels_are_cut_out_with_their_names_and_units():
    samples = two_channels()
    signals = st.Signals(samples, RATE, ["x", "y"], ["m/s^2", "V"])
    part = signals.between(10.0, 20.0)["y"]
    assert (part.channels, part.units) == (("y",), ("V",))
    np.testing.assert_array_equal(part.samples[:, 0], samples[1000:2000, 1])
    assert part.duration_s == pytest.approx(10.0)


def test_motion_is_converted_to_si():
    signals = st.Signals([1.0, 2.0, 3.0], RATE, units="g")
    assert signals.units == ("m/s^2",)
    np.testing.assert_allclose(signals.samples[:, 0], 9.80665 * np.array([1.0, 2.0, 3.0]))


def test_a_file_is_read_as_pandas_reads_it_with_its_clock(tmp_path):
    pandas = pytest.importorskip("pandas")
    times = pandas.date_range("2024-05-01 12:00:00", periods=500, freq="10ms", tz="UTC")
    table = pandas.DataFrame(two_channels(5.0), columns=["acc_x", "acc_y"])
    table.insert(0, "time", times.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))
    table.to_csv(tmp_path / "record.csv", index=False)
    signals = st.read(tmp_path / "record.csv", units="g")
    assert signals.rate_hz == pytest.approx(RATE)
    assert signals.start == times[0].to_pydatetime()
    frame = signals.to_pandas()
    assert list(frame.columns) == ["acc_x", "acc_y"]
    np.testing.assert_allclose(frame["acc_x"], 9.80665 * table["acc_x"], rtol=1e-9)
    assert abs((frame.index - times).total_seconds()).max() < 1e-6


def test_a_gap_in_the_file_is_a_gap_in_time(tmp_path):
    t = np.delete(np.arange(1000) / RATE, np.s_[300:350])
    text = "\n".join(["t,a", *(f"{x:.2f},{np.sin(x):.6f}" for x in t)])
    (tmp_path / "gap.csv").write_text(text)
    signals = st.read(tmp_path / "gap.csv")
    np.testing.assert_allclose(signals.times_s, t - t[0], atol=1e-9)


def test_xarray_gets_units_and_times():
    pytest.importorskip("xarray")
    data = st.Signals(two_channels(), RATE, ["x", "y"], "m/s^2").to_xarray()
    assert data["x"].attrs["units"] == "m/s^2"
    assert float(data["time_s"][1]) == pytest.approx(1 / RATE)


def test_functions_of_numpy_take_signals_and_values():
    samples = two_channels()
    signals = st.Signals(samples, RATE, units=["m/s^2", "V"])
    np.testing.assert_array_equal(np.asarray(signals), samples)
    assert np.asarray(signals, dtype="f4").dtype == np.dtype("f4")
    assert np.std(signals, axis=0) == pytest.approx(samples.std(axis=0))
    [mode, *_] = st.identify(signals["ch0"], method="fdd")
    assert float(mode.frequency_hz) == mode.frequency_hz.value


def test_more_channels_than_samples_are_asked_about():
    turned = two_channels()[:50].T
    with pytest.raises(ValueError, match=r"Give one row per instant, as in samples\.T"):
        st.Signals(turned, RATE)
    assert len(st.Signals(turned, RATE, wide=True).channels) == 50


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0], RATE), "at least two rows"),
        (([1.0, np.nan, 2.0], RATE), "1 samples are not finite"),
        (([1.0, 2.0], 0.0), "rate_hz=0.0 was given. Give a number above 0"),
        ((np.zeros((9, 2)), RATE, ["x"]), "1 channels were given for 2 columns"),
        ((np.zeros((9, 2)), RATE, ["x", "x"]), "repeat"),
        ((np.zeros((9, 2)), RATE, None, ["V", "furlong"]), "The unit 'furlong' is not known"),
    ],
)
def test_impossible_arrays_are_refused_with_what_to_do(arguments, message):
    with pytest.raises(ValueError, match=message):
        st.Signals(*arguments)


def test_an_unknown_channel_is_named_with_those_there_are():
    with pytest.raises(KeyError, match="'x', 'y'"):
        _ = st.Signals(np.zeros((9, 2)), RATE, ["x", "y"])["z"]


def test_a_plot_is_written(tmp_path):
    st.Signals(two_channels(), RATE, ["x", "y"]).plot(tmp_path / "signals.png")
    assert (tmp_path / "signals.png").read_bytes().startswith(b"\x89PNG")

"""Rates of headings: stated once per channel, in words, or of something else than samples."""

import numpy as np
import pytest

from slowtime_services.files import RecordError, read_record
from slowtime_services.files.headings.sampling import find_facts

ROWS = 900
X, Y = np.random.default_rng(8).normal(size=(2, ROWS)).round(3)
OTHER = (
    "Loading rate: 5 Hz", "Shaft rate: 24.5 Hz", "Rotation rate [Hz]: 30", "FS: 16", "SR: 830",
    "Screen refresh rate: 60 Hz", "Update rate 1 Hz", "Clock rate: 1 kHz", "Model: SR 830",
    "Data rate: 115200 bps", "Data rate: 57600", "File interval: 10 min", "Device: DT 9837",
    "Upload interval: 1 h", "Time resolution: 1 ms", "Frequency: 5 Hz",
    "Total sampling rate: 900 Hz",
)  # fmt: skip
"""Lines of headings that do not state the sampling rate."""
CONTRADICTING = (
    "Logging interval: 10 min",
    "Measurement points: 4",
    "Anzahl Messpunkte: 4",
    "Sample number: 17",
    "Test duration: 2 days",
)
"""Lines that must not be held against the rows where something better states the rate."""


@pytest.fixture
def read(tmp_path):
    def reading(heading, delimiter=",", clock=False):
        mark, path = delimiter, tmp_path / "file.csv"
        names = [*(["Time"] * clock), "ax", "ay"]
        rows = [
            mark.join([*([f"{i / 50:.2f}"] * clock), f"{X[i]:.3f}", f"{Y[i]:.3f}"])
            for i in range(ROWS)
        ]
        path.write_text("\n".join([heading, mark.join(names), *rows]) + "\n")
        return read_record(path)

    return reading


@pytest.mark.parametrize("mark", [",", ";", "\t", "|"])
@pytest.mark.parametrize(
    ("line", "rate"),
    [
        ("Sample rate;300;300", 300), ("Sampling rate (Hz);1000;1000;", 1000),
        ("Fs [Hz];2048;2048", 2048), ("Delta t [ms];4;4", 250), ("dt;0.02;0.02", 50),
        ("Sample rate;128 Hz;128 Hz", 128), ("Sample rate;kHz;0.4;0.4", 400),
        ("Sample rate;0.4;kHz", 400), ("Sampling rate;300;Range;2", 300),
        ("Number of samples;900;900\nSample rate;300", 300),
        ("Sample rate;100;100;100;100", 100), ("Sampling rate;300;Filter;20", 300),
    ],
)  # fmt: skip
def test_a_rate_stated_once_per_channel_is_read_once(read, mark, line, rate):
    record = read(line.replace(";", mark), mark)
    assert record.rate_hz == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_channels_of_different_rates_are_asked_about(read, mark):
    with pytest.raises(RecordError, match=r"different rates: .*150.*300.*--rate-hz"):
        read("Rate (Hz);150;300".replace(";", mark), mark)


@pytest.mark.parametrize(
    ("line", "mark"),
    [("Fs: 300,300", ","), ("Fs = 1024,1024", ","), ("Sampling rate 300 300", " ")],
)
def test_a_repeated_figure_that_may_be_one_is_asked_about(read, line, mark):
    with pytest.raises(RecordError, match=r"two ways .* or (300|1024) Hz.*--rate-hz"):
        read(line, mark)


def test_thousands_of_a_sentence_stay_one_figure_beside_rows_with_commas(read):
    assert read("Sampling rate: 25,600 Hz").rate_hz == 25600
    assert read("Sample rate,1,000").rate_hz == 1000
    assert read('"Sampling rate: 1,200 Hz"').rate_hz == 1200


@pytest.mark.parametrize("line", OTHER)
def test_a_rate_of_something_else_is_no_sampling_rate(read, line):
    with pytest.raises(RecordError, match=r"does not say how often it was sampled.*--rate-hz"):
        read(line)


@pytest.mark.parametrize("line", [*OTHER, *CONTRADICTING])
def test_figures_of_something_else_leave_a_good_file_readable(read, line):
    assert read(f"{line}\nSampling rate: 300 Hz").rate_hz == 300
    assert read(f"Sampling rate: 300 Hz\n{line}").rate_hz == 300
    assert read(line, clock=True).rate_hz == pytest.approx(50)


def test_a_rate_that_is_not_used_is_quoted_in_the_question(read):
    with pytest.raises(RecordError, match=r"states, 'Loading rate: 5 Hz' \(line 1\), may be"):
        read("Loading rate: 5 Hz")


def test_the_rate_of_a_channel_is_used_and_not_that_of_all_together(read):
    assert read("Aggregate rate: 900 Hz\nRate per channel: 300 Hz").rate_hz == 300


@pytest.mark.parametrize(
    ("line", "rate"),
    [
        ("Sampled at 300 Hz", 300), ("Recorded at 300Hz", 300), ("Sampling @ 300Hz", 300),
        ("Sample every 4 ms", 250), ("Sampling interval: 00:00:00.004", 250),
        ("fs/Hz: 300", 300), ("Samples/sec/channel: 300", 300),
        ("Time between samples: 4 ms", 250), ("Rate: 300 Hz", 300), ("fs 300 Hz", 300),
        ("Recorded at a rate of 300 Hz", 300), ("Rate: 2 kS/s", 2000), ("Fs = 300", 300),
    ],
)  # fmt: skip
def test_rates_in_words(read, line, rate):
    assert read(line).rate_hz == pytest.approx(rate)


@pytest.mark.parametrize("line", ["Recorded at 15 Main Street", "Duration: 2 runs"])
def test_a_figure_without_its_unit_is_no_figure_of_sampling(line):
    assert find_facts([line]).found == ()


@pytest.mark.parametrize(
    "line", ["Storage rate: 50 Hz", "Output rate: 50 Hz", "Data rate: 50 Hz", "Rate: 50 S/s"]
)
def test_a_second_rate_that_rows_may_have_is_asked_about(read, line):
    with pytest.raises(RecordError, match=r"different rates: .*--rate-hz"):
        read(f"Sampling rate: 300 Hz\n{line}")


@pytest.mark.parametrize("line", ["Reduced rate: 50 Hz", "Decimated rate [Hz];50"])
def test_a_rate_after_thinning_comes_before_that_of_the_converter(read, line):
    assert read(f"Sample rate;300\n{line}", ";").rate_hz == 50
    assert read(f"Sample rate;300\n{line}", ";", clock=True).rate_hz == pytest.approx(50)


def test_a_bare_rate_that_gives_way_is_noted(read):
    record = read("Sampling rate: 300 Hz\nRate: 50 Hz")
    assert record.rate_hz == 300
    assert any("also states 'Rate: 50 Hz' (line 2); 300 Hz was used" in n for n in record.notes)

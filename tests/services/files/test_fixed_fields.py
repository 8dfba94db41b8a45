"""Strong-motion listings of several channels, a heading before each."""

import numpy as np
import pytest

from slowtime_services.files.record import RecordError
from slowtime_services.files.record_reader import read_record

START = "7/06/19, 03:16: 8.0 UTC (GPS)"


def listing(path, channels, starts, unit="in units of g."):
    """Write a listing of channels as network centres do: eight values a line, 8f9.6."""
    lines = []
    for number, (values, start) in enumerate(zip(channels, starts, strict=True), start=1):
        lines += [
            "Uncorrected Accelerogram Data             Processed: 07/06/19",
            f"38457487.XX.ABC.--.HN             {'Start time:  ' + start if start else ''}",
            f"Chan  {number}:  90 Deg",
            f"No. of Points = {len(values)}  Record Length ={len(values) / 100:.3f} sec"
            "   at 100 Samples/sec",
            f"{len(values):6d} Accelerogram points at 100 pts/sec {unit}       Format: (8f9.6)",
        ]
        for row in range(0, len(values), 8):
            lines.append("".join(f"{value:9.6f}" for value in values[row : row + 8]))
        lines.append(f"/&  ----------  End of data for channel  {number}  ----------")
    path.write_text("\n".join(lines) + "\n")
    return path


def shaken(counts):
    rng = np.random.default_rng(4)
    return [np.round(0.2 * rng.standard_normal(count), 6) for count in counts]


def test_channels_that_begin_together_are_cut_to_the_shortest(tmp_path):
    channels = shaken((1203, 1180, 1231))
    record = read_record(listing(tmp_path / "a.v1", channels, (START,) * 3))
    assert record.rate_hz == 100.0
    expected = np.column_stack([values[:1180] for values in channels])
    np.testing.assert_allclose(record.samples, 9.80665 * expected, rtol=1e-9)
    assert any("1203, 1180, 1231" in note and START in note for note in record.notes)


def test_units_of_acceleration_in_words_are_read(tmp_path):
    channels = shaken((800, 800))
    record = read_record(listing(tmp_path / "a.v1", channels, (START,) * 2))
    assert record.units == ("m/s^2", "m/s^2")
    np.testing.assert_allclose(record.samples, 9.80665 * np.column_stack(channels), rtol=1e-9)


@pytest.mark.parametrize("starts", [(START, "7/06/19, 03:16:11.5 UTC (GPS)"), ("", "")])
def test_channels_of_different_lengths_that_may_begin_apart_are_refused(tmp_path, starts):
    path = listing(tmp_path / "a.v1", shaken((1203, 1180)), starts)
    with pytest.raises(RecordError, match=r"1203, 1180 points, that are not known to begin"):
        read_record(path)

"""A measured bearing with a pit in its inner race: the envelope names that race alone."""

from pathlib import Path

import slowtime as st


def test_pit_in_the_inner_race_is_named_among_four_parts(data: Path):
    signals = st.read(data / "bearing_lines/12k_Drive_End_IR007_0_105.mat", rate_hz=12_000.0)
    found = st.envelope_spectrum(signals, "X105_DE_time")
    parts = st.bearing_frequencies(1797 / 60, elements=9, diameter=0.3126, pitch=1.537)
    lines = {name: found.line(hz) for name, hz in parts._asdict().items()}
    assert min(lines, key=lambda name: lines[name].p_value) == "inner_race"
    assert lines["inner_race"].p_value == 1e-12
    assert lines["outer_race"].p_value > 0.1
    assert lines["rolling_element"].p_value > 0.1
    assert abs(lines["inner_race"].frequency_hz - 161.7) < 0.1

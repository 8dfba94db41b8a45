"""The verb `separate`: two slow time scales of a history."""

import numpy as np
import pytest


@pytest.fixture
def history(tmp_path):
    t = np.arange(0.0, 120.0)
    noise = 0.01 * np.random.default_rng(4).standard_normal(len(t))
    y = 4.0 - 0.004 * t + 0.1 * np.sin(2 * np.pi * t / 11.0) + noise
    table = np.column_stack([t, y, np.full(len(t), 0.01)])
    path = tmp_path / "history.csv"
    np.savetxt(path, table, delimiter=",", header="slow_time,value,sd", comments="")
    return path


def test_the_drift_and_the_wave_come_apart_with_their_errors(run, history, tmp_path):
    out = tmp_path / "scales.csv"
    done = run("twin", "separate", str(history), "--out", "-", "--out", str(out))
    assert done.status == 0, done.err
    found = done.json
    assert found["short_scale"] == "repeating"
    assert found["period"] == pytest.approx(11.0, rel=0.01)
    assert found["long_change"] == pytest.approx(-0.004 * 119, abs=4 * found["long_change_sd"])
    rows = np.genfromtxt(out, delimiter=",", names=True)
    long = rows["long"] - rows["long"].mean()
    truth = -0.004 * (rows["slow_time"] - rows["slow_time"].mean())
    assert np.abs(long - truth).max() < 0.03


def test_too_few_readings_are_refused(run, tmp_path):
    path = tmp_path / "short.csv"
    path.write_text("slow_time,value,sd\n0,1,0.1\n1,2,0.1\n")
    done = run("twin", "separate", str(path))
    assert done.status != 0
    assert "Give at least 8" in done.err

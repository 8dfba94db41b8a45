"""The verb `orders`: amplitudes of a machine's orders during a run-up."""

import csv
import json

import numpy as np
import pytest

RATE_HZ = 1000.0


@pytest.fixture
def runup(tmp_path):
    """A shaft from 10 to 20 Hz in 20 s, with one pulse a revolution and noise."""
    t = np.arange(20 * int(RATE_HZ)) / RATE_HZ
    turned = 10.0 * t + 0.25 * t**2
    rng = np.random.default_rng(2)
    wave = 2.0 * np.cos(2 * np.pi * turned - 0.5) + 0.7 * np.cos(2 * np.pi * 3 * turned)
    pulse = np.clip(8.0 * (np.cos(2 * np.pi * turned + 0.3) - 0.9), 0.0, 0.5)
    path = tmp_path / "runup.npz"
    np.savez(path, rate_hz=RATE_HZ, a=wave + 0.05 * rng.standard_normal(len(t)), pulse=pulse)
    return path


def test_amplitudes_follow_the_orders_through_the_run_up(run, runup, tmp_path):
    done = run("modes", "orders", runup, "--tacho", "pulse", "--orders", "3,1,2", "--out", "-")
    assert done.status == 0, done.err
    rows = json.loads(done.out)["orders"]
    assert {row["channel"] for row in rows} == {"a"}
    speeds = sorted({row["speed_hz"] for row in rows})
    assert speeds[0] < 11.5
    assert speeds[-1] > 18.5
    for order, size in ((1.0, 2.0), (2.0, 0.0), (3.0, 0.7)):
        of_order = [row for row in rows if row["order"] == order]
        assert len(of_order) > 15
        for row in of_order:
            assert abs(row["amplitude"] - size) < max(5 * row["sd"], 0.02 * size)
    first = [row["phase_deg"] for row in rows if row["order"] == 1.0]
    assert np.ptp(np.unwrap(np.radians(first))) < 0.1
    printed = run(
        "modes", "orders", runup, "--tacho", "pulse", "--orders", "1", "--out", "all.csv"
    )
    assert printed.status == 0
    with (tmp_path / "all.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(first)


def test_orders_that_are_no_numbers_are_refused(refused, runup):
    for words in ("one", "1,,2", "-1", "0", ""):
        said = refused("modes", "orders", runup, "--tacho", "pulse", "--orders", words)
        assert "Allowed: numbers above 0, separated by commas" in said


def test_a_record_with_the_tacho_alone_is_refused(refused, runup):
    said = refused(
        "modes", "orders", runup, "--channels", "pulse", "--tacho", "pulse", "--orders", "1"
    )
    assert "has vibration channels too" in said

"""Real input through the whole flow: a beam whose support moves, and is seen to move."""

import json
import subprocess
import sys

import numpy as np
import pytest

pytestmark = [pytest.mark.system, pytest.mark.data]

KNOWN = {1.2: 26.27, 1.6: 28.23, 2.1: 30.82, 2.5: 33.87, 2.9: 37.55, 3.4: 41.96}
"""First natural frequency [Hz] at the roller's voltage; it repeats within 0.1 Hz."""
STILL_V = 0.03
TRIALS = ["slow10_test0", pytest.param("slow10_test1", marks=pytest.mark.slow)]


def dwells(path) -> list[tuple[float, float, float]]:
    """Begin, end [s] and known frequency [Hz] of each rest of the roller longer than 1 s."""
    table = np.genfromtxt(path, skip_header=9)
    means = table[: len(table) // 50 * 50, 2].reshape(-1, 50).mean(axis=1)
    found, start = [], 0
    for now in range(1, len(means) + 1):
        if now < len(means) and abs(means[now] - np.median(means[start:now])) < STILL_V:
            continue
        if now - start > 100:
            voltage = float(np.median(means[start:now]))
            nearest = min(KNOWN, key=lambda known: abs(known - voltage))
            assert abs(nearest - voltage) < 0.1
            found.append((start / 100, now / 100, KNOWN[nearest]))
        start = now
    return found


def check(epochs: list[tuple[float, float, float, float]], rests, *, at_least: int) -> None:
    """Each window (begin, end, frequency, sd) that lies within a rest tells its frequency."""
    told = 0
    for begin, end, known in rests:
        inside = [e for e in epochs if e[0] >= begin - 0.05 and e[1] <= end + 0.05]
        told += bool(inside)
        for _, _, value, sd in inside:
            assert abs(value - known) <= max(0.5, 2.5 * sd)
            assert sd < 2.0
    assert told >= at_least
    assert max(value for _, _, value, _ in epochs) < 100  # the second mode is above 160 Hz


@pytest.mark.long
@pytest.mark.parametrize("trial", TRIALS)
def test_the_moved_support_is_followed_through_the_whole_flow(house, data, trial):
    text = data / "moving_roller" / f"{trial}.txt"
    recording = house.home / "trial.mcap"
    slowtime(
        "import", str(text), "--out", str(recording), "--asset", "beam",
        "--site", "rig",
    )  # fmt: skip
    house.router()
    house.twin()
    house.put("/api/v1/twins/rig.beam", {"changes": "stiffness", "learn_epochs": 2})
    house.start(
        "edge", "edge", "--site", "rig", "--asset", "beam", "--file", str(recording),
        "--speed", "0", "--window-s", "1", "--hop-s", "0.1", "--connect", house.endpoint,
    )  # fmt: skip
    assert house.wait("edge", 600.0) == 0
    points = house.history("rig.beam")
    assert len(points) == 131
    began = points[0]["t_ns"] - 1_000_000_000
    epochs = [
        ((p["t_ns"] - began) / 1e9 - 1.0, (p["t_ns"] - began) / 1e9, p["frequency_hz"]["value"],
         p["frequency_hz"]["sd"])
        for p in points if p["frequency_hz"] is not None
    ]  # fmt: skip
    rests = dwells(text)
    assert len(rests) >= 3
    check(epochs, rests, at_least=len(rests))
    stiffest = max(points, key=lambda p: (p["frequency_hz"] or {"value": 0})["value"])
    assert not stiffest["valid"]
    assert any("0.3" in reason for reason in stiffest["reasons"])


@pytest.mark.slow
@pytest.mark.parametrize("trial", TRIALS)
def test_the_same_offline(data, tmp_path, trial):
    text = data / "moving_roller" / f"{trial}.txt"
    out = tmp_path / "epochs.json"
    slowtime("identify", str(text), "--window-s", "1", "--hop-s", "0.1", "--out", str(out))
    epochs = [
        (e["start_s"], e["end_s"], mode["frequency_hz"]["value"], mode["frequency_hz"]["sd"])
        for e in json.loads(out.read_text())["epochs"]
        for mode in e["modes"][:1]
    ]
    rests = dwells(text)
    check(epochs, rests, at_least=len(rests))


def slowtime(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "slowtime_cli", *arguments], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout

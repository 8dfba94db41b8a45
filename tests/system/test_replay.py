"""What was recorded is made again, bit for bit."""

import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.system


def slowtime(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "slowtime_cli", *arguments], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


def hashes(text: str) -> dict[str, str]:
    return dict(re.findall(r"^(\S+)  sha256:([0-9a-f]{64}) ", text, re.MULTILINE))


def structure(epochs: int, **more: object) -> dict[str, object]:
    return {"epochs": epochs, "seconds": 30.0, "rate_hz": 50.0} | more


@pytest.mark.long
def test_a_recording_gives_the_same_history_at_any_speed_and_the_same_features(house, tmp_path):
    house.router()
    house.twin()
    house.put(
        "/api/v1/twins/lab.mast",
        {"changes": "both", "nominal": {"frequency_hz": 5.0, "damping_ratio": 0.02}},
    )
    recording = tmp_path / "house.mcap"
    house.start("recorder", "record", "--connect", house.endpoint, "--out", str(recording))
    house.until(recording.exists, "the recorder to begin")
    for asset, seed in (("mast", 1), ("deck", 2)):
        house.edge(
            {
                "site": "lab",
                "asset": asset,
                "extract": {"method": "ambient"},
                "publish": {"raw": "on"},
                "input": {
                    "kind": "simulated",
                    "every_s": 0.1,
                    "structure": structure(
                        30,
                        seed=seed,
                        stiffness={"kind": "linear", "rate": -0.002},
                        sensor={"spikes_per_epoch": 0.5, "dropouts_per_epoch": 0.3},
                    ),
                },
            },
            name=asset,
        )
    assert house.wait("mast") == 0
    assert house.wait("deck") == 0
    house.until(lambda: len(house.history("lab.deck")) == 30, "the last epochs")
    original = {
        twin: house.get(f"/api/v1/twins/{twin}/history/hash")["sha256"]
        for twin in ("lab.mast", "lab.deck")
    }
    assert house.end("recorder") == 0
    assert house.end("twin") == 0

    assert (
        hashes(slowtime("replay", str(recording), "--into", str(tmp_path / "x.sqlite")))
        == original
    )

    for number, speed in enumerate((["--speed", "0"], ["--speed", "1"])):
        (tmp_path / "twin.sqlite").rename(tmp_path / f"before-{number}.sqlite")
        house.twin()
        said = slowtime(
            "replay", str(recording), *speed, "--connect", house.endpoint, "--server", house.url
        )
        assert hashes(said) == original
        assert house.end("twin") == 0

    assert "60 of 60 features identical" in slowtime("replay", str(recording), "--edge")

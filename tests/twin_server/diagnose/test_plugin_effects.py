"""An own effect that fails in a diagnosis costs the diagnosis nothing but itself."""

import json
import os
import subprocess
import sys
import threading

import pytest

from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.record import RecordingWriter
from slowtime_services.simulate import SimulatedModel
from tests.services.plugins.own_effects import EFFECTS
from tests.services.plugins.test_plugins import installed as installed
from tests.twin_server.serve.conftest import FRICTION, RIG
from twin_server.diagnose import Task, write_task
from twin_server.diagnose.plugin_effects import diagnose_with_plugins
from twin_server.orders import DiagnosisOrder


@pytest.fixture
def task(tmp_path, installed):
    """A task about a rig with friction, and parts of one's own that may be named in it."""
    (tmp_path / "site/own_effects.py").write_text(EFFECTS)
    rig = SimulatedModel(
        model=RIG, effects=[FRICTION], enters=0, leaves=100, seconds=6.0, rate_hz=100.0,
        interval_s=6.0, input_rms=3.0, band_hz=(0.5, 20.0), sensor={"noise": 0.02},
    )  # fmt: skip
    path = tmp_path / "monday.mcap"
    with RecordingWriter(path) as writer:
        for epoch in range(2):
            (block,) = rig.epoch(epoch)
            header = RawHeader(
                site="lab", asset="rig", boot="b1", sequence=epoch, t_ns=block.start_ns,
                time_base="simulated", rate_hz=block.rate_hz, first_index=block.first_index,
                dtype="<f4", samples=len(block.samples), channels=block.channels,
                units=block.units, epoch=block.epoch, slow_time=block.slow_time,
            )  # fmt: skip
            payload = encode_raw(header, block.samples.astype("<f4").tobytes())
            writer.write(RAW, "lab", "rig", payload, header.t_ns)

    def made(*targets, **more):
        for target in targets:
            installed("effects", target.lower(), f"own_effects:{target}")
        order = DiagnosisOrder(recordings={}, quick=True)
        return Task(
            **{
                "site": "lab", "asset": "rig", "order": order, "model": RIG,
                "recordings": (path,), "effects": tuple(map(str.lower, targets)), **more,
            }
        )  # fmt: skip

    return made


def diagnosed(task, folder):
    """Run the process of a diagnosis; its report."""
    folder.mkdir()
    write_task(folder, task)
    reading, kept_open = os.pipe()  # its end would mean to stop
    try:
        done = subprocess.run(
            [sys.executable, "-m", "twin_server.diagnose", str(folder)],
            stdin=reading, capture_output=True, timeout=900, check=False,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
    finally:
        os.close(reading)
        os.close(kept_open)
    assert done.returncode == 0, (done.stdout[-500:], done.stderr[-2000:])
    assert all(json.loads(line) for line in done.stdout.splitlines())
    return json.loads((folder / "report.json").read_text())


@pytest.mark.long
@pytest.mark.parametrize(
    ("target", "more", "told"),
    [
        ("RAISES_LATER", {}, "RuntimeError: no such luck."),
        ("HANGS_LATER", {"max_own_s": 30.0}, "it took longer than 30 s"),
        ("ENDS_LATER", {}, "its process ended with status 7"),
    ],
)
def test_what_fails_in_the_midst_of_it_is_left_out_and_told(task, tmp_path, target, more, told):
    report = diagnosed(task("RAISES", target, **more), tmp_path / "job")
    assert report["verdict"] == "missing_effect"
    assert [effect["effect"] for effect in report["effects"]] == ["coulomb"]
    notes = " ".join(report["notes"])
    assert "'raises' of bad-parts 1.0 failed: RuntimeError" in notes
    assert f"No diagnosis was made with the plug-in effects of {target.lower()}" in notes
    assert told in notes


@pytest.mark.long
def test_one_that_prints_nonsense_takes_part_like_any_other(task, tmp_path):
    report = diagnosed(task("PRINTS"), tmp_path / "job")
    assert [effect["effect"] for effect in report["effects"]] == ["coulomb"]
    assert "No diagnosis was made with" not in " ".join(report["notes"])


def test_a_model_that_needs_what_failed_says_so(task, tmp_path):
    entry = {"effect": "softening_spring", "element": "j2", "k_n_per_m": 1.0, "d_m": 1.0}
    given = task("RAISES", model=RIG | {"effects": [entry]})
    found = diagnose_with_plugins(given, tmp_path, lambda content: None, threading.Event())
    assert not found.done
    assert "failed: RuntimeError: no such luck. It was left out." in found.error
    assert found.error.endswith("The model itself has softening_spring.")

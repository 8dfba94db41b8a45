"""Whatever `slowtime identify --out` writes is a file of modes, as its schema has it."""

import dataclasses
import json

import numpy as np
import pytest

from slowtime.dynamics.builders import accelerometer, shear_frame
from slowtime.dynamics.description import assemble
from slowtime.dynamics.simulation import ambient_structure
from slowtime_schemas.modes_file import ModesFile
from slowtime_services.models import write_model

FLOORS = ("floor1", "floor2")
FRAME = dataclasses.replace(
    shear_frame([2.0, 2.0], [4000.0, 4000.0], rayleigh=(0.0, 4e-4)),
    sensors=tuple(accelerometer(floor) for floor in FLOORS),
)


@pytest.fixture
def vibration(tmp_path):
    """Two minutes of two floors, and a machine's line."""
    structure, rng = assemble(FRAME), np.random.default_rng(5)
    samples = ambient_structure(structure, 4800, 40.0, rng, channels=FLOORS)
    samples = samples + 0.05 * samples.std() * rng.standard_normal(samples.shape)
    line = np.sin(2 * np.pi * 7.1 * np.arange(4800) / 40.0)
    samples += 0.5 * samples.std() * line[:, None]
    write_model(tmp_path / "frame.yaml", FRAME)
    path = tmp_path / "frame.csv"
    np.savetxt(path, samples, delimiter=",", header="a_floor1,a_floor2", comments="")
    return path


@pytest.mark.parametrize(
    "flags",
    [
        ["--model", "frame.yaml"],
        ["--method", "peak"],
        ["--method", "ambient", "--band-hz", "2", "6"],
        ["--method", "peak", "--window-s", "20"],
    ],
    ids=" ".join,
)
def test_what_identify_writes_is_a_file_of_modes(run, vibration, flags, monkeypatch):
    monkeypatch.chdir(vibration.parent)
    done = run("identify", vibration, "--rate-hz", "40", *flags, "--out", "modes.json")
    assert done.status == 0, done.err
    text = (vibration.parent / "modes.json").read_text()
    found = ModesFile.model_validate_json(text)
    epochs = found.epochs or ()
    modes = [mode for epoch in epochs for mode in epoch.modes] + list(found.modes or ())
    assert modes
    # Nothing of what was written is lost or renamed by the schema.
    assert _without_nothing(found.model_dump(mode="json")) == _without_nothing(json.loads(text))
    if flags[0] == "--model":
        assert {mode.model.mode for mode in modes if mode.model} == {1, 2}


def _without_nothing(value):
    """The same without keys whose value is null."""
    if isinstance(value, dict):
        return {k: _without_nothing(v) for k, v in value.items() if v is not None}
    return [_without_nothing(v) for v in value] if isinstance(value, list) else value

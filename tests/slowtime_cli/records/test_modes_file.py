"""Whatever `slowtime identify --out` writes is a file of modes, as its schema has it."""

import dataclasses
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from slowtime.dynamics.builders import accelerometer, shear_frame
from slowtime.dynamics.description import assemble
from slowtime.dynamics.simulation import ambient_structure
from slowtime_schemas.files.modes import FoundMode, ModesFile
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


def test_modes_for_another_program_come_back_as_the_same_modes(run, vibration, monkeypatch):
    pyuff = pytest.importorskip("pyuff")
    monkeypatch.chdir(vibration.parent)
    flags = ("identify", vibration, "--rate-hz", "40", "--unit", "mg", "--method", "modes")
    for out in ("modes.json", "modes.uff", "modes.csv"):
        done = run(*flags, "--out", out)
        assert done.status == 0, done.err
    assert "1 line of machines, which are no modes, left out of modes.uff" in run(
        *flags, "--out", "modes.uff"
    ).err.replace("\n", " ")
    told = ModesFile.model_validate_json(Path("modes.json").read_text())
    modes = [mode for mode in told.modes or () if mode.kind == "structural"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sets = pyuff.UFF("modes.uff").read_sets()
    assert len(sets) == len(modes) == 2
    for one, mode in zip(sets, modes, strict=True):
        hz = abs(one["eig"]) / (2 * np.pi)
        assert hz == pytest.approx(mode.frequency_hz.value, rel=1e-5)
        assert one["spec_data_type"] == 12
        assert mode.shape is not None
        shape = np.array(mode.shape.re) + 1j * np.array(mode.shape.im)
        np.testing.assert_allclose(one["r1"], shape, atol=2e-5)
    # What was written is a model to compare the same record with.
    again = run(*flags, "--model", "modes.uff", "--out", "again.json")
    assert again.status == 0, again.err
    for mode in ModesFile.model_validate_json(Path("again.json").read_text()).modes or ():
        if mode.kind == "structural":
            assert mode.model is not None
            assert mode.model.mac == pytest.approx(1.0, abs=1e-4)
            assert mode.model.difference == pytest.approx(0.0, abs=1e-5)


@pytest.mark.long
def test_units_change_no_frequency_and_make_shapes_comparable(run, vibration, monkeypatch):
    monkeypatch.chdir(vibration.parent)
    whole = np.loadtxt(vibration, delimiter=",", skiprows=1)
    np.savetxt(
        "mixed.csv", whole / [9.80665e-3, 0.0254], delimiter=",", comments="",
        header="acc_1 [mg],acc_2 [in/s^2]",
    )  # fmt: skip
    np.savetxt(
        "volts.csv", whole / [9.80665, 1.0], delimiter=",", comments="",
        header="acc_1 [V],acc_2 [m/s^2]",
    )  # fmt: skip
    flags = ("--rate-hz", "40", "--method", "modes", "--out")
    found: dict[str, tuple[FoundMode, ...]] = {}
    said = {}
    for name, more in (
        ("frame.csv", ()), ("mixed.csv", ()), ("volts.csv", ()),
        ("volts.csv", ("--reading", "sensitivity=acc_1=1V/g")),
    ):  # fmt: skip
        done = run("identify", name, *more, *flags, "modes.json")
        assert done.status == 0, done.err
        key = name + "".join(more[:1])
        told = ModesFile.model_validate_json(Path("modes.json").read_text())
        found[key], said[key] = told.modes or (), done.err
    plain = found["frame.csv"]
    for key in ("mixed.csv", "volts.csv", "volts.csv--reading"):
        for mode, same in zip(plain, found[key], strict=True):
            assert mode.frequency_hz.value == pytest.approx(same.frequency_hz.value, rel=1e-6)
            if key == "volts.csv":
                assert same.shape is None
                assert "mixed_units" in same.flags
            else:
                assert mode.shape is not None
                assert same.shape is not None
                np.testing.assert_allclose(mode.shape.re, same.shape.re, atol=1e-5)
    assert "no shapes are told" in said["volts.csv"].replace("\n", " ")
    done = run("identify", "volts.csv", "--rate-hz", "40", "--out", "modes.uff")
    assert done.status == 2
    assert "channels of one unit" in done.err.replace("\n", " ")


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--out", "m.uff", "--window-s", "20"], "of a whole record"),
        (["--out", "m.uff", "--method", "peak"], "with shapes"),
        (["--out", "m.json", "--geometry", "frame.yaml"], "goes with --out .uff or .unv"),
    ],
)
def test_what_a_universal_file_cannot_hold_is_said_before_the_work(
    run, vibration, flags, said, monkeypatch
):
    monkeypatch.chdir(vibration.parent)
    done = run("identify", vibration, "--rate-hz", "40", *flags)
    assert done.status == 2
    assert said in done.err.replace("\n", " ")

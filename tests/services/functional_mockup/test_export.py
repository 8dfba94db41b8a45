"""Functional mock-up units, run by FMPy as other programs run them."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave

from slowtime.dynamics.description import Description, Matrix, Spring
from slowtime_cli.__main__ import app
from slowtime_services.functional_mockup import FmuError, write_fmu
from slowtime_services.functional_mockup.co_simulated_model import CoSimulatedModel
from slowtime_services.matrices import read_any_description
from slowtime_services.models import read_description, run_model

RIG = """\
slowtime_model: 1
name: two storeys
nodes:
  - {{id: m1, mass_kg: 2.0}}
  - {{id: m2, mass_kg: 1.5}}
elements:
  - {{id: k1, between: [base, m1], stiffness_n_per_m: 2000.0, damping_n_s_per_m: 1.5}}
  - {{id: upper storey, between: [m1, m2], stiffness_n_per_m: 1500.0, damping_n_s_per_m: 1.0}}
effects: {effects}
inputs:
  - {input}
sensors:
  - {{channel: x2, quantity: displacement, node: m2, unit: mm}}
  - {{channel: a1, quantity: acceleration, node: m1, unit: m/s^2}}
"""
SHAKER = "{channel: shaker, kind: force, node: m2, unit: N}"
GROUND = "{channel: ground, kind: base_acceleration, unit: m/s^2}"
RATE = 200.0


def rig(folder: Path, effects: str = "[]", driven: str = SHAKER) -> Description:
    path = folder / "rig.yaml"
    path.write_text(RIG.format(effects=effects, input=driven), encoding="utf-8")
    return read_description(path)


def loaded(samples: int = 300) -> np.ndarray:
    return 4.0 * np.random.default_rng(5).standard_normal(samples)


def stepped(
    path: Path,
    series: np.ndarray,
    rate_hz: float = RATE,
    parameters: dict[str, float] | None = None,
) -> dict[str, np.ndarray]:
    """Outputs at each sample, after the input of that sample was set: by FMPy's own slave."""
    described = read_model_description(str(path))
    reference = {one.name: one.valueReference for one in described.modelVariables}
    folder = extract(str(path))
    slave = FMU2Slave(
        guid=described.guid,
        unzipDirectory=folder,
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="tested",
    )
    outputs = [one.name for one in described.modelVariables if one.causality == "output"]
    (drive,) = [one.name for one in described.modelVariables if one.causality == "input"]
    try:
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        for name, value in (parameters or {}).items():
            slave.setReal([reference[name]], [value])
        slave.exitInitializationMode()
        found = []
        for k, value in enumerate(series.tolist()):
            slave.setReal([reference[drive]], [value])
            found.append(slave.getReal([reference[name] for name in outputs]))
            slave.doStep(k / rate_hz, 1.0 / rate_hz)
        slave.terminate()
        slave.freeInstance()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return dict(zip(outputs, np.array(found).T, strict=True))


def assert_close(found: dict[str, np.ndarray], truth: dict[str, np.ndarray], by: float) -> None:
    for name, series in truth.items():
        np.testing.assert_allclose(found[name], series, rtol=0, atol=by * np.abs(series).max())


def test_a_linear_unit_gives_what_simulate_gives(tmp_path):
    description, series = rig(tmp_path), loaded()
    write_fmu(description, tmp_path / "rig.fmu")
    truth = run_model(description, {"shaker": series}, RATE, hold="zero")
    assert_close(stepped(tmp_path / "rig.fmu", series), truth, 1e-9)


@pytest.mark.parametrize(
    "effect",
    [
        "[{effect: cubic_hardening, element: upper storey, k3_n_per_m3: 5.0e+6}]",
        "[{effect: coulomb, element: k1, friction_n: 1.5}]",
        "[{effect: bouc_wen, element: k1, kh_n_per_m: 900, zy_m: 0.002, n: 1}]",
    ],
)
def test_a_unit_with_an_effect_gives_what_simulate_gives(tmp_path, effect):
    description, series = rig(tmp_path, effect), loaded()
    write_fmu(description, tmp_path / "rig.fmu")
    truth = run_model(description, {"shaker": series}, RATE, hold="zero")
    linear = run_model(
        dataclasses.replace(description, effects=()), {"shaker": series}, RATE, hold="zero"
    )
    assert np.abs(truth["x2"] - linear["x2"]).max() > 0.05 * np.abs(truth["x2"]).max()
    assert_close(stepped(tmp_path / "rig.fmu", series), truth, 1e-3)


def test_fmpys_own_loop_gives_the_displacements_of_simulate(tmp_path):
    description, series = rig(tmp_path, driven=GROUND), loaded()
    write_fmu(description, tmp_path / "rig.fmu", step_s=1 / RATE)
    truth = run_model(description, {"ground": series}, RATE, hold="zero")
    times = np.arange(len(series)) / RATE
    # FMPy looks inputs up at the beginning of a step, up to rounding: a step that begins a bit
    # early holds the value from there on.
    drive = np.array(
        list(zip(times - 1e-6, series, strict=True)), dtype=[("time", float), ("ground", float)]
    )
    run = simulate_fmu(
        str(tmp_path / "rig.fmu"),
        input=_stairs(drive),
        stop_time=times[-1],
        output_interval=1 / RATE,
        output=["x2"],
    )
    # Absolute displacement of a storey on a base that moves.
    assert_close({"x2": run["x2"]}, {"x2": truth["x2"]}, 1e-6)


def _stairs(drive: np.ndarray) -> np.ndarray:
    later = drive.copy()
    later["time"][:-1] = drive["time"][1:] - 1e-9
    later["time"][-1] += 1.0
    both = np.concatenate([drive, later])
    return both[np.argsort(both["time"], kind="stable")]


def test_a_parameter_of_the_unit_is_that_of_the_model(tmp_path):
    description, series = rig(tmp_path), loaded()
    write_fmu(description, tmp_path / "rig.fmu")
    softer = dataclasses.replace(
        description,
        elements=tuple(
            dataclasses.replace(one, stiffness_n_per_m=1200.0)
            if isinstance(one, Spring) and one.id == "upper storey"
            else one
            for one in description.elements
        ),
    )
    truth = run_model(softer, {"shaker": series}, RATE, hold="zero")
    found = stepped(
        tmp_path / "rig.fmu", series, parameters={"stiffness.'upper storey'": 1200.0}
    )
    assert_close(found, truth, 1e-9)


def test_the_step_may_change_between_steps(tmp_path):
    description = rig(tmp_path)
    model, whole = CoSimulatedModel(description), CoSimulatedModel(description)
    for one in (model, whole):
        one.set_input(0, 3.0)
    for step in (0.02, 0.005, 0.1, 0.075):
        model.step(step)
    whole.step(0.2)
    assert model.output(0) == pytest.approx(whole.output(0), rel=1e-9)
    assert model.output(1) == pytest.approx(whole.output(1), rel=1e-9)


def test_a_start_returns_to_the_initial_state(tmp_path):
    model = CoSimulatedModel(rig(tmp_path))
    model.set_input(0, 3.0)
    model.step(0.1)
    assert model.output(0) != 0.0
    model.start(0.0)
    assert model.output(0) == 0.0


@pytest.mark.parametrize(
    ("effects", "driven", "said"),
    [
        ("[]", "{channel: u, kind: base_displacement, unit: m}", "is a base displacement"),
        ("[]", SHAKER.replace("}", ", hold: first}"), "needs samples to come"),
        ("[{effect: input_delay, input: shaker, delay_s: 0.01}]", SHAKER, "earlier or later"),
        ("[{effect: base_motion, rms_m_per_s2: 0.1}]", GROUND, "nobody measured"),
        (
            "[{effect: sensor_dropout, sensor: a1, from_s: 60, for_s: 5, held: 1}]",
            SHAKER,
            "earlier or later",
        ),
        (
            "[{effect: sensor_gain, sensor: x2, gain: 1.1}]",
            GROUND,
            "moves along with the base",
        ),
    ],
)
def test_what_needs_a_whole_record_is_refused(tmp_path, effects, driven, said):
    with pytest.raises(FmuError, match=said):
        write_fmu(rig(tmp_path, effects, driven), tmp_path / "rig.fmu")


def test_a_parameter_outside_its_bounds_is_refused(tmp_path):
    model = CoSimulatedModel(rig(tmp_path))
    with pytest.raises(ValueError, match=r"stiffness.k1 = -1 is not allowed.*from 0"):
        model.set_parameter("stiffness.k1", -1.0)


FRAME = """\
slowtime_model: 2
name: mast
frame:
  materials:
    - {id: steel, young_pa: 2.1e11, poisson: 0.3, density_kg_m3: 7850.0}
  sections:
    - {id: pipe, shape: tube, diameter_m: 0.1, wall_m: 0.005}
  nodes:
    - {id: foot, at: [0.0, 0.0, 0.0]}
    - {id: middle, at: [0.0, 0.0, 3.0]}
    - {id: top, at: [0.0, 0.0, 6.0]}
  elements:
    - {id: c1, between: [foot, middle], section: pipe, material: steel, group: lower half}
    - {id: c2, between: [middle, top], section: pipe, material: steel, group: upper}
  supports:
    - {node: foot}
  parameters:
    - {name: lower half, groups: [lower half], acts_on: both, prior_sd: 0.2}
    - {name: upper, groups: [upper], prior_sd: 0.2}
damping_ratio: 0.01
inputs:
  - {channel: hammer, kind: force, node: top, direction: ux, unit: N}
sensors:
  - {channel: a1, node: top, direction: ux}
"""


def test_a_group_of_a_frame_is_a_parameter_of_the_unit(tmp_path):
    path = tmp_path / "mast.yaml"
    path.write_text(FRAME, encoding="utf-8")
    description, series = read_any_description(path), loaded()
    found = CliRunner().invoke(
        app, ["fmu", str(path), "--out", str(tmp_path / "mast.fmu")], catch_exceptions=False
    )
    assert "change.'lower half' [1]" in found.output
    changed = dataclasses.replace(
        description,
        elements=tuple(
            dataclasses.replace(one, stiffness_factor=0.8, mass_factor=0.8)
            if isinstance(one, Matrix) and one.id == "lower half"
            else one
            for one in description.elements
        ),
    )
    truth = run_model(changed, {"hammer": series}, RATE, hold="zero")
    moved = stepped(tmp_path / "mast.fmu", series, parameters={"change.'lower half'": -0.2})
    assert_close(moved, truth, 1e-8)


def test_without_sensors_there_is_nothing_to_export(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(
        RIG.format(effects="[]", input=SHAKER).partition("sensors:")[0], encoding="utf-8"
    )
    with pytest.raises(FmuError, match="lists no sensors"):
        write_fmu(read_description(path), tmp_path / "rig.fmu")

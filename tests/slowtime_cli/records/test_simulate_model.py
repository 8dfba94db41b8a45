"""`simulate --model`, as a script meets it."""

import numpy as np
import pytest

from slowtime.dynamics.description import assemble
from slowtime.dynamics.simulation import simulate_structure
from slowtime_services.models import read_description

RIG = """\
slowtime_model: 1
name: rig
nodes:
  - {id: m1, mass_kg: 1.9}
  - {id: m2, mass_kg: 2.1}
elements:
  - {id: j0, between: [base, m1], stiffness_n_per_m: 4100.0, damping_n_s_per_m: 2.3}
  - {id: j1, between: [m1, m2], stiffness_n_per_m: 3900.0, damping_n_s_per_m: 2.2}
inputs:
  - {channel: u, kind: force, node: m1, unit: N}
sensors:
  - {channel: a1, quantity: acceleration, node: m1, frame: absolute, unit: m/s^2, noise_sd: 0.5}
  - {channel: x2, quantity: displacement, node: m2, frame: relative_to_base, unit: mm}
"""
AMBIENT = RIG.replace("inputs:\n  - {channel: u, kind: force, node: m1, unit: N}\n", "")
T = 3.0 + np.arange(400) / 200.0
PUSH = 5 * np.sin(np.arange(400) ** 1.5 / 50)

SECONDS = "note: assumed: time from column 't' in seconds, because no unit is stated.\n"
"""What is said of a clock whose name tells no unit."""


@pytest.fixture
def model(text):
    return text(RIG.splitlines(), "rig.yaml")


@pytest.fixture
def record(tmp_path):
    np.savez(tmp_path / "in.npz", t=T, u=PUSH, other=0 * PUSH)
    return "in.npz"


def written(tmp_path, name="out.npz"):
    with np.load(tmp_path / name) as file:
        return dict(file)


def test_out_holds_t_and_one_array_for_each_sensor(run, tmp_path, model, record):
    done = run("simulate", "--model", model, "--input", record, "--out", "out.npz")
    assert (done.status, done.err) == (0, SECONDS)
    assert done.out == "out.npz: 400 samples of a1, x2 at 200 Hz\n"
    arrays = written(tmp_path)
    assert set(arrays) == {"t", "a1", "x2"}
    np.testing.assert_allclose(arrays["t"], T)
    structure = assemble(read_description(model))
    q, _, a = simulate_structure(
        structure, np.column_stack([PUSH, 0 * PUSH]), 200.0, hold="first"
    )
    np.testing.assert_allclose(arrays["a1"], a[:, 0], atol=1e-9)
    np.testing.assert_allclose(arrays["x2"], 1e3 * q[:, 1], atol=1e-9)


def test_a_text_record_is_run_alike_and_its_unit_is_turned(run, tmp_path, model, record, text):
    run("simulate", "--model", model, "--input", record, "--out", "out.npz")
    rows = [f"{t:.4f},{u / 1e3:.12f}" for t, u in zip(T, PUSH, strict=True)]
    table = text(["t,u", "s,kN", *rows], "in.csv")
    done = run("simulate", "--model", model, "--input", table, "--out", "b.npz")
    assert done.status == 0
    assert "converted to the model's N" in done.err
    np.testing.assert_allclose(
        written(tmp_path, "b.npz")["a1"], written(tmp_path)["a1"], atol=1e-6
    )


def test_inputs_may_stay_between_samples(run, tmp_path, model, record):
    run(
        "simulate",
        "--model",
        model,
        "--input",
        record,
        "--setting",
        "hold=zero",
        "--out",
        "out.npz",
    )
    structure = assemble(read_description(model))
    q, _, _ = simulate_structure(structure, np.column_stack([PUSH, 0 * PUSH]), 200.0)
    np.testing.assert_allclose(written(tmp_path)["x2"], 1e3 * q[:, 1], atol=1e-9)


def test_noise_is_what_the_model_says_and_the_seed_decides_it(run, tmp_path, model, record):
    flags = ("--model", model, "--input", record)
    run("simulate", *flags, "--out", "out.npz")
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run("simulate", *flags, "--noise", "--seed", seed, "--out", f"{name}.npz")
    clean, a, b, c = (written(tmp_path, f"{name}.npz") for name in ("out", "a", "b", "c"))
    assert np.std(a["a1"] - clean["a1"]) == pytest.approx(0.5, rel=0.15)
    np.testing.assert_array_equal(a["x2"], clean["x2"])
    np.testing.assert_array_equal(a["a1"], b["a1"])
    assert not np.array_equal(a["a1"], c["a1"])


def test_without_inputs_a_model_is_under_ambient_forces(run, tmp_path, text):
    model = text(AMBIENT.splitlines(), "rig.yaml")
    flags = ("--duration", 20, "--rate-hz", 100, "--seed", 4)
    for name in ("a", "b"):
        done = run("simulate", "--model", model, *flags, "--out", f"{name}.npz")
        assert (done.status, done.err) == (0, "")
    a, b = written(tmp_path, "a.npz"), written(tmp_path, "b.npz")
    assert a["a1"].shape == a["t"].shape == (2000,)
    assert np.std(a["a1"]) > 0
    np.testing.assert_array_equal(a["a1"], b["a1"])
    run("simulate", "--model", model, *flags, "--setting", "force_psd=4", "--out", "c.npz")
    np.testing.assert_allclose(written(tmp_path, "c.npz")["a1"], 2 * a["a1"])


@pytest.mark.parametrize(
    ("change", "flags", "says"),
    [
        (
            ("unit: N}", "unit: V}"),
            ("--input", "in.npz"),
            "rig.yaml, line 10: 'V' is not a valid unit of",
        ),
        (("channel: u", "channel: f"), ("--input", "in.npz"), "no channel called f; it has u"),
        (("", ""), (), "has inputs: u. Give --input RECORD"),
        (("", ""), ("--input", "in.npz", "--noise"), "Give --seed"),
        (("", ""), ("--input", "in.npz", "--structure", "tower"), "exclude each other"),
        (
            ("inputs:", "effects: [{effect: coulomb, element: j1}]\ninputs:"),
            ("--input", "in.npz"),
            "rig.yaml, line 9: coulomb needs `friction_n`. It is the friction of sliding [N].",
        ),
        (("sensors:", "sensors: []\nx:"), ("--input", "in.npz"), "unknown key `x`"),
    ],
)
def test_what_cannot_be_run_is_refused(refused, tmp_path, text, record, change, flags, says):
    model = text(RIG.replace(*change).splitlines(), "rig.yaml")
    assert says in refused("simulate", "--model", model, *flags, "--out", "out.npz")
    assert not (tmp_path / "out.npz").exists()


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        ((), "Give --rate-hz, --duration and --seed"),
        (("--duration", 0.001, "--rate-hz", 100, "--seed", 1), "makes 0 samples"),
        (("--duration", 1e9, "--rate-hz", 100, "--seed", 1), "less than 1024 MiB"),
    ],
)
def test_ambient_vibration_needs_its_length(refused, text, flags, says):
    model = text(AMBIENT.splitlines(), "rig.yaml")
    assert says in refused("simulate", "--model", model, *flags, "--out", "out.npz")


def test_a_model_is_written_as_arrays_only(refused, model, record):
    says = refused("simulate", "--model", model, "--input", record, "--out", "a.mcap")
    assert "does not end in .npz" in says
    heard = "sensors:" + RIG.split("sensors:")[1]
    model.write_text(RIG.replace(heard, ""))
    says = refused("simulate", "--model", model, "--input", record, "--out", "a.npz")
    assert "lists no sensors" in says


def test_a_record_with_gaps_is_refused(refused, tmp_path, model):
    kept = np.r_[0:100, 150:400]
    np.savez(tmp_path / "in.npz", t=T[kept], u=PUSH[kept])
    assert "lacks 50 samples" in refused(
        "simulate", "--model", model, "--input", "in.npz", "--out", "out.npz"
    )


OWN = """\
from slowtime.dynamics.effects import Kind, Law, Parameter

def force(e, v, t, z, p):
    return p[0] * e

KIND = Kind(
    name="stiffer", family="own", where="element",
    parameters=(Parameter(name="k", unit="N/m", meaning="stiffness added"),),
    equation="k e", source="", sentence="It is stiffer.", action=Law(force=force),
)
"""


def effected(entry):
    return RIG.replace("inputs:", f"effects:\n  - {entry}\ninputs:").splitlines()


def test_effects_run_those_of_ones_own_too(run, tmp_path, text, record):
    entries = {
        "listed": "{effect: stiffness_loss, element: j1, dk_n_per_m: -200}",
        "own": "{effect: stiffer, element: j1, k: 200}",
    }
    own = text(OWN.splitlines(), "own.py")
    flags = ("--input", record, "--setting", "hold=band_limited", "--setting", f"effects={own}")
    for name, entry in entries.items():
        model = text(effected(entry), f"{name}.yaml")
        done = run("simulate", "--model", model, *flags, "--out", f"{name}.npz")
        assert (done.status, done.err) == (0, SECONDS)
    listed, found = (written(tmp_path, f"{name}.npz") for name in entries)
    np.testing.assert_allclose(found["x2"], listed["x2"], atol=1e-6 * np.ptp(listed["x2"]))
    plain = text(RIG.splitlines(), "rig.yaml")
    run("simulate", "--model", plain, *flags, "--out", "plain.npz")
    assert np.std(written(tmp_path, "plain.npz")["x2"] - listed["x2"]) > 0.01


def test_effects_live_in_campaign_time(run, tmp_path, text, record):
    """The record begins at 3 s: what jumped at 2 s has been so throughout."""
    jump = "{{effect: stiffness_jump, element: j1, dk_n_per_m: 500, t_jump_s: {}}}"
    loss = "{effect: stiffness_loss, element: j1, dk_n_per_m: 500}"
    entries = {"before": jump.format(2.0), "after": jump.format(9.0), "lost": loss}
    for name, entry in entries.items():
        model = text(effected(entry), f"{name}.yaml")
        run("simulate", "--model", model, "--input", record, "--out", f"{name}.npz")
    found = {name: written(tmp_path, f"{name}.npz")["x2"] for name in entries}
    np.testing.assert_allclose(found["before"], found["lost"], atol=1e-5)
    plain = text(RIG.splitlines(), "plain.yaml")
    run("simulate", "--model", plain, "--input", record, "--out", "plain.npz")
    np.testing.assert_allclose(found["after"], written(tmp_path, "plain.npz")["x2"], atol=1e-5)


def test_motion_of_the_base_that_nobody_measured_wants_a_seed(run, refused, text, record):
    model = text(effected("{effect: base_motion, rms_m_per_s2: 0.1}"), "rig.yaml")
    flags = ("simulate", "--model", model, "--input", record, "--out", "out.npz")
    assert "random. Give a seed" in refused(*flags)
    assert run(*flags, "--seed", 3).status == 0


FREE = AMBIENT + "initial:\n  - {node: m2, displacement_m: 0.01}\n"


def test_a_model_without_inputs_decays_freely_from_its_start(run, tmp_path, text):
    model = text(FREE.splitlines(), "free.yaml")
    done = run(
        "simulate", "--model", model, "--duration", "2", "--rate-hz", "200", "--out", "a.npz"
    )
    assert done.status == 0, done.err
    told = written(tmp_path, "a.npz")["x2"]
    assert told[0] == pytest.approx(10.0)
    other = (
        "--setting",
        "initial=m2=0.02",
        "--duration",
        "2",
        "--rate-hz",
        "200",
        "--out",
        "b.npz",
    )
    assert run("simulate", "--model", model, *other).status == 0
    np.testing.assert_allclose(written(tmp_path, "b.npz")["x2"], 2 * told, atol=1e-9)


def test_a_velocity_is_a_start_too(run, tmp_path, model, record):
    done = run(
        "simulate", "--model", model, "--input", record, "--setting", "initial=m1=0,0.5",
        "--out", "a.npz",
    )  # fmt: skip
    assert done.status == 0, done.err
    run("simulate", "--model", model, "--input", record, "--out", "b.npz")
    assert not np.allclose(written(tmp_path, "a.npz")["x2"], written(tmp_path, "b.npz")["x2"])


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ("m1", "Write NODE=DISPLACEMENT"),
        ("m1=x", "Write NODE=DISPLACEMENT"),
        ("m1=1,2,3", "Write NODE=DISPLACEMENT"),
        ("=1", "Write NODE=DISPLACEMENT"),
        ("m1=nan", "Write NODE=DISPLACEMENT"),
        ("m9=1", "called 'm9'. There are: m1, m2"),
    ],
)
def test_a_start_that_is_none_says_how_to_write_it(run, model, record, start, words):
    done = run(
        "simulate",
        "--model",
        model,
        "--input",
        record,
        "--setting",
        f"initial={start}",
        "--out",
        "a.npz",
    )
    assert done.status == 2
    assert words in " ".join(done.err.split())


def test_a_free_decay_says_what_it_needs(run, text):
    model = text(FREE.splitlines(), "free.yaml")
    done = run("simulate", "--model", model, "--out", "a.npz")
    assert "decays freely" in done.err
    assert "--duration" in done.err

"""The verb `track`: constants of a nonlinear structure from records of another simulator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

RIG = """slowtime_model: 1
name: rig
nodes: [{id: m, mass_kg: 2.0}]
elements: [{id: k, between: [base, m], stiffness_n_per_m: 1000, damping_n_s_per_m: 3}]
effects: [{effect: cubic_hardening, element: k, k3_n_per_m3: 20000.0}]
inputs: [{channel: f, kind: force, node: m, unit: N}]
sensors: [{channel: a, quantity: acceleration, node: m, unit: m/s^2, noise_sd: 0.1}]
"""
TRUTH = {"k.damping": 2.0, "effect0.k3_n_per_m3": 30_000.0}


def record(path, stiffness, seed):
    """Motion by an adaptive integrator of scipy under a smooth random force."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 20.0, 0.01)
    hz, phase = rng.uniform(0.5, 8.0, 30), rng.uniform(0, 2 * np.pi, 30)
    force = lambda s: 12.0 * np.sin(2 * np.pi * hz * s + phase).sum() / 4.0  # noqa: E731

    def slope(s, y):
        inner = stiffness * y[0] + 2.0 * y[1] + 3e4 * y[0] ** 3
        return [y[1], (force(s) - inner) / 2.0]

    y = solve_ivp(slope, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10).y
    a = np.array([slope(s, row)[1] for s, row in zip(t, y.T, strict=True)])
    a += 0.1 * rng.standard_normal(len(t))
    f = np.array([force(s) for s in t])
    np.savetxt(path, np.column_stack([t, f, a]), delimiter=",", header="t_s,f,a", comments="")
    return path


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    (folder / "rig.yaml").write_text(RIG)
    records = [record(folder / f"run{k}.csv", 900.0 - 20.0 * k, k) for k in range(2)]
    return folder / "rig.yaml", records


def told(run, *arguments):
    done = run("modes", "track", *map(str, arguments), "--out", "-")
    assert done.status == 0, done.err
    return done.json


def test_constants_come_out_within_their_errors_record_by_record(run, rig):
    model, records = rig
    rows = told(run, model, *records, "--at", "0,30")["constants"]
    for row in rows:
        stiffness = 900.0 - 20.0 * (row["slow_time"] / 30.0)
        truth = TRUTH.get(row["constant"], stiffness)
        assert abs(row["value"] - truth) < 4.0 * row["sd"], row
        assert row["sd"] < 0.05 * truth
        assert 0.4 < row["surprise"] < 1.7
    assert [row["slow_time"] for row in rows] == [0.0] * 3 + [30.0] * 3


def test_only_what_is_named_is_free_and_a_table_is_written(run, rig, tmp_path):
    model, records = rig
    out = tmp_path / "constants.csv"
    rows = told(run, model, records[0], "--free", "k.stiffness", "--out", out)["constants"]
    assert [row["constant"] for row in rows] == ["k.stiffness"]
    assert out.read_text().startswith("record,slow_time,constant,value,sd,lo,hi")


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (("--free", "k.colour"), "Allowed: k.stiffness, k.damping, m.mass, effect0"),
        (("--at", "1,2,3"), "3 slow times for 1 records"),
        (("--at", "now"), "no numbers"),
        (("--setting", "forecast_to=9"), "A forecast takes 5"),
    ],
)
def test_what_cannot_be_tracked_is_named(run, rig, more, text):
    model, records = rig
    done = run("modes", "track", str(model), str(records[0]), *more)
    assert done.status != 0
    assert text in done.err

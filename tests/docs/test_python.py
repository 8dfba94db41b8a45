"""The Python of README and docs/python.md runs as it stands."""

import re
from pathlib import Path

import numpy as np
import pytest

import slowtime as st
from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"(?:^ {4}.*\n)+", re.M)
RIG = """\
slowtime_model: 1
name: rig
nodes:
  - {id: m1, mass_kg: 1.0}
elements:
  - {id: k1, kind: spring, between: [base, m1], stiffness_n_per_m: 400, damping_n_s_per_m: 0.8}
sensors:
  - {channel: x, quantity: displacement, node: m1, unit: m}
inputs:
  - {channel: u, kind: force, node: m1, unit: N}
"""


def blocks(page: Path) -> list[str]:
    """Return the indented blocks of a page, without indentation."""
    return [re.sub(r"^ {4}", "", one, flags=re.M) for one in BLOCK.findall(page.read_text())]


def python_of(page: Path, word: str) -> str:
    (found,) = [one for one in blocks(page) if word in one]
    return found


@pytest.fixture
def record(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    oscillator = Oscillator.from_modal(4.0, 0.02)
    samples = ambient_acceleration(oscillator, 100 * 120, 100.0, np.random.default_rng(0))
    np.savetxt("record.csv", samples / samples.std(), fmt="%.6f", header="acc [m/s^2]")


@pytest.mark.gate
@pytest.mark.parametrize("page", ["README.md", "docs/python.md"])
def test_a_file_becomes_modes_and_a_picture(page, record, capsys):
    exec(python_of(ROOT / page, 'st.read("record.csv"'), {"st": st})
    assert page == "README.md" or Path("record.png").stat().st_size > 5000
    found = re.search(r"(\d+\.\d+) ± (\d+\.\d+)", capsys.readouterr().out)
    assert found is not None
    true = 4.0 if page == "docs/python.md" else 8.0  # it states twice the rate
    assert float(found[1]) == pytest.approx(true, abs=5 * float(found[2]))


def test_a_decay_is_followed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    t = np.arange(0, 20, 0.01)
    Path("swing.csv").write_text(
        "t,x\n" + "".join(f"{s:.2f},{np.exp(-0.2 * s) * np.cos(20 * s):.9f}\n" for s in t)
    )
    exec(python_of(ROOT / "docs/python.md", "st.fit_decay("), {"st": st})
    assert "the damping ratio is 1 ±" in capsys.readouterr().out


def test_a_twin_runs_without_a_server(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(python_of(ROOT / "docs/python.md", "st.Twin("), {"st": st})
    assert Path("twin.png").exists()
    assert "value" in capsys.readouterr().out


@pytest.mark.long
def test_a_model_is_simulated_and_diagnosed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("rig.yaml").write_text(RIG)
    model = st.Model.from_file("rig.yaml")
    for seed, name in enumerate(("forces", "low", "high", "other")):
        t = np.arange(3000) / 100.0
        force = 20.0 * np.random.default_rng(seed).standard_normal(len(t))
        x = st.simulate(model, {"u": force}, rate_hz=100.0).samples[:, 0]
        x = x + 1e-3 * x.std() * np.random.default_rng(9 + seed).standard_normal(len(t))
        columns = [t, force, x]
        np.savetxt(
            f"{name}.csv", np.stack(columns, 1), delimiter=",", header="t,u,x", comments=""
        )
    exec(python_of(ROOT / "docs/python.md", "st.diagnose("), {"st": st})
    assert "nothing missing" in capsys.readouterr().out
    assert Path("found/report.html").exists()

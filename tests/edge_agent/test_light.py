"""An edge agent beside a sensor imports what it runs, and nothing else."""

import subprocess
import sys

import numpy as np
import pytest

NEVER = (
    "fastapi", "h5py", "mcap", "numba", "plotly", "rich", "scipy.interpolate", "scipy.signal",
    "scipy.stats", "slowtime.dynamics", "slowtime_services.models",
    "slowtime_services.simulate", "twin_server", "uvicorn", "yaml",
)  # fmt: skip

RUN = """
import sys, threading
from edge_agent.__main__ import run
from edge_agent.settings import EdgeSettings
from slowtime_services.bus import MemoryBus

class Told(MemoryBus):
    def publish(self, key, *given, **named):
        print(key)
        return super().publish(key, *given, **named)

run(
    EdgeSettings(
        input={"kind": "file", "path": sys.argv[1], "rate_hz": 100.0, "start_ns": 10**18},
        condition={"highpass_hz": 0.5, "decimate": 2},
        extract={"method": sys.argv[2], "window_s": 30.0},
        spool={"folder": "spool"},
        publish={"linger_s": 0.0},
    ),
    bus=Told(),
    stop=threading.Event(),
)
print("imported", *sys.modules)
"""


@pytest.mark.parametrize(
    "method",
    [
        "auto",
        *(pytest.param(m, marks=pytest.mark.long) for m in ("free_decay", "peak", "modes")),
    ],
)
def test_an_edge_over_a_file_has_not_imported_what_it_does_not_run(method, tmp_path):
    rng = np.random.default_rng(5)
    ringing = np.exp(-0.25 * np.arange(800) / 100) * np.sin(
        2 * np.pi * 4 * np.arange(800) / 100
    )
    heard = np.convolve(rng.standard_normal(7000), ringing)[:7000, None] * [1.0, 0.5]
    np.save(tmp_path / "a.npy", heard + 0.1 * rng.standard_normal(heard.shape))
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(tmp_path / "a.npy"), method],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    *keys, last = done.stdout.splitlines()
    assert any("features" in key for key in keys), done.stderr
    imported = set(last.split()[1:])
    assert "slowtime.identification.single_mode.estimation" in imported
    assert [name for name in NEVER if name in imported] == []


def test_settings_of_a_simulated_structure_say_where_they_are_wrong():
    from edge_agent.settings import EdgeSettings

    with pytest.raises(ValueError, match=r"oscillator\.rate_hz=-1.0: Input should be greater"):
        EdgeSettings(input={"kind": "simulated", "structure": {"rate_hz": -1.0}})

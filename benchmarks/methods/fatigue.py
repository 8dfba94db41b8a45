"""Rainflow beside other libraries, and what fatigue and virtual sensors cost at the edge.

``python -m benchmarks.methods.fatigue``; libraries that are not installed are left out. Ratios
are of processor time in the same run: over one pass of NumPy over the same array (the sum of
absolute differences), and of the edge over the length of the record.
"""

import importlib
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from edge_agent.__main__ import run
from edge_agent.settings import EdgeSettings
from slowtime.fatigue.cycles import rainflow
from slowtime_services.bus import MemoryBus
from slowtime_services.models import ambient_model, read_description

SAMPLES = 1_000_000
SECONDS, RATE_HZ = 600, 200.0
MOST_SHARE = 0.02
"""Share of a core that fatigue may cost at the edge."""
MODEL = """\
slowtime_model: 1
nodes: [{id: f1, mass_kg: 2e4}, {id: f2, mass_kg: 2e4}, {id: f3, mass_kg: 2e4}]
elements:
  - {id: k1, between: [base, f1], stiffness_n_per_m: 4e7, damping_n_s_per_m: 6e4}
  - {id: k2, between: [f1, f2], stiffness_n_per_m: 4e7, damping_n_s_per_m: 6e4}
  - {id: k3, between: [f2, f3], stiffness_n_per_m: 4e7, damping_n_s_per_m: 6e4}
sensors:
  - {channel: a1, quantity: acceleration, node: f1, unit: m/s^2, noise_sd: 1e-3}
  - {channel: a2, quantity: acceleration, node: f2, unit: m/s^2, noise_sd: 1e-3}
  - {channel: a3, quantity: acceleration, node: f3, unit: m/s^2, noise_sd: 1e-3}
tolerance: {stiffness: 0.05, damping: 0.3, mass: 0.02}
"""


def seconds(function: Callable[[], Any], times: int = 3) -> float:
    """Least processor time of some runs [s]."""
    took = []
    for _ in range(times):
        began = time.process_time()
        function()
        took.append(time.process_time() - began)
    return min(took)


def others() -> dict[str, Callable[[np.ndarray], Any]]:
    """Counters of other libraries that are installed."""
    found: dict[str, Callable[[np.ndarray], Any]] = {}
    try:
        theirs = importlib.import_module("rainflow")
        found["rainflow"] = lambda series: list(theirs.extract_cycles(series))
    except ImportError:
        pass
    try:
        fatpack = importlib.import_module("fatpack")
        found["fatpack"] = lambda series: fatpack.find_rainflow_cycles(
            fatpack.find_reversals(series)[0]
        )
    except ImportError:
        pass
    return found


def counting() -> None:
    """Print how long a million samples take."""
    white = np.random.default_rng(0).standard_normal(SAMPLES)
    ringing = np.exp(-np.arange(200) / 60) * np.sin(0.3 * np.arange(200))
    series = {
        "white noise": white,
        "one mode": np.convolve(white, ringing, "same"),
        "random walk": np.cumsum(white),
    }
    print("| a million samples of | samples/s | over a NumPy pass |", end="")
    print("".join(f" {name} over ours |" for name in others()))
    print("|---" * (3 + len(others())) + "|")
    for name, values in series.items():
        ours = seconds(lambda values=values: rainflow(values))  # type: ignore[misc]
        one_pass = seconds(lambda v=values: np.abs(np.diff(v)).sum(), 9)  # type: ignore[misc]
        cells = [f"{SAMPLES / ours:.3g}", f"{ours / one_pass:.0f}"]
        cells += [
            f"{seconds(lambda c=count, v=values: c(v), 1) / ours:.1f}"  # type: ignore[misc]
            for count in others().values()
        ]
        print(f"| {name} | " + " | ".join(cells) + " |")


def edge() -> float:
    """Share of a core that virtual stress and its fatigue cost, of 3 channels at 200 Hz."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "frame.yaml").write_text(MODEL)
        heard = ambient_model(
            read_description(folder / "frame.yaml"), round(SECONDS * RATE_HZ), RATE_HZ, 1,
            force_psd=1e5,
        )  # fmt: skip
        rows = np.stack(list(heard.values()), axis=1)
        rng = np.random.default_rng(2)
        np.save(folder / "a.npy", rows + 1e-3 * rng.standard_normal(rows.shape))
        common: dict[str, Any] = {
            "input": {
                "kind": "file", "path": folder / "a.npy", "rate_hz": RATE_HZ,
                "start_ns": 10**18, "columns": ("a1", "a2", "a3"), "units": ("m/s^2",),
                "block_s": 0.5,
            },
            "extract": {"method": "peak", "window_s": float(SECONDS)},
            "spool": {"folder": folder / "spool"},
            "publish": {"linger_s": 0.0},
        }  # fmt: skip
        stress = {"name": "k1.stress", "quantity": "force", "element": "k1", "factor": 2e-5,
                  "unit": "MPa"}  # fmt: skip
        more: dict[str, Any] = {
            "virtual": {"model": folder / "frame.yaml", "outputs": [stress]},
            "fatigue": {"points": [{"at": "k1.stress", "detail_category": 71.0}]},
        }

        def agent(**given: Any) -> None:
            run(EdgeSettings(**common, **given), bus=MemoryBus(), stop=threading.Event())

        without = seconds(agent, 2)
        return (seconds(lambda: agent(**more), 2) - without) / SECONDS


def main() -> int:
    """Print both; 1 where the edge costs more than it may."""
    counting()
    share = edge()
    print(
        f"\nVirtual stress and its fatigue, 3 channels at {RATE_HZ:g} Hz: {100 * share:.2f} % "
        f"of a core (at most {100 * MOST_SHARE:g} %)."
    )
    return int(share > MOST_SHARE)


if __name__ == "__main__":
    raise SystemExit(main())

"""Two reduced substructures on twelve joints, one of which has a gap or rubs.

Run `python -m benchmarks.methods.jointed_substructures [--effects gap_symmetric coulomb]
[--seeds 2]`. Two grids of beams, 2160 degrees of freedom together, are joined by twelve upright
springs and reduced; one joint has an effect that the model lacks, and accelerations with 1 %
noise and one measured force are diagnosed. Prints how often the effect was named at its joint,
and the time of a diagnosis beside that of a chain of five masses with as many samples.
"""

import argparse
import contextlib
import io
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.signal

from slowtime_cli.__main__ import main as command

ACROSS, ALONG, SPACING_M = 13, 14, 0.5
JOINTS = tuple((i, j) for i in (1, 6, 11) for j in (1, 5, 8, 12))
"""Places of the twelve joints in the grids."""

JOINT_N_PER_M, JOINT_N_S_PER_M = 1.0e5, 100.0
RATE_HZ, SAMPLES, BAND_HZ = 200.0, 3000, (2.0, 14.0)
NOISE = 0.01
"""Standard deviation of the noise over that of a channel [1]."""

EFFECTS: dict[str, dict[str, float]] = {
    "gap_symmetric": {"kg_n_per_m": 4.0e5, "gap_m": 3.0e-4},
    "coulomb": {"friction_n": 25.0},
}
FORCE_N = 400.0


def grids() -> dict[str, Any]:
    """Model file of two grids of beams, one above the other."""
    nodes: list[dict[str, Any]] = []
    elements: list[dict[str, Any]] = []
    for level, height in (("lower", 0.0), ("upper", 1.0)):
        for i in range(ACROSS):
            for j in range(ALONG):
                at = [SPACING_M * i, SPACING_M * j, height]
                nodes.append({"id": f"{level} {i}.{j}", "at": at})
                for k, m in ((i + 1, j), (i, j + 1)):
                    if k < ACROSS and m < ALONG:
                        ends = [f"{level} {i}.{j}", f"{level} {k}.{m}"]
                        elements.append(
                            {"id": f"{level} {i}.{j} to {k}.{m}", "between": ends,
                             "section": "pipe", "material": "steel", "theory": "euler"}
                        )  # fmt: skip
    for place in (f"upper 0.{ALONG - 1}", f"upper {ACROSS - 1}.0"):
        elements.append(
            {"id": f"guide {place}", "kind": "spring", "between": ["base", place],
             "translation_n_per_m": [1.0e7, 1.0e7, 0.0]}
        )  # fmt: skip
    corners = [(0, 0), (0, ALONG - 1), (ACROSS - 1, 0), (ACROSS - 1, ALONG - 1)]
    return {
        "slowtime_model": 2,
        "name": "two grids",
        "frame": {
            "materials": [{"id": "steel", "young_pa": 2.1e11, "density_kg_m3": 7850.0}],
            "sections": [{"id": "pipe", "shape": "tube", "diameter_m": 0.1, "wall_m": 0.004}],
            "nodes": nodes,
            "elements": elements,
            "supports": [{"node": f"lower {i}.{j}"} for i, j in corners],
        },
        "joints": [
            {"id": f"joint {i}.{j}", "between": [f"lower {i}.{j}", f"upper {i}.{j}"],
             "direction": "uz", "stiffness_n_per_m": JOINT_N_PER_M,
             "damping_n_s_per_m": JOINT_N_S_PER_M}
            for i, j in JOINTS
        ],
        "inputs": [
            {"channel": "f", "kind": "force", "node": "upper 4.3", "direction": "uz",
             "unit": "N", "hold": "first"}
        ],
        "sensors": [
            {"channel": f"{level[0]}{i}.{j}", "node": f"{level} {i}.{j}", "direction": "uz"}
            for level in ("lower", "upper")
            for i, j in ((2, 2), (6, 6), (10, 3), (3, 11))
        ],
        "tolerance": {"stiffness": 0.02, "damping": 0.2, "mass": 0.0},
        "band_hz": BAND_HZ[1],
    }  # fmt: skip


def chain() -> dict[str, Any]:
    """Model file of five masses on springs, with as many samples."""
    names = ["base", *(f"m{k}" for k in range(1, 6))]
    return {
        "slowtime_model": 1,
        "nodes": [{"id": name, "mass_kg": 40.0} for name in names[1:]],
        "elements": [
            {"id": f"j{k}", "between": names[k - 1 : k + 1], "stiffness_n_per_m": 4.0e5,
             "damping_n_s_per_m": 60.0}
            for k in range(1, 6)
        ],
        "inputs": [
            {"channel": "f", "kind": "force", "node": "m3", "unit": "N", "hold": "first"}
        ],
        "sensors": [
            {"channel": f"a{k}", "quantity": "acceleration", "node": f"m{k}", "unit": "m/s^2"}
            for k in range(1, 6)
        ],
        "tolerance": {"stiffness": 0.02, "damping": 0.2},
    }  # fmt: skip


def diagnosed(
    model: dict[str, Any], effect: dict[str, Any], seed: int, folder: Path
) -> tuple[dict[str, Any], float]:
    """Simulate a model with an effect, and diagnose its noisy records without it.

    Parameters
    ----------
    model
        Content of a model file.
    effect
        What it lacks.
    seed
        Of force and noise.
    folder
        Where files are written.

    Returns
    -------
    The report, and the time that the diagnosis took [s].
    """
    (folder / "given.json").write_text(json.dumps(model))
    (folder / "truth.json").write_text(json.dumps(model | {"effects": [effect]}))
    rng = np.random.default_rng(seed)
    band = scipy.signal.butter(4, BAND_HZ, "band", fs=RATE_HZ, output="sos")
    force = FORCE_N * scipy.signal.sosfilt(band, rng.standard_normal(SAMPLES))
    np.savez(folder / "in.npz", f=force, rate_hz=RATE_HZ)
    _run("simulate", "--model", folder / "truth.json", "--input", folder / "in.npz", "--out",
         folder / "y.npz")  # fmt: skip
    with np.load(folder / "y.npz") as clean:
        noisy = {
            one["channel"]: clean[one["channel"]]
            + NOISE * clean[one["channel"]].std() * rng.standard_normal(SAMPLES)
            for one in model["sensors"]
        }
    np.savez(folder / "record.npz", f=force, rate_hz=RATE_HZ, **noisy)
    begin = time.perf_counter()
    _run("diagnose", folder / "given.json", folder / "record.npz", "--out", folder / "found")
    seconds = time.perf_counter() - begin
    return json.loads((folder / "found/report.json").read_text()), seconds


def _run(*arguments: object) -> None:
    """Run the command within this process; its tables are not shown."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        command([str(one) for one in arguments])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; return 1 where an effect was not named at its joint."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effects", nargs="+", choices=list(EFFECTS), default=list(EFFECTS))
    parser.add_argument("--seeds", type=int, default=2)
    given = parser.parse_args(arguments)
    right, total = 0, 0
    for name in given.effects:
        for seed in range(given.seeds):
            place = JOINTS[(5 + 7 * seed) % len(JOINTS)]
            at = f"joint {place[0]}.{place[1]}"
            with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
                effect = {"effect": name, "element": at, **EFFECTS[name]}
                report, seconds = diagnosed(grids(), effect, seed, Path(one))
                _, beside = diagnosed(chain(), effect | {"element": "j3"}, seed, Path(two))
            said = [(found["effect"], found["where"]["id"]) for found in report["effects"]]
            good = (name, at) in said
            right, total = right + good, total + 1
            print(f"{name} at {at}, seed {seed}: {'named' if good else said}, {seconds:.0f} s, "
                  f"{seconds / beside:.1f} times a chain", flush=True)  # fmt: skip
    print(f"named at its joint in {right} of {total}")
    return 0 if right == total else 1


if __name__ == "__main__":
    sys.exit(main())

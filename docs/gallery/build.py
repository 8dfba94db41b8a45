"""Hide an effect, diagnose it by the command, keep the picture: ``make gallery``.

Each case is a folder below ``var/gallery``: what is there, what is believed, three records, and
what ``slowtime diagnose`` made of them. ``docs/gallery`` keeps a picture of each and an index.
"""

import argparse
import dataclasses
import json
import pathlib
import subprocess
import sys
import time
import tomllib
from typing import Any

import matplotlib as mpl
import numpy as np
from PIL import Image

mpl.use("Agg")
import matplotlib.pyplot as plt

from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring, Tolerance
from slowtime_services.models import run_model, write_model

HERE = pathlib.Path(__file__).parent
STYLE = HERE.parent / "figures/chapter_5.mplstyle"
RATE_HZ, SECONDS = 100.0, 20.0
LEVELS = {"low": 0.4, "high": 1.0, "other": 0.8}
"""Records by name, and how hard the rig is shaken; the last is held out."""
NOISE = {"x1": 2e-5, "a1": 0.05, "a2": 0.05}
COLOURS = 24
"""That a picture keeps: a third of the bytes."""
GREY, RED, YELLOW, BLUE = "#8a97a6", "#c4572a", "#c99a2e", "#0b6e99"

Array = np.ndarray[Any, np.dtype[np.float64]]


def rig(stiffer: float = 1.0) -> Description:
    """Two masses on two springs, pushed at the first, heard by three sensors."""
    return Description(
        name="rig of the gallery",
        nodes=(Node(id="m1", mass_kg=2.0), Node(id="m2", mass_kg=1.5)),
        elements=(
            Spring(
                id="j0", between=("base", "m1"),
                stiffness_n_per_m=4000.0 * stiffer, damping_n_s_per_m=3.0,
            ),
            Spring(
                id="j1", between=("m1", "m2"),
                stiffness_n_per_m=3000.0, damping_n_s_per_m=2.0,
            ),
        ),
        inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
        sensors=(
            Sensor(
                channel="x1", quantity="displacement", node="m1",
                frame="relative_to_base", unit="m",
            ),
            Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),
            Sensor(channel="a2", quantity="acceleration", node="m2", unit="m/s^2"),
        ),
        tolerance=Tolerance(stiffness=0.01, damping=0.1),
    )  # fmt: skip


def measure(folder: pathlib.Path, hidden: dict[str, Any] | None, seed: int) -> None:
    """Write the model that is believed, and records of what is there."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = dataclasses.replace(rig(), effects=(hidden,) if hidden else ())
    write_model(folder / "truth.yaml", truth)
    write_model(folder / "model.yaml", rig(1.005))
    rng = np.random.default_rng(seed)
    # A sensor clips once: what it hears, noise and all.
    clips = hidden is not None and hidden["effect"] == "sensor_saturation"
    clip = hidden["clip"] if hidden and clips else np.inf
    moves = dataclasses.replace(truth, effects=()) if clips else truth
    count = int(SECONDS * RATE_HZ)
    lines = np.fft.rfftfreq(count, 1 / RATE_HZ)
    inside = (lines > 0.5) & (lines < 20.0)
    for number, (name, level) in enumerate(LEVELS.items()):
        push = np.fft.irfft(inside * np.exp(2j * np.pi * rng.random(len(lines))))
        push *= 10.0 * level / push.std()
        start = 100.0 * number
        heard = run_model(moves, {"u": push}, RATE_HZ, hold="band_limited", start_s=start)
        arrays: dict[str, Any] = {"t": start + np.arange(count) / RATE_HZ, "u": push}
        for channel, series in heard.items():
            noisy = series + NOISE[channel] * rng.standard_normal(count)
            arrays[channel] = np.clip(noisy, -clip, clip) if channel == "a2" else noisy
        np.savez(folder / f"{name}.npz", **arrays)


def diagnose(folder: pathlib.Path) -> None:
    """Run the command as anybody would."""
    *learnt, judged = (f"{name}.npz" for name in LEVELS)
    words = ["diagnose", "model.yaml", *learnt, "--holdout", judged, "--out", "found"]
    subprocess.run([sys.executable, "-m", "slowtime_cli", *words], cwd=folder, check=True)


def picture(folder: pathlib.Path, out: pathlib.Path) -> None:
    """Draw the gap, what the models say, what they leave, and the force recovered."""
    report = json.loads((folder / "found/report.json").read_text())
    with np.load(folder / "found/holdout.npz") as runs, plt.style.context(str(STYLE)):
        figure, ((a, b), (c, d)) = plt.subplots(2, 2, figsize=(8.4, 4.6), layout="constrained")
        _gap(a, report["gap"])
        _runs(b, runs)
        _left(c, runs)
        _force(d, folder / "found/surface.npz")
        figure.savefig(out, dpi=80)
        plt.close(figure)
    with Image.open(out) as drawn:
        small = drawn.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(out, optimize=True)


def _gap(axes: Any, gap: dict[str, Any]) -> None:
    named = [(step["effect"].replace("_", " "), step["nrmse"], BLUE) for step in gap["steps"]]
    bars = [
        ("as given", gap["nominal"], RED),
        ("refitted", gap["refitted_nominal"], YELLOW),
        *named,
        ("noise alone", gap["noise_floor"], GREY),
    ]
    heights = [100 * value for _, value, _ in bars]
    places = np.arange(len(bars))
    axes.bar(places, heights, color=[colour for _, _, colour in bars])
    for place, height in zip(places, heights, strict=True):
        axes.annotate(
            f"{height:.0f}" if height >= 10 else f"{height:.2g}",
            (float(place), height),
            ha="center",
            va="bottom",
        )
    axes.set_yscale("log")
    axes.set_axisbelow(True)
    axes.set_ylim(min(heights) / 2, 3 * max(heights))
    axes.set_xticks(places, [name for name, _, _ in bars], rotation=12)
    axes.set_title("error of the free run on the record held out [%]")


def _runs(axes: Any, runs: Any) -> None:
    column = runs["channels"].tolist().index("a2")
    times, measured = runs["t"] - runs["t"][0], runs["measured"][:, column]
    part = slice(*(int(RATE_HZ * s) for s in (6.0, 9.0)))
    for name, colour, label in (
        ("measured", GREY, "measured"), ("nominal", RED, "as given"),
        ("augmented", BLUE, "augmented"),
    ):  # fmt: skip
        series = measured if name == "measured" else runs[name][:, column]
        wide = 2.6 if name == "measured" else 1.1
        axes.plot(times[part], series[part], color=colour, lw=wide, label=label)
    axes.legend(ncols=3, loc="upper right")
    axes.set_title("acceleration of m2 [m/s²], over time [s]")


def _left(axes: Any, runs: Any) -> None:
    column = runs["channels"].tolist().index("a2")
    for name, colour, label in (
        ("refitted_nominal", YELLOW, "left by the refitted model"),
        ("augmented", BLUE, "by the augmented model"),
    ):
        left = runs["measured"][:, column] - runs[name][:, column]
        power = np.abs(np.fft.rfft(left * np.hanning(len(left)))) ** 2
        lines = np.fft.rfftfreq(len(left), 1 / RATE_HZ)[: len(power) // 8 * 8]
        smooth = power[: len(lines)].reshape(-1, 8).mean(axis=1)
        axes.semilogy(lines.reshape(-1, 8).mean(axis=1), smooth, color=colour, label=label)
    axes.legend(loc="upper right")
    axes.set_title("spectrum of what is left of it, over frequency [Hz]")


def _force(axes: Any, path: pathlib.Path) -> None:
    if not path.exists():
        axes.set_axis_off()
        return
    with np.load(path) as found:
        stride = max(len(found["e"]) // 1200, 1)
        motion, unit = (found["v"], "its speed [m/s]") if _by_speed(found) else (
            1e3 * found["e"], "stretch or displacement [mm]"
        )  # fmt: skip
        axes.plot(motion[::stride], found["force"][::stride], ".", color=GREY, ms=2.5)
        if "law" in found:
            axes.plot(motion[::stride], found["law"][::stride], ".", color=BLUE, ms=2.5)
        place = str(found["place"])
    axes.set_title(f"force that was missing at {place} [N]")
    axes.set_xlabel(unit)


def _by_speed(found: Any) -> bool:
    """Whether the force goes with the rate rather than with the motion itself."""
    force, e, v = (np.argsort(np.argsort(found[name])) for name in ("force", "e", "v"))
    return bool(abs(np.corrcoef(force, v)[0, 1]) > abs(np.corrcoef(force, e)[0, 1]))


def index(intro: str, rows: list[tuple[dict[str, Any], dict[str, Any]]]) -> str:
    """Write the page that shows all cases."""
    lines = [
        *intro.strip().splitlines(),
        "",
        "| hidden | named | probability | error: given → refitted → augmented (noise alone) |",
        "|---|---|---|---|",
    ]
    for case, report in rows:
        gap = report["gap"]
        named = [f"{e['effect']} at {e['where']['id']}" for e in report["effects"]]
        word = ", ".join(named) or report["verdict"].replace("_", " ")
        if report["verdict"] == "undecided":
            word = "undecided: " + ", ".join(r["effect"] for r in report["undecided"])
        chance = ", ".join(f"{e['probability']:.2f}" for e in report["effects"]) or "–"
        hidden = case.get("hidden", {}).get("effect", "nothing")
        errors = " → ".join(
            f"{100 * gap[key]:.3g}" for key in ("nominal", "refitted_nominal", "augmented")
        )
        floor = 100 * gap["noise_floor"]
        lines.append(
            f"| [{hidden}](#{case['name']}) | {word} | {chance} | {errors} % ({floor:.2g} %) |"
        )
    for case, report in rows:
        lines += [
            "",
            f"## {case['name']}",
            "",
            case["words"],
            "",
            f"> {report['sentence']}",
            "",
        ]
        lines.append(f"![{case['words']}]({case['name']}.png)")
    return "\n".join(lines) + "\n"


def main(words: list[str] | None = None) -> None:
    """Build all of it, or the cases that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", help="only these; the index is left alone")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("var/gallery"))
    given = parser.parse_args(words)
    told = tomllib.loads((HERE / "cases.toml").read_text())
    rows = []
    for seed, case in enumerate(told["case"]):
        if given.cases and case["name"] not in given.cases:
            continue
        begun, folder = time.monotonic(), given.work / case["name"]
        measure(folder, case.get("hidden"), seed)
        diagnose(folder)
        picture(folder, HERE / f"{case['name']}.png")
        rows.append((case, json.loads((folder / "found/report.json").read_text())))
        print(f"{case['name']}: {time.monotonic() - begun:.0f} s", flush=True)
    if not given.cases:
        (HERE / "README.md").write_text(index(told["intro"], rows), encoding="utf-8")


if __name__ == "__main__":
    main()

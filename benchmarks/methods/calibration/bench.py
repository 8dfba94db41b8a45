"""Ask the twin's forecast, and an oracle, of histories of known laws; score both.

`python -m benchmarks.methods.calibration --results FILE` goes on where FILE ends. With
`--reuse OTHER` the oracle's answers come from the results of another version, with which they
are compared.
"""

import argparse
import dataclasses
import json
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from twin_server.estimate.forecast import changes, statements
from twin_server.registration.thresholds import Limit

from . import histories, oracle
from .histories import INSTANTS, LAWS, InstantCase

TIMES = 10
"""Times between an instant and the end at which bands are asked for."""

SURE = 0.02
"""Probability below which, and above one less which, an answer is sure [1]."""

LEAST = 1e-4
"""Probability at which logarithmic scores are clipped [1]: 2,000 paths tell none below it."""

LEAST_EXCESS = 0.01
"""Excess of a Brier score above which a ratio to it is told [1]: below, it is chance."""

QUANTITY = "stiffness_change"


def judge(
    case: InstantCase, known: dict[str, Any] | None, *, widen: bool = True
) -> dict[str, Any]:
    """Ask both at each instant: probability of the crossing, and bands at ten times.

    Parameters
    ----------
    known
        Result of another version for the same history, whose oracle is taken over.
    widen
        Whether the track record widens the futures. It takes ten times as long as a forecast.
    """
    rows = []
    kept: list[dict[str, Any]] | None = [] if widen else None
    for which, instant in enumerate(INSTANTS):
        readings = int(np.searchsorted(case.time, instant + 1e-12, "right"))
        now = float(case.time[readings - 1])
        at = now + (1.0 - now) * np.arange(1, TIMES + 1) / TIMES
        true = np.interp(at, case.fine, case.truth)
        row: dict[str, Any] = {"now": now, "crossed": bool(case.crossed <= now)}
        row |= _twin(case, readings, at, true, kept)
        if known is None:
            rng = np.random.default_rng([case.number, which])
            futures = oracle.futures(case, readings, rng)
            band = futures.band(at)
            row["oracle"] = futures.probability(case.threshold)
            row["oracle_holds"] = _holds(band, true)
        else:
            row |= {name: known["rows"][which][name] for name in ("oracle", "oracle_holds")}
        rows.append(row)
    return {
        "law": case.law, "number": case.number, "noise": case.sd, "readings": len(case.time),
        "happened": bool(np.isfinite(case.crossed)), "rows": rows,
    }  # fmt: skip


def _holds(band: np.ndarray, true: np.ndarray) -> list[bool]:
    return [bool(low <= x <= high) for (low, high), x in zip(band, true, strict=True)]


def _past(case: InstantCase, readings: int) -> dict[str, changes.Past]:
    when = case.unit * case.time[:readings]
    return {
        QUANTITY: changes.Past(when, case.value[:readings], np.full(readings, case.sd), 0.0)
    }


def _widening(case: InstantCase, readings: int, kept: list[dict[str, Any]]) -> float:
    """Factor of the spread by what came of the statements so far, which are kept first."""
    first = kept[-1]["sequence"] + 1 if kept else 0
    for sequence in range(first, readings - 1):
        if statements.is_due(sequence):
            past = _past(case, sequence + 1)
            state = changes.forecast_state_of(past, changes.learn(past))
            assert state is not None
            kept.append(statements.state_outlook(state, None, ()) | {"sequence": sequence})
    known = statements.truth_of(_past(case, readings))
    score = statements.verify(kept[-statements.KEPT :], known).quantities[QUANTITY]
    return score.widening.factor


def _twin(
    case: InstantCase,
    readings: int,
    at: np.ndarray,
    true: np.ndarray,
    kept: list[dict[str, Any]] | None,
) -> dict[str, Any]:
    """Forecast as the server does, learning from all readings up to now.

    Parameters
    ----------
    kept
        Statements so far, which widen the futures; None where nothing widens them.
    """
    past = _past(case, readings)
    when = past[QUANTITY].slow_time
    begun = time.process_time()
    state = changes.forecast_state_of(past, changes.learn(past))
    assert state is not None
    limit = Limit(QUANTITY, case.threshold, "below")
    horizon = float(case.unit - when[-1])
    bare = changes.forecast_from_state(state, horizon, TIMES, (limit,))
    spent = time.process_time() - begun
    factor = 1.0 if kept is None else _widening(case, readings, kept)
    wider = dataclasses.replace(state, widening={QUANTITY: factor})
    told = (
        bare if kept is None else changes.forecast_from_state(wider, horizon, TIMES, (limit,))
    )
    life, band = told.crossings[0][1], told.bands[QUANTITY]
    # Probability below the true time: of one beyond the end, only the ends are known.
    place = [life.within, 1.0]
    if np.isfinite(case.crossed) and case.crossed > case.time[readings - 1]:
        place = [float(life.cdf(min(case.crossed * case.unit, life.horizon)))] * 2
    return {
        "p": life.within, "place": place, "holds": _holds(band[:, 2:], true),
        "width": float(band[-1, 3] - band[-1, 2]), "seconds": spent, "widening": factor,
        "bare": {
            "p": bare.crossings[0][1].within,
            "holds": _holds(bare.bands[QUANTITY][:, 2:], true),
        },
        "laws": {name: round(share, 3) for name, share in life.weights.items() if share > 0.01},
    }  # fmt: skip


def read(path: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Read results; a line that a killed run has cut short is passed over."""
    found = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            one = json.loads(line)
        except json.JSONDecodeError:
            continue
        found[one["law"], one["number"]] = one
    return found


def keep(result: dict[str, Any], path: Path) -> None:
    """Append a result, on a line of its own after one that a killed run has cut short."""
    cut = path.exists() and not ("\n" + path.read_text()).endswith("\n")
    with path.open("a") as file:
        file.write(("\n" if cut else "") + json.dumps(result) + "\n")


def table(results: Iterable[dict[str, Any]], before: dict[tuple[str, int], Any]) -> str:
    """Write the scores of each law and of all."""
    every = list(results)
    lines = [
        "| law | outlooks | bands hold [%] | at the end | oracle's | Brier score | oracle's "
        "| excess over that before | sure, right | log score over the oracle's [nat] "
        "| life held by 10–90 % [%] | late | early | flicker | at fixed dates "
        "| widened by | bands held without [%] | Brier score without |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    announced = [one for one in every if one["law"] != histories.JUMPS]
    for name, part in [
        *((law, [one for one in every if one["law"] == law]) for law in LAWS),
        ("all but jumps", announced),
        ("all", every),
    ]:
        if part:
            lines.append(_line(name, part, before))
    seconds = [row["seconds"] for one in every for row in one["rows"]]
    lines.append(
        f"\nProcessor time of one forecast: median {np.median(seconds):.3f} s, "
        f"mean {np.mean(seconds):.3f} s, 95 % {np.quantile(seconds, 0.95):.3f} s."
    )
    return "\n".join(lines)


def _line(name: str, part: list[dict[str, Any]], before: dict[tuple[str, int], Any]) -> str:
    asked = [(one, row) for one in part for row in one["rows"] if not row["crossed"]]
    y = np.array([one["happened"] for one, _ in asked], dtype=float)
    p, known = (np.array([row[who] for _, row in asked]) for who in ("p", "oracle"))
    excess = np.mean((p - y) ** 2) - np.mean((known - y) ** 2)
    ratio = ""
    if before:
        old = np.array([_same(before, one, row)["p"] for one, row in asked])
        past = np.mean((old - y) ** 2) - np.mean((known - y) ** 2)
        share = f" = {excess / past:.2f}" if past > LEAST_EXCESS else ""
        ratio = f"{excess:.3f} / {past:.3f}{share}"
    held = np.array([row["holds"] for one in part for row in one["rows"]])
    oracles = np.array([row["oracle_holds"] for one in part for row in one["rows"]])
    sure = (p <= SURE) | (p >= 1.0 - SURE)
    right = int(np.sum(np.abs(p - y)[sure] <= SURE))
    sure_oracle = int(np.sum((known <= SURE) | (known >= 1.0 - SURE)))
    logs = [-np.log(np.clip(np.where(y == 1, q, 1 - q), LEAST, 1)).mean() for q in (p, known)]
    middle, late, early = np.mean([_place(*row["place"]) for _, row in asked], axis=0)
    flicker, fixed = (_interval([of(one) for one in part]) for of in (_flicker, _movement))
    # Results of a version that did not widen have nothing beside.
    bare = [row.get("bare", row) for _, row in asked]
    without = np.array([row.get("bare", row)["holds"] for one in part for row in one["rows"]])
    narrow = np.mean((np.array([row["p"] for row in bare]) - y) ** 2)
    factor = np.mean([row.get("widening", 1.0) for one in part for row in one["rows"]])
    return (
        f"| {name} | {len(asked)} | {100 * held.mean():.1f} | {100 * held[:, -1].mean():.1f} "
        f"| {100 * oracles.mean():.1f} | {np.mean((p - y) ** 2):.3f} "
        f"| {np.mean((known - y) ** 2):.3f} | {ratio} "
        f"| {right} of {int(sure.sum())} (oracle {sure_oracle}) | {logs[0] - logs[1]:.2f} "
        f"| {100 * middle:.1f} | {100 * late:.1f} | {100 * early:.1f} "
        f"| {flicker} | {fixed} | {factor:.2f} | {100 * without.mean():.1f} | {narrow:.3f} |"
    )


def _interval(values: list[float]) -> str:
    """Mean of independent values with the half width of its 95 % interval."""
    error = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return f"{np.mean(values):+.3f} ± {1.96 * error:.3f}"


def _same(before: dict[tuple[str, int], Any], one: Any, row: Any) -> Any:
    rows = before[one["law"], one["number"]]["rows"]
    return next(each for each in rows if each["now"] == row["now"])


def _place(low: float, high: float) -> tuple[float, float, float]:
    """Share of an interval of probability in the middle 80 %, below (late) and above."""
    if low == high:
        return float(0.1 <= low <= 0.9), float(low < 0.1), float(low > 0.9)
    inside = np.clip([0.1, 0.9], low, high)
    width = high - low
    return tuple(np.array([np.diff(inside)[0], inside[0] - low, high - inside[1]]) / width)


def _flicker(one: dict[str, Any]) -> float:
    """Movement of a probability less what evidence accounts for: zero on average.

    References
    ----------
    .. [1] N. Augenblick and M. Rabin, "Belief movement, uncertainty reduction, and rational
       updating" (2021).
    """
    p = np.append(_told(one), float(one["happened"]))
    return float(np.sum(np.diff(p) ** 2) - p[0] * (1.0 - p[0]))


def _movement(one: dict[str, Any]) -> float:
    r"""Movement of a probability between fixed dates, less the uncertainty that it resolves.

    Of a martingale, the mean of :math:`\sum (\Delta p)^2 - p_0 (1 - p_0) + p_T (1 - p_T)` is
    zero, whatever comes after the last date :math:`T`: increments are uncorrelated, so that
    :math:`\operatorname{E} \sum (\Delta p)^2 = \operatorname{E}[p_T^2 - p_0^2]`.
    """
    p = _told(one)
    left = p * (1.0 - p)
    return float(np.sum(np.diff(p) ** 2) - left[0] + left[-1])


def _told(one: dict[str, Any]) -> np.ndarray:
    return np.array([1.0 if row["crossed"] else row["p"] for row in one["rows"]])


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, help="file of results to go on with")
    parser.add_argument(
        "--reuse", type=Path, help="results of another version, to compare with"
    )
    parser.add_argument("--histories", type=int, default=45, help="of each law")
    parser.add_argument("--laws", nargs="*", default=list(LAWS), choices=LAWS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--no-widening", action="store_true", help="leave out the track record, which is slow"
    )
    asked = parser.parse_args(arguments)
    before = read(asked.reuse) if asked.reuse else {}
    found = read(asked.results) if asked.results else {}
    wanted = [(law, number) for number in range(asked.histories) for law in asked.laws]
    for law, number in wanted:
        if (law, number) not in found:
            case = histories.case(law, number, asked.seed)
            known = before.get((law, number))
            found[law, number] = judge(case, known, widen=not asked.no_widening)
            if asked.results:
                keep(found[law, number], asked.results)
    shown = [found[key] for key in wanted]
    print(table(shown, before if all(key in before for key in wanted) else {}))
    return 0

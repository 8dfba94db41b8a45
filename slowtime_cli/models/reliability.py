"""The verb `reliability`: compares failure probabilities by several methods."""

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from slowtime.reliability import DesignPoint, Problem, Result
from slowtime_api.probabilities.reliability_methods import Method, failure_probability
from slowtime_cli.shared.report_flags import report_language, report_subject
from slowtime_cli.shared.terminal import note, show
from slowtime_services.reports.kinds.reliability import write_reliability_report

COLUMNS = ("method", "P_f [1]", "95 % interval [1]", "beta [1]", "c.o.v. [%]", "calls [1]")
BY_DEFAULT: tuple[Method, ...] = ("form", "importance", "subset")
"""Methods where none is named, as the help of the verb says."""
MAX_POINTS = 5
"""Design points that a terminal lists [1]; JSON holds all."""


def reliability(
    problem: Path,
    limit_state: Path | None,
    methods: Sequence[Method],
    variation: float,
    calls: int,
    seed: int,
    as_json: bool,
    report: Path | None,
) -> None:
    """Apply each method in turn, and print the results.

    Raises
    ------
    ValueError
        Where no method could be applied.
    """
    answer = failure_probability(
        problem, methods or BY_DEFAULT, limit_state=limit_state, variation=variation,
        calls=calls,
        seed=seed,
    )  # fmt: skip
    read, stated, found = answer.problem, answer.stated, answer.results
    refused = answer.refused
    if report is not None:
        stated = dataclasses.replace(stated, name=report_subject() or stated.name)
        write_reliability_report(
            report, problem.name, read, found, refused, seed=seed, stated=stated,
            language=report_language(),
        )  # fmt: skip
    if as_json:
        body = {
            "inputs": list(read.names),
            "seed": seed,
            "results": [as_object(result, read) for result in found],
            "refused": refused,
        }
        click.echo(json.dumps(body, indent=1, allow_nan=False))
        return
    _show(found, read)
    for method, said in refused.items():
        note(f"{method} cannot be applied: {said}")
    for result in found:
        for warning in result.warnings:
            note(f"{result.method}: {warning}")


def as_object(result: Result, problem: Problem) -> dict[str, Any]:
    """Convert one result to JSON; values that are not finite become null."""
    return {
        "method": result.method,
        "probability": result.probability,
        "interval": None if result.interval is None else list(result.interval),
        "no_interval": result.no_interval or None,
        "beta": _finite(result.beta),
        "variation": _finite(result.variation),
        "calls": result.calls,
        "bounds": None if result.bounds is None else list(result.bounds),
        "design_points": [_point(point, problem) for point in result.design_points],
        "warnings": list(result.warnings),
    }


def _point(point: DesignPoint, problem: Problem) -> dict[str, Any]:
    names = problem.names
    return {
        "beta": point.beta,
        "converged": point.converged,
        "u": dict(zip(names, point.u.tolist(), strict=True)),
        "x": dict(zip(names, point.x.tolist(), strict=True)),
        "alpha": dict(zip(names, point.alpha.tolist(), strict=True)),
        "importance": dict(zip(names, point.importance.tolist(), strict=True)),
        "mean_sensitivity": dict(point.mean_sensitivity),
        "sd_sensitivity": dict(point.sd_sensitivity),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _show(found: Sequence[Result], problem: Problem) -> None:
    rows, plain = [], []
    for result in found:
        interval = "none: " + result.no_interval.split(":")[0]
        if result.interval is not None:
            interval = f"{result.interval[0]:.3g} to {result.interval[1]:.3g}"
        share = result.variation
        rows.append(
            (
                result.method,
                f"{result.probability:.3e}",
                interval,
                f"{result.beta:.3f}",
                "" if share is None else f"{100.0 * share:.1f}",
                str(result.calls),
            )
        )
        lo, hi = result.interval or (None, None)
        plain.append(
            {
                "method": result.method,
                "probability": result.probability,
                "lo": lo,
                "hi": hi,
                "beta": _finite(result.beta),
                "variation": _finite(share),
                "calls": result.calls,
                "warnings": len(result.warnings),
            }
        )
    show("Probability of failure", COLUMNS, rows, plain=plain)
    with_points = next((result for result in found if result.design_points), None)
    if with_points is not None:
        _show_points(with_points.design_points, problem)
    for result in found:
        if result.bounds is not None:
            lo, hi = result.bounds
            note(f"{result.method}: bounds of the linearised system {lo:.4g} to {hi:.4g}.")


def _show_points(points: Sequence[DesignPoint], problem: Problem) -> None:
    """Design points, one row an input; lines of a program have them under a heading again."""
    rows, plain = [], []
    for number, point in enumerate(points[:MAX_POINTS], start=1):
        for k, name in enumerate(problem.names):
            mean, sd = point.mean_sensitivity.get(name), point.sd_sensitivity.get(name)
            rows.append(
                (
                    str(number),
                    f"{point.beta:.3f}",
                    name,
                    f"{point.x[k]:.5g}",
                    f"{point.alpha[k]:+.3f}",
                    f"{100.0 * point.importance[k]:.1f}",
                    "" if mean is None else f"{mean:+.3g}",
                    "" if sd is None else f"{sd:+.3g}",
                )
            )
            plain.append(
                {
                    "design_point": number,
                    "beta": point.beta,
                    "input": name,
                    "x": float(point.x[k]),
                    "alpha": float(point.alpha[k]),
                    "importance": float(point.importance[k]),
                    "mean_sensitivity": mean,
                    "sd_sensitivity": sd,
                }
            )
    columns = (
        "point #", "beta [1]", "input", "x*", "alpha [1]", "importance [%]", "dbeta/dmean",
        "dbeta/dsd",
    )  # fmt: skip
    click.echo()
    show("Design points", columns, rows, plain=plain)

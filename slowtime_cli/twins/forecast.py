"""The verb `forecast`: predicts the changes of a twin and when thresholds are crossed."""

from pathlib import Path
from typing import Any, Literal

from slowtime_cli.shared.options import STDOUT
from slowtime_cli.shared.terminal import note, show, write_json
from slowtime_cli.twins.twin_query import TwinQuery, ask_server, without_none
from slowtime_schemas.slow_times import unit_in_words

Side = Literal["below", "above"]


def forecast(
    horizon: float | None,
    points: int,
    threshold: float | None,
    quantity: str | None,
    toward: Side | None,
    out: Path | None,
    **twin: Any,
) -> None:
    """Forecast a twin, and when thresholds are reached."""
    asked = TwinQuery(**twin)
    more = {"threshold": threshold, "quantity": quantity, "toward": toward}
    if asked.server is not None:
        query = {"horizon": horizon, "points": points, **more}
        body = ask_server(asked, "GET", "forecast", query=query)
    else:
        from twin_server.serve import foretell

        from .file_twin import problems_told, twin_of_file

        with twin_of_file(asked) as (knowledge, twin_id, registration), problems_told():
            body = foretell(
                knowledge, twin_id, registration, horizon, points,
                threshold=threshold, quantity=quantity, toward=toward,
            )  # fmt: skip
    if out is not None:
        write_json(out, body)
    if out != STDOUT:
        _show_forecast(body)
    for reason in body["reasons"]:
        note(reason)
    for warning in body.get("warnings", ()):
        note(warning)
    for crossing in body["crossings"] if out != STDOUT else ():
        note(crossing["sentence"])
        if laws := _laws(crossing.get("laws", {})):
            note(f"degradation laws by evidence: {laws}.")
        if record := crossing.get("record"):
            note(_record(record))
    for said in body.get("record", ()) if out != STDOUT else ():
        note(said)


def _record(one: dict[str, Any]) -> str:
    """Say what came of past statements like one."""
    return (
        f"Of {one['count']} past statements like this ({100 * one['low']:.0f} to "
        f"{100 * one['high']:.0f} %), {one['came_true']} came true; as they overlap, such "
        f"statements come true in {100 * one['lo']:.0f} to {100 * one['hi']:.0f} % of cases."
    )


def _laws(weights: dict[str, float]) -> str:
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in weights.items())


def _show_forecast(body: dict[str, Any]) -> None:
    rows, plain = [], []
    for point in body["points"]:
        whole = {name: point[name] for name in ("stiffness_change", "mass_change")}
        for name, estimate in {**without_none(whole), **point["elements"]}.items():
            cells = [f"{100 * estimate[part]:.2f}" for part in ("value", "sd", "lo", "hi")]
            rows.append((f"{point['slow_time']:.6g}", name, *cells))
            plain.append({"slow_time": point["slow_time"], "quantity": name, **estimate})
    slow_time = f"slow time [{unit_in_words(body['slow_time_unit'])}]"
    heads = (slow_time, "quantity", "change [%]", "sd [%]", "lo [%]", "hi [%]")
    show("", heads, rows, plain=plain)

"""The verb `risk`: computes the failure probability of a twin for each limit state."""

from pathlib import Path
from typing import Any

from slowtime_cli.shared.options import STDOUT
from slowtime_cli.shared.terminal import note, show, write_json
from slowtime_cli.twins.twin_query import TwinQuery, ask_server


def risk(horizon: float | None, out: Path | None, **twin: Any) -> None:
    """Compute a twin's probability of failure, now and up to the horizon."""
    asked = TwinQuery(**twin)
    if asked.server is not None:
        body = ask_server(asked, "GET", "risk", query={"horizon": horizon})
    else:
        from .file_twin import problems_told, twin_of_file

        with twin_of_file(asked) as (knowledge, twin_id, _), problems_told():
            body = knowledge.risk(twin_id, horizon)
    if out is not None:
        write_json(out, body)
    if out != STDOUT:
        _show(body)
    for one in body["limit_states"]:
        if one["sentence"]:
            note(one["sentence"])
    for reason in body["reasons"]:
        note(reason)


def _show(body: dict[str, Any]) -> None:
    rows, plain = [], []
    for one in body["limit_states"]:
        if one["now"] is None:
            rows.append((one["name"], "", "", "", "", ""))
            plain.append({"limit_state": one["name"], "probability": None})
            continue
        now, within = one["now"]["probability"], one["within"]
        until = one["until"]
        rows.append(
            (
                one["name"],
                f"{now['value']:.2e}",
                f"{now['lo']:.1e} to {now['hi']:.1e}",
                f"{one['now']['beta']:.2f}",
                f"{within['value']:.2e}",
                "" if until is None else f"{until:.6g}",
            )
        )
        plain.append(
            {
                "limit_state": one["name"],
                "probability": now["value"],
                "lo": now["lo"],
                "hi": now["hi"],
                "beta": one["now"]["beta"],
                "within": within["value"],
                "until": until,
            }
        )
    heads = (
        "limit state", "P_f now [1]", "5 % to 95 % [1]", "beta [1]", "P_f to horizon [1]",
        "accepted reached",
    )  # fmt: skip
    show("Failure probability", heads, rows, plain=plain)

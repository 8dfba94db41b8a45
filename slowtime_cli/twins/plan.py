"""The verb `plan`: ranks maintenance options of a twin or a fleet by expected cost."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slowtime_cli.shared.options import STDOUT
from slowtime_cli.shared.report_flags import report_language, report_subject
from slowtime_cli.shared.terminal import note, show, write_json
from slowtime_cli.twins.twin_query import TwinQuery, ask_server
from slowtime_services.client import AnswerError, Client, UnreachableError

if TYPE_CHECKING:
    from twin_server.registration.twin import Registration


def plan(
    fleet: bool,
    teams: int,
    visits: int,
    window_d: float,
    budget: float | None,
    out: Path | None,
    lead_time: float | None,
    months: str | None,
    accepted: float | None,
    report: Path | None,
    **twin: Any,
) -> None:
    """Recommend an action for a twin, or where a fleet's teams should go."""
    asked = TwinQuery(**twin)
    if fleet:
        query = {"teams": teams, "visits": visits, "window_d": window_d, "budget": budget}
        body = _of_fleet(asked.server, query)
        _tell(body, out, _show_fleet)
        for one in body["without"]:
            note(f"{one['id']}: {one['reason']}")
        return
    if asked.server is not None:
        terms = {"lead_time": lead_time, "months": months, "accepted": accepted}
        body = ask_server(asked, "GET", "plan", query=terms)
    else:
        from twin_server.registration.costs import RepairTerms

        from .file_twin import problems_told, twin_of_file

        with twin_of_file(asked) as (knowledge, twin_id, registration), problems_told():
            _refuse_calendar(asked.source, registration)
            try:
                body = knowledge.plan(twin_id, terms=RepairTerms(lead_time, months, accepted))
            except ValueError as error:
                raise click.UsageError(str(error)) from error
    _tell(body, out, _show_plan)
    if report is not None:
        from slowtime_services.reports.kinds.plan import write_plan_report

        write_plan_report(
            report, body, structure=report_subject(),
            source="" if asked.source is None else asked.source.name,
            language=report_language(),
        )  # fmt: skip
    if body["last_order"] is not None:
        note(body["last_order"]["sentence"])
    for change in body["changes"]:
        note(change)


def _refuse_calendar(source: Path | None, registration: "Registration") -> None:
    """Refuse calendar units of a text file, whose slow time has no unit."""
    costs = registration.costs
    text = source is not None and source.suffix.lower() not in (".json", ".mcap")
    if text and costs is not None and costs.time_unit != "slow_time":
        raise click.UsageError(
            f"costs.time_unit is {costs.time_unit!r}, and {source} does not state the "
            "unit of its slow_time. Give costs.time_unit='slow_time', with rates and "
            "times in it."
        )


def _of_fleet(server: str | None, query: dict[str, Any]) -> dict[str, Any]:
    assert server is not None
    try:
        return Client(server, timeout_s=600.0).json("GET", "/fleet/plan", query)
    except (AnswerError, UnreachableError, ValueError) as error:
        raise click.UsageError(str(error)) from error


def _tell(body: dict[str, Any], out: Path | None, table: Any) -> None:
    if out is not None:
        write_json(out, body)
    if out != STDOUT:
        table(body)
    note(body["sentence"])


def _show_plan(body: dict[str, Any]) -> None:
    rows, plain = [], []
    for option in body["options"]:
        cost = option["cost"]
        amounts = [f"{cost[part]:.4g}" for part in ("value", "lo", "hi")]
        rows.append((option["words"], option["now"], *amounts, f"{option['failures']:.2g}"))
        plain.append(
            {
                "option": option["words"],
                "now": option["now"],
                **cost,
                "failures": option["failures"],
            }
        )
    heads = (
        "option",
        "now",
        f"cost [{body['currency']}]",
        "9 of 10 futures from",
        "to",
        "failures",
    )
    show("", heads, rows, plain=plain)
    if body["information"] and sys.stdout.isatty():
        each = [
            (one["words"], f"{one['value']:.3g}", f"{one['net']:.3g}", f"{one['changes']:.2g}")
            for one in body["information"]
        ]
        show("", ("observation", "value", "net value", "changes the action"), each, plain=[])


def _show_fleet(body: dict[str, Any]) -> None:
    rows, plain = [], []
    for asset in body["assets"]:
        net = "" if asset["net"] is None else f"{asset['net']:.4g}"
        rows.append((asset["id"], "yes" if asset["visit"] else "", asset["action"], net))
        plain.append({name: asset[name] for name in ("id", "visit", "action", "net")})
    heads = ("twin", "visit", "action", f"net value [{body['currency']}]")
    show("", heads, rows, plain=plain)

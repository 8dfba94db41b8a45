"""Counts and gauges in the text format that Prometheus reads.

Written out by hand: it is two lines a number, and a client library would bring a second,
global registry of what the pipeline counts already. `slowtime_twin_` is the server,
`slowtime_asset_` what it knows of each asset.
"""

import importlib.metadata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from pydantic_core import from_json

from twin_server.fairness import Holdings
from twin_server.history.states import ESTIMATES
from twin_server.identity.principals import SERVER

from .http.compute_queue import WAYS, ComputeQueue
from .knowledge import Knowledge
from .routes.alarms import AlarmService

_COUNTERS = {
    "accepted": "Features that were let through, each once.",
    "out_of_order": "Features that came early and were held until their turn.",
    "overlapping": "Features whose time earlier windows had measured in part or wholly.",
    "lost": "Features that are lost for good.",
    "batches": "Transactions.",
    "failed_batches": "Transactions that failed; nothing of them was kept.",
    "published": "Messages sent on the bus.",
    "not_published": "Messages that the bus did not take.",
    "asked": "Questions put to edges about what is missing.",
    "inbox_dropped": "Messages that found no room in the inbox.",
    "callback_errors": "Failures within callbacks of the bus.",
    "witness_failures": "Signed heads of the ledger that could not be kept elsewhere.",
}
_GAUGES = {
    "twins": "Registered twins.",
    "edges_alive": "Edge agents that are online.",
    "holes": "Boots of which something is missing now.",
    "held": "Features held out of order now.",
    "held_bytes": "Bytes of the features held out of order now.",
    "boots": "Boots that are remembered, of all assets.",
    "inbox": "Messages that wait to be worked.",
    "ledger_refused": "Whether the ledger is not signed, because the database is not proven.",
    "aside": "Messages that were set aside and wait to be released or dropped.",
    "live_clients": "Clients of the live stream.",
    "forecasts_due": "Twins whose forecast waits to be learnt again.",
}
_OF_ASSET = {
    "alive": "Whether the edge agent is online.",
    "heard_timestamp_seconds": "When features last came, by the server's clock.",
    "reading_timestamp_seconds": "Sensor time of the latest epoch.",
    "slow_time": "Slow time of the latest epoch, in the asset's own unit.",
    "valid": "Whether the latest estimates mean anything.",
    "alarms_raised": "Alarms that are raised now.",
    "frequency_hertz": "Natural frequency, and its 95 % interval.",
    "damping_ratio": "Damping over critical damping, and its 95 % interval.",
    "stiffness_change_ratio": "Relative change of stiffness, and its 95 % interval.",
    "mass_change_ratio": "Relative change of mass, and its 95 % interval.",
    "element_change_ratio": "Relative change of an element's stiffness or a node's mass.",
}
_NAMES = dict(
    zip(
        ESTIMATES,
        ("frequency_hertz", "damping_ratio", "stiffness_change_ratio", "mass_change_ratio"),
        strict=True,
    )
)
_PARTS = {"value": 0, "lo": 2, "hi": 3}


class Metric(NamedTuple):
    """One number with its labels."""

    labels: Mapping[str, str]
    value: float


def exposition(
    knowledge: Knowledge,
    live_clients: int,
    dropped_clients: int,
    most_assets: int,
    queue: ComputeQueue | None = None,
    alarm_service: AlarmService | None = None,
    holdings: Holdings | None = None,
) -> str:
    """All metrics as text; of more than `most_assets` twins, without those of each asset."""
    lines: list[str] = []
    for name, kind, says, metrics in (
        *_server(knowledge, live_clients, dropped_clients),
        *(() if queue is None else _work(queue)),
        *(() if alarm_service is None else _deliveries(alarm_service)),
        *(() if holdings is None else _held(holdings)),
    ):
        lines += _family(f"slowtime_twin_{name}", kind, says, metrics)
    ids = knowledge.ids(SERVER)
    found = _assets(knowledge, ids if len(ids) <= most_assets else [])
    for name, says in _OF_ASSET.items():
        lines += _family(f"slowtime_asset_{name}", "gauge", says, found.get(name, []))
    return "\n".join(lines) + "\n"


def _server(
    knowledge: Knowledge, live_clients: int, dropped_clients: int
) -> Iterator[tuple[str, str, str, Sequence[Metric]]]:
    counts, gauges = dict(knowledge.counts()), dict(knowledge.gauges())
    gauges["live_clients"] = live_clients
    version = {"version": importlib.metadata.version("slowtime")}
    yield "build_info", "gauge", "Which software this is.", [Metric(version, 1)]
    for name, says in _COUNTERS.items():
        yield f"{name}_total", "counter", says, [Metric({}, counts.get(name, 0))]
    kinds = [
        Metric({"kind": name.removeprefix("event_")}, count)
        for name, count in sorted(counts.items())
        if name.startswith("event_")
    ]
    yield "events_total", "counter", "Events, by kind.", kinds
    reasons = [Metric({"reason": word}, count) for word, count in knowledge.refused().items()]
    yield "refused_total", "counter", "Messages that were refused, by reason.", reasons
    dropped = [Metric({}, dropped_clients)]
    yield "live_dropped_total", "counter", "Live clients dropped as too slow.", dropped
    for name, says in _GAUGES.items():
        yield name, "gauge", says, [Metric({}, gauges.get(name, 0))]


def _work(queue: ComputeQueue) -> Iterator[tuple[str, str, str, Sequence[Metric]]]:
    yield (
        "work_waiting",
        "gauge",
        "Requests that wait to be computed.",
        [Metric({}, queue.waiting)],
    )
    yield (
        "work_running",
        "gauge",
        "Requests that are being computed.",
        [Metric({}, queue.running)],
    )
    ends = [Metric({"end": word}, queue.counts[word]) for word in WAYS]
    yield "work_total", "counter", "Requests that take long, by what became of them.", ends


def _held(holdings: Holdings) -> Iterator[tuple[str, str, str, Sequence[Metric]]]:
    found = [
        ({"kind": kind, "site": site}, held, refused)
        for kind, site, held, refused in holdings.counts()
    ]
    yield (
        "under_way",
        "gauge",
        "Uploads, replays, diagnoses, computations, exports and streams under way, by site.",
        [Metric(labels, held) for labels, held, _ in found],
    )
    yield (
        "over_quota_total",
        "counter",
        "Requests that were refused since too much was under way, by site.",
        [Metric(labels, refused) for labels, _, refused in found],
    )


def _deliveries(
    alarm_service: AlarmService,
) -> Iterator[tuple[str, str, str, Sequence[Metric]]]:
    counts: dict[tuple[str, str], int] = {}
    oldest_ns: dict[str, int] = {}
    for tally in alarm_service.tallies():
        key = tally.receiver, tally.state
        counts[key] = counts.get(key, 0) + tally.number
        if tally.state == "waiting":
            known = oldest_ns.get(tally.receiver, tally.oldest_ns)
            oldest_ns[tally.receiver] = min(known, tally.oldest_ns)
    yield (
        "deliveries",
        "gauge",
        "Events on their way to receivers, and those that are kept of the past, by state.",
        [Metric({"receiver": name, "state": state}, n) for (name, state), n in counts.items()],
    )
    yield (
        "delivery_oldest_timestamp_seconds",
        "gauge",
        "When the oldest event that waits for a receiver was begun.",
        [Metric({"receiver": name}, ns / 1e9) for name, ns in oldest_ns.items()],
    )


def _assets(knowledge: Knowledge, twin_ids: Iterable[str]) -> dict[str, list[Metric]]:
    found: dict[str, list[Metric]] = {}
    for twin_id in twin_ids:
        own = {"site": twin_id.partition(".")[0], "twin": twin_id}
        for name, labels, value in _of_asset(knowledge, twin_id):
            found.setdefault(name, []).append(Metric(own | labels, value))
    return found


def _of_asset(
    knowledge: Knowledge, twin_id: str
) -> Iterator[tuple[str, dict[str, str], float]]:
    yield "alive", {}, float(knowledge.alive(twin_id))
    yield "alarms_raised", {}, float(len(knowledge.raised(twin_id)))
    heard_ns = knowledge.heard_ns(twin_id)
    if heard_ns is not None:
        yield "heard_timestamp_seconds", {}, heard_ns / 1e9
    latest = knowledge.latest(twin_id, None)
    if not len(latest.states):
        return
    row: Any = latest.states[-1]
    yield "reading_timestamp_seconds", {}, int(row["t_ns"]) / 1e9
    yield "slow_time", {"unit": latest.units[-1]}, float(row["slow_time"])
    yield "valid", {}, float(row["reasons"] == 0)
    for name, metric in _NAMES.items():
        numbers = row[name].tolist()
        if numbers[0] == numbers[0]:
            for part, index in _PARTS.items():
                yield metric, {"part": part}, numbers[index]
    body = latest.bodies[-1] if latest.bodies else None
    if body is not None:
        for element, estimate in from_json(body)["elements"].items():
            for part in _PARTS:
                labels = {"element": element, "part": part}
                yield "element_change_ratio", labels, estimate[part]


def _family(name: str, kind: str, says: str, metrics: Iterable[Metric]) -> list[str]:
    lines = [f"# HELP {name} {says}", f"# TYPE {name} {kind}"]
    for labels, value in metrics:
        said = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels.items())
        number = value if isinstance(value, int) else repr(float(value))
        lines.append(f"{name}{{{said}}} {number}" if said else f"{name} {number}")
    return lines


def _escaped(text: str) -> str:
    r"""Escape characters that would end a label's value.

    Examples
    --------
    >>> print(_escaped('the "long" beam'))
    the \"long\" beam
    """
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")

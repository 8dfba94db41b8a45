"""Counts and gauges in the text format that Prometheus reads.

Written out by hand: it is two lines a number, and a client library would bring a second,
global registry of what the pipeline counts already.
"""

from .knowledge import Knowledge

_COUNTERS = {
    "accepted": "Features that were let through, each once.",
    "out_of_order": "Features that came early and were held until their turn.",
    "lost": "Features that nobody has any more.",
    "batches": "Transactions.",
    "failed_batches": "Transactions that failed; nothing of them was kept.",
    "published": "Messages sent on the bus.",
    "not_published": "Messages that the bus did not take.",
    "asked": "Questions put to edges about what is missing.",
    "inbox_dropped": "Messages that found no room in the inbox.",
    "callback_errors": "Failures within callbacks of the bus.",
}
_GAUGES = {
    "twins": "Registered twins.",
    "edges_alive": "Edge agents that are there.",
    "holes": "Boots of which something is missing now.",
    "held": "Features held out of order now.",
    "inbox": "Messages that wait to be worked.",
    "live_clients": "Clients of the live stream.",
}


def exposition(knowledge: Knowledge, live_clients: int, dropped_clients: int) -> str:
    """All metrics as text."""
    counts, gauges = dict(knowledge.counts()), dict(knowledge.gauges())
    gauges["live_clients"] = live_clients
    lines: list[str] = []
    for name, says in _COUNTERS.items():
        lines += _head(f"{name}_total", "counter", says)
        lines.append(f"slowtime_twin_{name}_total {counts.get(name, 0)}")
    lines += _head("events_total", "counter", "Events, by kind.")
    lines += [
        f'slowtime_twin_events_total{{kind="{name.removeprefix("event_")}"}} {count}'
        for name, count in sorted(counts.items())
        if name.startswith("event_")
    ]
    lines += _head("refused_total", "counter", "Messages that were refused, by reason.")
    lines += [
        f'slowtime_twin_refused_total{{reason="{reason}"}} {count}'
        for reason, count in knowledge.refused().items()
    ]
    lines += _head("live_dropped_total", "counter", "Live clients dropped as too slow.")
    lines.append(f"slowtime_twin_live_dropped_total {dropped_clients}")
    for name, says in _GAUGES.items():
        lines += _head(name, "gauge", says)
        lines.append(f"slowtime_twin_{name} {gauges.get(name, 0)}")
    return "\n".join(lines) + "\n"


def _head(name: str, kind: str, says: str) -> list[str]:
    return [f"# HELP slowtime_twin_{name} {says}", f"# TYPE slowtime_twin_{name} {kind}"]

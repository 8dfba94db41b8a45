"""Detects two agents that send as the same asset, by their boots, clocks and readings."""

import datetime

from slowtime_schemas.messages import Health

from .asset_runs import AssetRuns
from .changes import RepeatedFeatures, RivalAgents, StoreChange
from .held import Arrival
from .runs import Run

SAME_AGENT_MS = 1_000
"""Difference of start times within which two health messages are of one agent [ms]: an agent
tells its start to the microsecond, and one that restarts takes longer than this."""

MOST_AGENTS = 8
"""Start times of agents that are remembered of one boot."""

SURVIVES = 2
"""Messages of health of a closed boot, from after a later one began, that show that its agent
lives: one may have been on its way when it ended."""


def contest(run: Run, how: str, change: StoreChange) -> None:
    """Note that two agents send under one boot: nothing more of it is acknowledged."""
    run.contested = True
    if not run.rivalled:
        run.rivalled = True
        change.rivals.append(RivalAgents(run, run.boot, run.next, how))


def contest_reading(
    run: Run, sequence: int, one_ns: int, other_ns: int, change: StoreChange
) -> None:
    """Note that two agents have sent different readings under one sequence."""
    contest(run, _told_apart(sequence, one_ns, other_ns), change)
    change.refused.append(
        (
            "two_agents",
            f"{run}: sequence {sequence} was given with other content than before. "
            "Allowed: one agent at a time per asset. Give each its own asset name, and "
            "leave `boot` unset.",
        )
    )


def tell_agents_apart(run: Run, health: Health, change: StoreChange) -> None:
    """Distinguish the agents of a boot by their start times; contest it where there are two."""
    if health.uptime_s <= 0:
        return
    began_ms = health.t_ns // 10**6 - round(health.uptime_s * 1e3)
    if all(abs(began_ms - other) > SAME_AGENT_MS for other in run.agents):
        run.agents = [*run.agents, began_ms][-MOST_AGENTS:]
        if len(run.agents) > 1:
            one, other = (_instant(ms * 10**6) for ms in run.agents[-2:])
            contest(run, f"one began at {one}, the other at {other}", change)


def look_for_survivor(line: AssetRuns, run: Run, health: Health, change: StoreChange) -> None:
    """See whether the agent of a closed boot lives on beside that of a later one."""
    later = line.latest or run
    if run.rivalled or not run.closed or later is run or not later.agents:
        return
    if health.t_ns // 10**6 > later.agents[-1] + SAME_AGENT_MS:
        run.outlived += 1
    if run.outlived >= SURVIVES:
        report_rivals(line, run, change)


def report_rivals(line: AssetRuns, run: Run, change: StoreChange) -> None:
    """Report that a boot and the latest one of its asset are of two agents."""
    run.rivalled = True
    latest = run if line.latest is None else line.latest
    change.rivals.append(RivalAgents(run, latest.boot, run.next, "they use different boots"))


def look_for_rivals(
    line: AssetRuns, run: Run, arrival: Arrival, reason: str, change: StoreChange
) -> None:
    """Check whether refused messages come from a second agent."""
    if arrival.replayed:
        return
    sequence = arrival.features.sequence
    if reason == "closed_boot" and not run.rivalled:
        report_rivals(line, run, change)
    elif reason == "duplicate" and sequence in run.held:
        if run.held[sequence].payload != arrival.payload:
            times = run.held[sequence].features.t_ns, arrival.features.t_ns
            contest_reading(run, sequence, *times, change)
    elif reason == "duplicate":
        change.repeated.append(RepeatedFeatures(run, sequence, arrival.payload))


def _told_apart(sequence: int, one_ns: int, other_ns: int) -> str:
    """Describe the difference of two readings under one sequence."""
    if one_ns == other_ns:
        return f"reading {sequence} came twice, with different content"
    return (
        f"reading {sequence} came with sensor time {_instant(one_ns)}, and again with "
        f"{_instant(other_ns)} and other content"
    )


def _instant(t_ns: int) -> str:
    when = datetime.datetime.fromtimestamp(t_ns // 10**9, datetime.UTC)
    return f"{when:%Y-%m-%dT%H:%M:%S}.{t_ns % 10**9 // 10**6:03d}Z"

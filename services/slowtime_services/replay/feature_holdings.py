"""Features that a recording holds of each run, and how many were acknowledged."""

import bisect
import dataclasses
from array import array
from collections.abc import Iterator, Mapping
from pathlib import Path

from slowtime_schemas.codec import Refused, decode_sample
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import FEATURES, HEALTH
from slowtime_services.feature_runs import AgentRun, run_and_sequence

from .recording_reader import RecordedMessage, read_recording

LAST_SEQUENCE = 2**63 - 1
"""Largest sequence that a message holds [1]."""

MOST_AT_ONCE = 10_000
"""Features in one answer [1], as of an edge agent."""


@dataclasses.dataclass(slots=True)
class RunFeatures:
    """The features of one run: 16 bytes each, however large they are."""

    sequences: "array[int]"
    """Ascending, each once."""
    log_ns: "array[int]"
    """When each arrived at the recorder, the first time."""
    published: int = -1
    """Highest sequence published so far."""
    acknowledged: int = -1
    """Highest sequence the twin has said is durable, all before it too."""
    health: Health | None = None
    """The last word of the run about itself."""

    def up_to(self, sequence: int) -> int:
        """Return the number of features up to and including `sequence`."""
        return bisect.bisect_right(self.sequences, sequence)

    @property
    def outstanding(self) -> int:
        """Return the number of features published and not acknowledged."""
        return max(0, self.up_to(self.published) - self.up_to(self.acknowledged))

    def arrived_between(self, first: int, last: int) -> tuple[int, int] | None:
        """When those from `first` to `last` arrived, at the outside."""
        begin = bisect.bisect_left(self.sequences, first)
        end = self.up_to(last)
        arrivals = self.log_ns[begin:end]
        return (min(arrivals), max(arrivals)) if arrivals else None


def features_by_run(path: Path) -> dict[AgentRun, RunFeatures]:
    """Read a recording once for the features of each run, in order of appearance."""
    arrivals: dict[AgentRun, dict[int, int]] = {}
    words: dict[AgentRun, Health] = {}
    for message in read_recording(path, streams=[FEATURES, HEALTH]):
        if (known := run_and_sequence(message.key, message.payload)) is not None:
            arrivals.setdefault(known[0], {}).setdefault(known[1], message.log_ns)
        elif (health := _health(message)) is not None:
            words[AgentRun(health.site, health.asset, health.boot)] = health
    return {run: _holding(of_run, words.get(run)) for run, of_run in arrivals.items()}


def features_again(
    path: Path, run: AgentRun, holding: RunFeatures, first: int, last: int
) -> list[bytes]:
    """Read the features from `first` to `last` again, as far as published, in order.

    Of too many, the first: whoever wants more asks again.
    """
    begin = bisect.bisect_left(holding.sequences, first)
    most = holding.sequences[begin : begin + MOST_AT_ONCE]
    last = min(last, holding.published, most[-1] if most else -1)
    between = holding.arrived_between(first, last)
    if between is None:
        return []
    found: dict[int, bytes] = {}
    for message in read_recording(
        path, streams=[FEATURES], start_ns=between[0], end_ns=between[1] + 1
    ):
        known = run_and_sequence(message.key, message.payload)
        if known and known[0] == run and first <= known[1] <= last:
            found.setdefault(known[1], message.payload)
    return [payload for _, payload in sorted(found.items())]


def health_messages(
    holdings: Mapping[AgentRun, RunFeatures],
) -> Iterator[tuple[AgentRun, Health]]:
    """Make the health of each run of which features are outstanding: it shows a lost tail."""
    for run, holding in holdings.items():
        if not holding.outstanding:
            continue
        first, before = holding.sequences[0], holding.health
        yield (
            run,
            Health(
                **run._asdict(),
                sequence=min(before.sequence + 1, LAST_SEQUENCE) if before else 0,
                t_ns=before.t_ns if before else holding.log_ns[-1],
                last_sequence=holding.published,
                first_held=first,
                dropped=before.dropped if before else 0,
                uptime_s=before.uptime_s if before else 0.0,
                counters=before.counters if before else {},
            ),
        )


def _holding(arrivals: dict[int, int], health: Health | None) -> RunFeatures:
    ordered = sorted(arrivals)
    arrived = array("q", (arrivals[sequence] for sequence in ordered))
    return RunFeatures(array("q", ordered), arrived, health=health)


def _health(message: RecordedMessage) -> Health | None:
    try:
        health = decode_sample(message.key, message.payload)
    except Refused:
        return None
    return health if isinstance(health, Health) else None

"""Work per message: valid messages that are meant to harm beside ordinary ones.

    python -m benchmarks.processes.hostile_work                    ten thousand of each
    python -m benchmarks.processes.hostile_work --messages 500

Each message goes alone through the whole ingest path of a twin server, with its transaction,
its acknowledgement and the questions to the edge that follow from it, which a hostile edge
answers.
Counted are the executed lines of Python (`sys.settrace`) and the processor time of the thread,
which sees compiled work too. Leaves with 1 where the hostile messages, beside any sort of
answers, together take more than `MOST_TOTAL` times the ordinary ones, or one of them more than
`MOST_SINGLE` times the median ordinary one, per kilobyte. Answers count as messages by their
size.
"""

import argparse
import contextlib
import dataclasses
import itertools
import json
import logging
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from slowtime_schemas.streams import FEATURES, HEALTH, Stream
from slowtime_services.bus import MemoryBus, Sample
from tests.fuzz.extremes import KINDS, base, let_in
from twin_server.collect import Holding
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

MOST_TOTAL = 3.0
"""Work of all hostile messages over that of as many ordinary ones [1]."""
MOST_SINGLE = 20.0
"""Work per kilobyte of one of them over that of the median ordinary one [1]."""

KIBIBYTE = 1024.0
FAR = 2**40 - 1
"""Largest sequence that a message may have."""
PERIOD_NS = 10**9
"""Between two readings [ns]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Work:
    """Work that one message caused.

    Parameters
    ----------
    answers
        What sort of answers was given to the server.
    size, answered
        Bytes of the message, and of the answers that were given for it.
    lines
        Executed lines of Python.
    seconds
        Processor time [s].
    """

    kind: str
    answers: str
    size: int
    answered: int
    lines: int
    seconds: float


class Subject:
    """A pipeline on a bus whose worker is not started: each message is worked when it is given.

    Parameters
    ----------
    answers
        What the edge says it holds, whenever it is asked; None for an edge that is not there.
    """

    def __init__(self, store: SqliteStore, answers: Sequence[Holding] | None) -> None:
        healing = {"grace_s": 0.0, "backoff_s": 1e-6, "max_backoff_s": 1e-6, "tries": 2}
        self._answers = answers
        self._pipeline = Pipeline(TwinSettings(healing=healing), store, bus=MemoryBus())
        if answers is not None:
            self._pipeline.call(
                lambda: self._pipeline._account.watch("lab", "beam", alive=True)
            )

    def work(self, sample: Sample) -> int:
        """Work one message with all that follows from it; bytes of what was given."""
        pipeline, size = self._pipeline, len(sample.payload)
        pipeline._take([sample])
        for want in pipeline._wants():
            again = [sample] if want.boot else []
            pipeline._take_answers(want, again)
            pipeline._conclude_answers([(want, self._answers or (), self._answers is not None)])
            size += 100 * (len(self._answers or ()) + len(again))
        pipeline._publisher.acknowledge()
        return size


def counted(function: Callable[[], int]) -> tuple[int, int]:
    """Call a function; give its result and how many lines of Python it executed."""
    lines = 0

    def local(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal lines
        if event == "line":
            lines += 1
        return local

    before = sys.gettrace()
    sys.settrace(lambda frame, event, argument: local)
    try:
        result = function()
    finally:
        sys.settrace(before)
    return result, lines


def ordinary(count: int, now_ns: int) -> dict[str, list[Sample]]:
    """Messages of one edge as it makes them: of each stream as many."""
    return {
        stream.name: [
            _sample(stream, _origin(stream, now_ns)(number)) for number in range(count)
        ]
        for stream in KINDS
    }


def hostile(count: int, now_ns: int, seed: int = 1) -> dict[str, list[Sample]]:
    """Make valid messages that are meant to harm: by their values, and by their order."""
    found = {
        stream.name: [
            Sample(stream.key("lab", "beam"), payload, None, False)
            for payload in let_in(stream, _origin(stream, now_ns), count, seed)
        ]
        for stream in KINDS
    }
    return found | {
        name: [_sample(stream, make(n)) for n in range(count)]
        for name, (stream, make) in _sequences(now_ns).items()
    }


def _sequences(now_ns: int) -> dict[str, tuple[Stream, Callable[[int], dict[str, Any]]]]:
    """Messages that are ordinary one by one."""
    features, health = _origin(FEATURES, now_ns), _origin(HEALTH, now_ns)

    def of_boot(number: int, sequence: int) -> dict[str, Any]:
        return features(number) | {"boot": f"h{number}", "sequence": sequence}

    return {
        "a boot for each message": (FEATURES, lambda n: of_boot(n, 0)),
        "a boot for each, far ahead": (FEATURES, lambda n: of_boot(n, FAR - n)),
        "every other sequence": (FEATURES, lambda n: features(n) | {"sequence": 2 * n}),
        "descending sequences": (FEATURES, lambda n: features(n) | {"sequence": 10**6 - n}),
        "one sequence again": (FEATURES, lambda n: features(n) | {"sequence": n % 2}),
        "clock back and forth": (
            FEATURES,
            lambda n: features(n) | {"t_ns": now_ns - n % 2 * 10**12, "start_ns": 10**18},
        ),
        "clock not set": (FEATURES, lambda n: features(n) | {"t_ns": n, "start_ns": 0}),
        "an end far ahead": (HEALTH, lambda n: health(n) | {"last_sequence": FAR - 9_999 + n}),
        "an end at the limit": (HEALTH, lambda n: health(n) | {"last_sequence": 10**6 + n}),
        "acknowledgements of others": (
            HEALTH,
            lambda n: health(n) | {"counters": {"foreign_acks": n + 1}, "first_held": 0},
        ),
        "a sensor that flaps": (
            HEALTH,
            lambda n: (
                health(n) | {"counters": {"sensor_silent_s": n % 2, "source_restarts": n}}
            ),
        ),
        "an agent for each message": (HEALTH, lambda n: health(n) | {"uptime_s": 10.0 * n}),
    }


LISTINGS: dict[str, Sequence[Holding] | None] = {
    "": None,
    ", lists all": [Holding("b1", 0, FAR)],
    ", lists what is far": [Holding("b1", 2**31, 2**31 + 5)],
    ", lists damage": [Holding("b1", 0, FAR, tuple((n, n) for n in range(0, 2_000, 2)))],
    ", lists a thousand boots": [Holding(f"l{n}", 0, n) for n in range(1_000)],
}
"""What a hostile edge answers."""


def measured(
    samples: dict[str, list[Sample]],
    *,
    answers: Sequence[Holding] | None,
    name: str,
    timed: bool = True,
) -> list[Work]:
    """Work all messages, of each kind on a database of its own.

    Parameters
    ----------
    answers
        What a hostile edge answers.
    name
        Of these answers.
    timed
        Whether processor times are wanted, the shorter of two passes, and not lines alone.
    """
    found = []
    for kind, messages in samples.items():
        lines = _pass(messages, answers, trace=True)
        seconds = (
            [_pass(messages, answers, trace=False) for _ in range(2)] if timed else [lines]
        )
        shortest = [min(one[1] for one in each) for each in zip(*seconds, strict=True)]
        for message, (size, _, count), seconds_s in zip(messages, lines, shortest, strict=True):
            own = len(message.payload)
            found.append(Work(kind + name, name, own, size - own, count, seconds_s))
    return found


def _pass(
    messages: Sequence[Sample], answers: Sequence[Holding] | None, *, trace: bool
) -> list[tuple[int, float, int]]:
    with _subject(answers) as subject:
        # The first messages make what all others find, such as compiled statements.
        opening = ordinary(3, time.time_ns() - 10**12)[FEATURES.name]
        for sample in opening:
            subject.work(sample)
        found = []
        for sample in messages:
            lines, began_s = 0, time.thread_time()
            if trace:
                size, lines = counted(lambda sample=sample: subject.work(sample))  # type: ignore[misc]
            else:
                size = subject.work(sample)
            found.append((size, time.thread_time() - began_s, lines))
        return found


@contextlib.contextmanager
def _subject(answers: Sequence[Holding] | None) -> Iterator[Subject]:
    with tempfile.TemporaryDirectory(prefix="slowtime-") as folder:
        store = SqliteStore(Path(folder) / "twin.sqlite", synchronous="NORMAL")
        try:
            yield Subject(store, answers)
        finally:
            store.close()


def _origin(stream: Stream, now_ns: int) -> Callable[[int], dict[str, Any]]:
    def make(number: int) -> dict[str, Any]:
        at_ns = now_ns + (number - 10**6) * PERIOD_NS // 10**3
        return base(stream, at_ns, asset="beam", boot="b1", sequence=number)

    return make


def _sample(stream: Stream, content: dict[str, Any]) -> Sample:
    payload = json.dumps(content, separators=(",", ":")).encode()
    return Sample(stream.key("lab", "beam"), payload, None, False)


@dataclasses.dataclass(frozen=True, slots=True)
class Ratios:
    """Work of hostile messages over that of ordinary ones [1]."""

    total: float
    single: float
    worst: str


def ratios(good: Sequence[Work], bad: Sequence[Work], cost: Callable[[Work], float]) -> Ratios:
    """Compare the mean work of a message, and the most work of one per kilobyte."""
    usual = statistics.fmean(work.size for work in good)
    sorts: dict[str, list[Work]] = {}
    for work in bad:
        sorts.setdefault(work.answers, []).append(work)
    total = max(
        sum(map(cost, some)) / sum(1.0 + work.answered / usual for work in some)
        for some in sorts.values()
    ) / statistics.fmean(map(cost, good))

    def per_kilobyte(work: Work) -> float:
        return cost(work) / ((work.size + work.answered) / KIBIBYTE)

    median = statistics.median(map(per_kilobyte, good))
    worst = max(bad, key=per_kilobyte)
    return Ratios(total, per_kilobyte(worst) / median, worst.kind)


def compared(messages: int, seed: int = 1, *, timed: bool = True) -> tuple[Ratios, Ratios]:
    """Measure so many messages of both sorts: ratios of lines, and of processor time."""
    now_ns = time.time_ns()
    of_kind = -(-messages // len(KINDS))
    good = measured(ordinary(of_kind, now_ns), answers=None, name="", timed=timed)
    kinds = len(KINDS) + len(_sequences(now_ns))
    of_kind = -(-messages // (kinds * len(LISTINGS)))
    bad = list(
        itertools.chain.from_iterable(
            measured(hostile(of_kind, now_ns, seed), answers=answers, name=name, timed=timed)
            for name, answers in LISTINGS.items()
        )
    )
    return (
        ratios(good, bad, lambda work: work.lines),
        ratios(good, bad, lambda work: work.seconds),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the ratios; 1 where one is beyond its bound."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--messages", type=int, default=10_000, help="of each sort")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    logging.disable(logging.CRITICAL)
    passed = True
    for what, found in zip(
        ("lines", "processor time"), compared(given.messages, given.seed), strict=True
    ):
        print(f"{what}: {found.total:.2f} times the work of as many ordinary messages")
        print(f"{what}: {found.single:.2f} times per kilobyte at most ({found.worst})")
        passed &= found.total <= MOST_TOTAL and found.single <= MOST_SINGLE
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())

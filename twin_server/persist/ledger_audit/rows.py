"""Compares the rows of one chain with what its entries say they have to be."""

import itertools
from collections.abc import Iterator
from typing import Any

from slowtime_services.ledger import chain as kinds
from slowtime_services.ledger import features_digest, states_digest
from slowtime_services.ledger.chain import GONE, WIDTH
from twin_server.persist.chains.basis import states_between
from twin_server.persist.chains.coverage import COMPOSITE, COVERED, SERVER, Coverage
from twin_server.persist.tables.search import SHIFT, Span

from .chain_walk import Walk, blocks
from .result import Audit

_FEATURES = kinds.FEATURES.encode()
_LOW = (1 << SHIFT) - 1
_AT_ONCE = 1_000
"""Rows that are read at once."""


def compare_tables(
    reader: Any, owner: str, walked: Walk, numbers: list[int], found: Audit
) -> dict[str, int]:
    """Compare the rows of all tables that have entries; return how many were read of each.

    Parameters
    ----------
    numbers
        Of the boots that belong to this chain.
    """
    counts = {}
    for name, coverage in COVERED.items():
        expected = dict(walked.rows.get(coverage.kind.encode(), {}))
        sentences, read = [], 0
        for row in _rows(reader, coverage, owner, numbers):
            read += 1
            entry = coverage.written(row)
            wanted = expected.pop(entry.key, (GONE, 0))[0]
            if wanted == GONE:
                sentences.append(f"{coverage.name(row)} was never accepted")
            elif wanted != entry.digest:
                sentences.append(f"{coverage.name(row)} is not what was accepted")
        sentences += [
            f"{coverage.name_of_missing(key)} was accepted (entry {count}) and is not there"
            for key, (digest, count) in expected.items()
            if digest != GONE
        ]
        found.blame_each(owner, sentences)
        counts[name] = read
    found.blame_each(owner, (f"{name} was accepted twice" for name in walked.twice))
    return counts


def _rows(
    reader: Any, coverage: Coverage, owner: str, numbers: list[int]
) -> Iterator[tuple[Any, ...]]:
    table = coverage.table
    question = f"select {', '.join(table.columns)} from {table.name} where "
    if coverage.owned is not None:
        if (coverage.owner is COVERED["composites"].owner) != owner.startswith(COMPOSITE):
            return
        name = owner.removeprefix(COMPOSITE) if owner != SERVER else ""
        yield from reader.execute(question + coverage.owned, (name,))
        return
    key = coverage.keys[0]
    for number in numbers:
        first, last = (number, number) if key == "number" else _ids(number)
        yield from reader.execute(f"{question} {key} between ? and ?", (first, last))


def compare_features(
    reader: Any, owner: str, walked: Walk, spans: list[Span], found: Audit
) -> int:
    """Compare features with their entries, in order; return how many agree."""
    cursors = {span.number: _features(reader, span) for span in spans}
    matched = 0
    for count, block, _ in blocks(reader, owner):
        if count <= walked.deleted:
            continue
        for first, past in _feature_runs(block):
            number = int.from_bytes(block[first + 1 : first + 4], "big")
            cursor = cursors.get(number, iter(()))
            here = list(itertools.islice(cursor, (past - first) // WIDTH))
            if b"".join(here) == block[first:past]:
                matched += len(here)
                continue
            accepted = (block[at : at + WIDTH] for at in range(first, past, WIDTH))
            for written, there in itertools.zip_longest(accepted, here):
                if written != there:
                    found.blame(owner, _difference(written, there))
                    return matched
    for cursor in cursors.values():
        more = next(cursor, None)
        if more is not None:
            found.blame(owner, f"{_named(more)} was never accepted")
    return matched


def compare_states(
    reader: Any, owner: str, walked: Walk, spans: list[Span], found: Audit
) -> None:
    """Compare states and details with the entries that cover several of them each."""
    sentences = []
    for span in spans:
        groups = walked.states.get(span.number, [])
        rows = states_between(reader, *_ids(span.number))
        row = next(rows, None)
        for (key, digest), following in itertools.zip_longest(groups, groups[1:]):
            until = following[0] if following is not None else _ids(span.number)[1] + 1
            group = []
            while row is not None and row[0] < until:
                group.append(row)
                row = next(rows, None)
            if states_digest(group) != digest:
                last = group[-1][0] if group else key
                sentences.append(
                    f"the states of features {key & _LOW} to {last & _LOW} of boot {span.boot} "
                    "are not those that followed from what was accepted"
                )
        if row is not None:
            sentences.append(
                f"the state of feature {row[0] & _LOW} of boot {span.boot} was never estimated"
            )
    found.blame_each(owner, sentences)


def _ids(number: int) -> tuple[int, int]:
    return number << SHIFT, (number << SHIFT) + _LOW


def _feature_runs(block: bytes) -> Iterator[tuple[int, int]]:
    """Yield begin and end of consecutive entries of features of one boot."""
    at = 0
    while at < len(block):
        begin, head = at, block[at : at + 4]
        at += WIDTH
        if head[:1] != _FEATURES:
            continue
        while block[at : at + 4] == head:
            at += WIDTH
        yield begin, at


def _features(reader: Any, span: Span) -> Iterator[bytes]:
    """Entries of the features of a boot as they are there, in their order."""
    first, last = _ids(span.number)
    while rows := reader.execute(
        "select id, t_ns, slow_time, message from features "
        "where id between ? and ? order by id limit ?",
        (first, last, _AT_ONCE),
    ).fetchall():
        for key, t_ns, slow_time, message in rows:
            digest = features_digest(span.boot, key & _LOW, t_ns, float(slow_time), message)
            yield _FEATURES + key.to_bytes(8, "big") + digest
        first = rows[-1][0] + 1


def _named(written: bytes) -> str:
    key = int.from_bytes(written[1:9], "big")
    return f"feature {key & _LOW} of boot number {key >> SHIFT}"


def _difference(accepted: bytes | None, there: bytes | None) -> str:
    if accepted is not None and (there is None or there[1:9] > accepted[1:9]):
        return f"{_named(accepted)} was accepted and is not there"
    assert there is not None  # one of a pair of `zip_longest` is there
    if accepted is None or there[1:9] < accepted[1:9]:
        return f"{_named(there)} was never accepted"
    return f"{_named(accepted)} is not what was accepted"

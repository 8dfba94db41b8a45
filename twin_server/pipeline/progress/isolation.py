"""Estimates a batch within a budget, and finds the message that exceeds it or fails.

The whole batch is tried first, since that is the cheapest by far. Where it fails, each asset is
tried alone, and of that which fails each message alone. A state does not depend on how the
stream is cut, so that all others have the states that they would have had.
"""

import contextlib
import logging
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

from slowtime_schemas.messages import Features
from twin_server.estimate import Estimates, Notice, Twin, estimate
from twin_server.history import states as st
from twin_server.history.details import Detail

from .budget import OverBudgetError, WorkBudget

logger = logging.getLogger(__name__)

ASIDE_BEFORE = "it was set aside before"
"""Why a row is not tried."""

PART = 20
"""Messages of twins of elements in one step: each takes up to some tenths of a second."""


class Isolated(NamedTuple):
    """Estimates, and why some rows have none."""

    found: Estimates
    failed: dict[int, str]


class EstimateBatch(NamedTuple):
    """The arguments of `twin_server.estimate.estimate`."""

    twins: Sequence[Twin]
    features: Sequence[Features]
    owners: Sequence[int]
    missing_before: Sequence[int]
    covered: Sequence[float]


Noting = Callable[[int], contextlib.AbstractContextManager[None]]


class _BatchRows:
    """Features of a batch, and what is found of them."""

    def __init__(self, batch: EstimateBatch) -> None:
        twins, features, self.owners, self.missing, self.covered = batch
        self.twins, self.features = list(twins), features
        self.states = st.blank(len(features))
        self.notices: list[list[Notice]] = [[] for _ in twins]
        self.details: list[Detail | None] = [None] * len(features)
        self.failed: dict[int, str] = {}

    def estimate(self, rows: Sequence[int], budget: WorkBudget) -> None:
        """Estimate some rows in one step."""
        places = sorted({self.owners[row] for row in rows})
        among = {place: number for number, place in enumerate(places)}
        found = budget.run(
            lambda: estimate(
                [self.twins[place] for place in places],
                [self.features[row] for row in rows],
                [among[self.owners[row]] for row in rows],
                [self.missing[row] for row in rows],
                [self.covered[row] for row in rows],
            ),
            len(rows),
            sum(
                len(self.twins[self.owners[row]].registration.parameters or ()) for row in rows
            ),
        )
        self.states[list(rows)] = found.states
        for place, checkpoint, seen in zip(
            places, found.checkpoints, found.notices, strict=True
        ):
            self.twins[place] = self.twins[place]._replace(checkpoint=checkpoint)
            self.notices[place] += [notice._replace(row=rows[notice.row]) for notice in seen]
        for row, detail in zip(rows, found.details, strict=False):
            self.details[row] = detail

    def leave_out(self, row: int, why: str) -> None:
        """Give a row a state that says nothing but that it was set aside."""
        features, state = self.features[row], self.states[row : row + 1]
        state["sequence"], state["t_ns"] = features.sequence, features.t_ns
        state["slow_time"], state["missing_before"] = features.slow_time, self.missing[row]
        state["reasons"] = st.SET_ASIDE
        st.note_coverage(state, [self.covered[row]])
        self.failed[row] = why

    def found(self) -> Estimates:
        """Return all estimates."""
        some = any(detail is not None for detail in self.details)
        checkpoints = [twin.checkpoint for twin in self.twins]
        return Estimates(self.states, checkpoints, self.notices, self.details if some else ())


def estimate_apart(
    batch: EstimateBatch,
    budget: WorkBudget,
    *,
    aside: Collection[int] = (),
    alone: Collection[int] = (),
    noted: Noting = lambda _row: contextlib.nullcontext(),
    advance: Callable[[], None] = lambda: None,
) -> Isolated:
    """Estimate the states of twins, as `estimate` does, without the rows that fail.

    Parameters
    ----------
    batch
        Twins and their features.
    budget
        Of each step.
    aside
        Rows that are known to fail, and not tried.
    alone
        Rows that are tried alone.
    noted
        Notes such a row while it is tried.
    advance
        Called after each step.

    Returns
    -------
    Estimates; rows that were left out have `SET_ASIDE` among the reasons of their states.
    """
    rows = _BatchRows(batch)
    slow = any(twin.registration.changes == "elements" for twin in batch.twins)
    size = PART if slow else max(len(batch.features), 1)
    part: list[int] = []

    def end_part() -> None:
        if part:
            _estimate_part(rows, part, budget, advance)
            part.clear()

    for row in range(len(batch.features)):
        if row in aside:
            rows.leave_out(row, ASIDE_BEFORE)
        elif row in alone:
            end_part()
            with noted(row):
                _estimate_part(rows, [row], budget, advance)
        else:
            part.append(row)
            if len(part) >= size:
                end_part()
    end_part()
    return Isolated(rows.found(), rows.failed)


def _estimate_part(
    batch: _BatchRows, rows: Sequence[int], budget: WorkBudget, advance: Callable[[], None]
) -> None:
    """Estimate some rows; where that fails, each twin's, and then one by one."""
    try:
        batch.estimate(rows, budget)
    except Exception as error:
        of_twin: dict[int, list[int]] = {}
        for row in rows:
            of_twin.setdefault(batch.owners[row], []).append(row)
        if len(rows) == 1:
            why = str(error) if isinstance(error, OverBudgetError) else _failure(error)
            batch.leave_out(rows[0], why)
            return
        parts = [*of_twin.values()] if len(of_twin) > 1 else [[row] for row in rows]
        for part in parts:
            _estimate_part(batch, part, budget, advance)
    finally:
        advance()


def _failure(error: Exception) -> str:
    logger.error("Features could not be estimated.", exc_info=error)
    return f"the server failed on it: {error!r:.300}"

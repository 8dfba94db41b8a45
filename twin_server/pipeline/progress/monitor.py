"""Judges whether the pipeline goes on; where it does not, the server resigns and ends.

Something waits and nothing is finished: the stacks of all threads are logged, `/readyz` and
`/healthz` answer 503, the claim to lead is released, and the process ends, so that another
server or its own restart goes on. Time is counted in looks of this monitor, so that neither a
stopped process nor a clock that is set counts as standing still.
"""

import logging
import os
from collections.abc import Callable

from slowtime_services.supervision import all_stacks, notify
from twin_server.settings import ProgressSettings

from .budget import WorkBudget
from .phases import Phase, Progress

logger = logging.getLogger(__name__)

ENDING_S = 2.0
"""From the release of the claim to the end of the process [s]: `/readyz` is asked meanwhile."""

MOVING = 0.01
"""Share of a core with which a step counts as moving [1]; a busy computer leaves as little."""

EXIT_STATUS = 70
"""Exit status of a server that stood still: EX_SOFTWARE of sysexits.h."""


class ProgressMonitor:
    """Looks at the pipeline in fixed intervals.

    Parameters
    ----------
    settings
        How long it may stand still.
    progress, budget
        Of the pipeline.
    waiting
        Whether something waits to be worked.
    stalled
        Called once with a sentence, when it stands still, and with whether a message is the
        reason; not from the thread of the pipeline.
    look_s
        Interval of `look` [s].
    end
        Ends the process; None where it is not ours to end.
    """

    def __init__(
        self,
        settings: ProgressSettings,
        progress: Progress,
        budget: WorkBudget,
        waiting: Callable[[], bool],
        stalled: Callable[[str, bool], None],
        *,
        look_s: float,
        end: Callable[[int], None] | None = os._exit,
    ) -> None:
        self._settings, self._progress, self._budget = settings, progress, budget
        self._waiting, self._stalled, self._end = waiting, stalled, end
        self._look_s = look_s
        self._seen, self._used_s = -1, 0.0
        self._still_s, self._since_s = 0.0, 0.0
        self.trouble = ""

    def look(self) -> bool:
        """Look once; return whether the pipeline goes on."""
        if self.trouble:
            self._since_s += self._look_s
            if self._since_s >= ENDING_S and self._end is not None:
                logging.shutdown()
                self._end(EXIT_STATUS)
            return False
        if self._moves():
            self._still_s = 0.0
            return True
        self._still_s += self._look_s
        limit_s = self._limit_s()
        if self._still_s >= limit_s / 2:
            self._budget.interrupt(f"it did not go on for {limit_s / 2:.3g} s")
        if self._still_s >= limit_s:
            self._give_up()
        return not self.trouble

    def _limit_s(self) -> float:
        """Return how long this phase may stand still [s]."""
        stepping = self._progress.phase is Phase.STEP
        return self._settings.silent_s if stepping else self._settings.store_s

    def _moves(self) -> bool:
        """Whether something was finished, nothing waits, or a step uses its budget."""
        seen, self._seen = self._seen, self._progress.finished
        used_s, before_s = self._budget.used_s(), self._used_s
        self._used_s = used_s or 0.0
        if self._seen != seen:
            return True
        if self._progress.phase is Phase.IDLE and not self._waiting():
            return True
        return used_s is not None and used_s - before_s >= MOVING * self._look_s

    def _give_up(self) -> None:
        phase = self._progress.phase
        self.trouble = (
            f"Nothing was finished for {self._still_s:.0f} s while the pipeline "
            f"{phase.value}. Another server leads, and this one ends. The stacks of its "
            "threads are in the log."
        )
        logger.critical("%s\n%s", self.trouble, all_stacks())
        notify("STATUS=No progress; ending.")
        self._stalled(self.trouble, phase is Phase.STEP)

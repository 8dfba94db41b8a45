"""A budget of processor time for steps that can be interrupted.

A step runs in the thread of the pipeline. Another thread reads the processor time that it has
used, and raises an exception in it beyond the budget (`PyThreadState_SetAsyncExc`). Processor
time, not time by the clock: a busy computer makes no message guilty. Only arithmetic is run
like this, which holds no lock and no transaction; what else a message leads to is watched
(`monitor`), and not interrupted. The decision on progress and budgets of work says why.
"""

import ctypes
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from twin_server.settings import ProgressSettings

from .phases import Phase, Progress

LOOK_S = 0.1
"""How often a running step is looked at [s]; small beside any budget."""

IDLE_S = 5.0
"""After which the thread that looks at steps ends, until there is a step again [s]."""

AGAIN_S = 2.0
"""After which the exception is raised again in a step that caught it [s]."""

T = TypeVar("T")


class OverBudgetError(RuntimeError):
    """A step took more than its budget, and was interrupted."""


class _Interruption(BaseException):
    """Raised in a step from outside; no `except Exception` of the step catches it."""


class _Step:
    """A step that runs now."""

    def __init__(self, limit_s: float) -> None:
        self.thread = threading.get_ident()
        self.limit_s, self.why = limit_s, ""
        self._clock = _processor_clock(self.thread)
        self._began_s = self._clock()

    def used_s(self) -> float:
        """Processor time so far [s]."""
        return self._clock() - self._began_s


class WorkBudget:
    """Runs steps, one at a time, and interrupts those beyond their budget.

    Parameters
    ----------
    settings
        Of which the budget follows.
    progress
        Told that a step is being worked.
    """

    def __init__(self, settings: ProgressSettings, progress: Progress | None = None) -> None:
        self._settings, self._progress = settings, progress or Progress()
        self._step: _Step | None = None
        self._lock, self._some = threading.Lock(), threading.Event()
        self._guard: threading.Thread | None = None

    def run(self, step: Callable[[], T], messages: int = 1, parameters: int = 0) -> T:
        """Return what a step returns.

        Parameters
        ----------
        step
            Arithmetic that may be interrupted anywhere.
        messages
            How many messages it works; the budget grows with them.
        parameters
            Free parameters of twins of elements, summed over these messages.

        Raises
        ------
        OverBudgetError
            If it was interrupted.
        """
        if self._step is not None:
            return step()  # within another step, whose budget is for both
        settings = self._settings
        limit_s = settings.step_s + settings.step_s_per_message * messages
        running = _Step(limit_s + settings.step_s_per_parameter * parameters)
        with self._progress.doing(Phase.STEP):
            self._watch(running)
            try:
                try:
                    return step()
                finally:
                    self._release(running)
            except _Interruption:
                self._release(running)
                raise OverBudgetError(running.why) from None

    def used_s(self) -> float | None:
        """Processor time of the step that runs now [s]; None where there is none."""
        step = self._step
        return None if step is None else step.used_s()

    def interrupt(self, why: str) -> None:
        """Interrupt the step that runs now, if there is one."""
        with self._lock:
            if self._step is not None:
                self._raise_in(self._step, why)

    def _watch(self, running: _Step) -> None:
        with self._lock:
            self._step = running
            self._some.set()
            if self._guard is None:
                self._guard = threading.Thread(target=self._look, name="budget", daemon=True)
                self._guard.start()

    def _release(self, running: _Step) -> None:
        with self._lock:
            self._step = None
            self._some.clear()
            if running.why:  # it may not have come yet, and must not come later
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(running.thread), None)

    def _look(self) -> None:
        raised_s = 0.0
        while True:
            if not self._some.wait(IDLE_S):
                with self._lock:
                    if not self._some.is_set():
                        self._guard = None
                        return
            time.sleep(LOOK_S)
            with self._lock:
                step = self._step
                if step is None or step.used_s() <= step.limit_s:
                    continue
                if not step.why or time.monotonic() - raised_s > AGAIN_S:
                    raised_s = time.monotonic()
                    self._raise_in(
                        step, f"it took more than {step.limit_s:.3g} s of processor time"
                    )

    @staticmethod
    def _raise_in(step: _Step, why: str) -> None:
        step.why = step.why or why
        ctypes.pythonapi.PyThreadState_SetAsyncExc(
            ctypes.c_ulong(step.thread), ctypes.py_object(_Interruption)
        )


def _processor_clock(thread: int) -> Callable[[], float]:
    """Return the clock of a thread's processor time; of time itself where there is none."""
    try:
        clock = time.pthread_getcpuclockid(thread)
    except AttributeError:  # not on every system
        return time.monotonic
    return lambda: time.clock_gettime(clock)

"""The assess stage: virtual quantities of blocks, fatigue of stresses, and their messages."""

import dataclasses
import logging
from collections.abc import Mapping

from edge_agent.settings import EdgeSettings, Origin
from slowtime.signals.block import Block
from slowtime_schemas.messages import Fatigue, Virtual

from .fatigue import CycleCount, Point
from .virtual_sensors import RunningSensor, VirtualStage

logger = logging.getLogger(__name__)

AssessMessage = Fatigue | Virtual


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class AssessState:
    """State of the stage: running sensors, cycle counts, and the number of messages made."""

    channels: tuple[str, ...] = ()
    """Of the last block."""
    running: RunningSensor | None = None
    counted: Mapping[str, CycleCount] = dataclasses.field(default_factory=dict)
    first_ns: int | None = None
    latest_ns: int = 0
    told_ns: int | None = None
    fatigue_sequence: int = 0
    virtual_sequence: int = 0


class Assess:
    """Makes virtual quantities and counts fatigue.

    Raises `ValueError` where the model file cannot be used, or an output is none of the
    model's.
    """

    def __init__(self, settings: EdgeSettings, origin: Origin) -> None:
        self._settings, self._origin = settings, origin
        self._virtual = (
            None if settings.virtual is None else VirtualStage(settings.virtual, origin)
        )
        self._points = [Point(point) for point in settings.fatigue.points]
        self._outputs = (
            {} if settings.virtual is None
            else {one.name: i for i, one in enumerate(settings.virtual.outputs)}
        )  # fmt: skip

    def start(self) -> AssessState:
        """Begin with nothing seen."""
        return AssessState()

    def step(
        self, state: AssessState, block: Block
    ) -> tuple[AssessState, tuple[AssessMessage, ...]]:
        """Take one conditioned block; give the messages that are due."""
        if state.channels != block.channels:
            self._report_unknown_points(block)
        counted = dict(state.counted)
        messages: list[AssessMessage] = []
        running, sequence = state.running, state.virtual_sequence
        if self._virtual is not None:
            running, windows, told = self._virtual.step(running, block, sequence)
            messages += told
            sequence += len(told)
            for point in self._points:
                output = self._outputs.get(point.settings.at)
                if output is None:
                    continue
                for window in windows:
                    counted[point.settings.at] = point.step(
                        counted.get(point.settings.at, CycleCount()),
                        window.values[window.settled, output],
                        block.true_rate_hz,
                        self._virtual.units[point.settings.at],
                        missing=float(window.missing_variance[output]),
                        wrong=float(window.model_variance[output]),
                        reasons=window.reasons,
                    )
        for point in self._points:
            at = point.settings.at
            if at in self._outputs:
                continue
            if at not in block.channels:
                continue
            column = block.channels.index(at)
            counted[at] = point.step(
                counted.get(at, CycleCount()),
                block.samples[:, column].astype(float),
                block.true_rate_hz,
                block.units[column],
            )
        state = dataclasses.replace(
            state,
            channels=block.channels,
            running=running,
            counted=counted,
            first_ns=block.start_ns if state.first_ns is None else state.first_ns,
            latest_ns=block.end_ns,
            told_ns=block.start_ns if state.told_ns is None else state.told_ns,
            virtual_sequence=sequence,
        )
        assert state.told_ns is not None
        if block.end_ns - state.told_ns >= self._settings.fatigue.every_s * 1e9:
            state, due = self._tell(state)
            messages += due
        return state, tuple(messages)

    def _report_unknown_points(self, block: Block) -> None:
        """Log the points of fatigue that blocks of these channels do not have."""
        known = (*block.channels, *self._outputs)
        unknown = [p.settings.at for p in self._points if p.settings.at not in known]
        if unknown:
            logger.error(
                "Fatigue is asked at %s, which is no channel and no virtual output; it is not "
                "counted there. Allowed in fatigue.points[].at: %s.",
                ", ".join(map(repr, unknown)),
                ", ".join(known),
            )

    def finish(self, state: AssessState) -> tuple[AssessState, tuple[AssessMessage, ...]]:
        """Make the fatigue message at the end of the stream."""
        if state.told_ns is None or state.latest_ns == state.told_ns:
            return state, ()
        return self._tell(state)

    def _tell(self, state: AssessState) -> tuple[AssessState, tuple[AssessMessage, ...]]:
        points = tuple(
            point.told(
                state.counted[point.settings.at], virtual=point.settings.at in self._outputs
            )
            for point in self._points
            if point.settings.at in state.counted
        )
        state = dataclasses.replace(state, told_ns=state.latest_ns)
        if not points or state.first_ns is None:
            return state, ()
        message = Fatigue(
            site=self._origin.site,
            asset=self._origin.asset,
            boot=self._origin.boot,
            time_base=self._origin.time_base,
            sequence=state.fatigue_sequence,
            start_ns=state.first_ns,
            t_ns=state.latest_ns,
            points=points,
        )
        return dataclasses.replace(state, fatigue_sequence=state.fatigue_sequence + 1), (
            message,
        )

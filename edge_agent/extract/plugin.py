"""Reads one window by an installed identifier, in a process of its own."""

import dataclasses
import functools
import logging

from pydantic import TypeAdapter, ValidationError

from edge_agent.settings import ExtractSettings
from slowtime.identification.estimates import Measured
from slowtime_schemas.messages import Mode, Smoothed
from slowtime_services.plugins.discovery import PluginError, find
from slowtime_services.plugins.plugin_process import PluginProcess

from .reader import Memory, ModeReading, Window, doubts, quantity, smooth, with_clock

logger = logging.getLogger(__name__)

GROUP = "slowtime.identifiers"
_MODES: TypeAdapter[tuple[Mode, ...]] = TypeAdapter(tuple[Mode, ...])


@dataclasses.dataclass(frozen=True, slots=True)
class PluginIdentifier:
    """Calls an installed part; if it fails or hangs, only the window is lost."""

    settings: ExtractSettings
    name: str

    def step(self, memory: Memory, window: Window) -> tuple[Memory, ModeReading]:
        """Read a window; the frequency of its first mode is smoothed."""
        try:
            told = _process(self.name).ask(
                window.rows,
                window.rate_hz,
                window.channels,
                timeout_s=self.settings.identifier_timeout_s,
            )
            modes = _MODES.validate_python([] if told is None else told)
        except PluginError as error:
            logger.error("%s", error)
            return memory, ModeReading(channels=window.channels, why=("failed",))
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            where = ".".join(map(str, fault["loc"])) or "answer"
            logger.error(
                "%s gave no modes: %s: %s.", find(GROUP, self.name), where, fault["msg"]
            )
            return memory, ModeReading(channels=window.channels, why=("not_credible",))
        if not modes:
            return memory, ModeReading(channels=window.channels, why=("no_mode",))
        own = [Measured(mode.frequency_hz.value, mode.frequency_hz.sd) for mode in modes]
        memory, smoothed = smooth(memory, 0, own[0], self.settings, window.clock)
        told_of: list[dict[str, Smoothed | None]] = [{"smoothed_frequency_hz": smoothed}] + [
            {}
        ] * (len(modes) - 1)
        known = tuple(
            mode.model_copy(
                update={"frequency_hz": quantity(with_clock(frequency, window.clock)), **more}
            )
            for mode, frequency, more in zip(modes, own, told_of, strict=True)
        )
        # The message knows four methods by name; which part it was stands in `About`.
        doubted = ("own_identifier", *doubts(own, window.clock))
        return memory, ModeReading(known, "ambient", window.channels, doubts=doubted)


@functools.lru_cache(maxsize=8)
def _process(name: str) -> PluginProcess:
    """Keep the process from window to window; it ends with this one."""
    return PluginProcess(find(GROUP, name))

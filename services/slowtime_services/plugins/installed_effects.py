"""Installed kinds of effect, each tried in a process of its own."""

from .discovery import exception_text, find
from .effect_trial import GROUP, PATIENCE_S
from .plugin_process import PluginProcess


def installed_kinds(name: str, patience_s: float = PATIENCE_S) -> tuple[str, ...]:
    """Try an installed part in a process of its own; the names of its kinds.

    Raises
    ------
    PluginError
        (a ValueError) where it is not installed, raised, did not come back, or gave nonsense.
    """
    process = PluginProcess(find(GROUP, name), starting_s=patience_s)
    try:
        return tuple(map(str, process.ask(timeout_s=patience_s)))
    finally:
        process.close()


def sound_parts(names: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Try installed parts; names of those that passed, and a sentence for each other."""
    passed, faults = [], []
    for name in names:
        try:
            installed_kinds(name)
        except ValueError as error:
            fault = str(error) if str(error) else exception_text(error)
            faults.append(f"{fault.rstrip('.')}. It was left out.")
        else:
            passed.append(name)
    return tuple(passed), tuple(faults)

"""Kinds of effect in a user's Python file or in an installed part."""

import functools
import importlib.util
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType

from slowtime.dynamics.effects import Friction, Kind, Law, catalogue
from slowtime.dynamics.effects.compilation import law_address

from .discovery import find


class EffectFileError(ValueError):
    """A file that holds no kind of effect, or one that cannot be used."""


def load(path: str | Path) -> tuple[Kind, ...]:
    """Run a Python file, and take every `Kind` that it names at its top level.

    The file is code, and runs with the rights of whoever runs slowtime: load your own only.

    Raises
    ------
    EffectFileError
        (a ValueError) where it fails, holds no kind, or holds a law that cannot be compiled.
    """
    path = Path(path)
    spec = importlib.util.spec_from_file_location(f"slowtime_own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise EffectFileError(f"{path.name} is not a Python file. Give one that ends in .py.")
    module = importlib.util.module_from_spec(spec)
    # Compiled laws are kept on disk, and ask for their module by its name when they come back.
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except OSError:
        raise
    except Exception as error:
        raise EffectFileError(f"{path.name} fails: {type(error).__name__}: {error}") from error
    return _compiled(path.name, vars(module).values())


def load_installed(name: str) -> tuple[Kind, ...]:
    """Import the part of `slowtime.effects` of that name, and take its kinds.

    It runs in this process: see `effect_trial` for one that may be ended.

    Raises
    ------
    PluginError, EffectFileError
        (a ValueError) where it is not installed, cannot be imported, or holds no kind, or one
        that cannot be compiled.
    """
    plugin = find("slowtime.effects", name)
    return kinds_in(str(plugin), plugin.load())


def kinds_in(name: str, part: object) -> tuple[Kind, ...]:
    """Return the kinds of an entry point: one kind, several, or those of a module.

    Raises
    ------
    EffectFileError
        (a ValueError) where it holds none, or one that cannot be compiled.
    """
    held = vars(part).values() if isinstance(part, ModuleType) else part
    return _compiled(name, held if isinstance(held, Iterable) else (held,))


@functools.lru_cache(maxsize=8)
def kinds_for(effects: frozenset[str], own: tuple[str, ...]) -> Mapping[str, Kind]:
    """Kinds by name: the catalogue's, and those of installed parts where they are needed.

    Parameters
    ----------
    effects
        Names of the kinds that are wanted, such as those in a model.
    own
        Installed parts that may be imported into this process.
    """
    ours = catalogue()
    return ours if effects <= ours.keys() else known(own)


def known(own: Iterable[str | Path] = ()) -> Mapping[str, Kind]:
    """Every kind: the catalogue, and those in files of the user's own, or installed.

    Parameters
    ----------
    own
        Python files, or names of installed parts, which have no dot.
    """
    named = [
        kind
        for one in own
        for kind in (load(one) if Path(one).suffix else load_installed(str(one)))
    ]
    return _together(named)


def _together(own: list[Kind]) -> Mapping[str, Kind]:
    try:
        return catalogue(own)
    except ValueError as error:
        raise EffectFileError(str(error)) from None


def _laws(kind: Kind) -> tuple:  # type: ignore[type-arg]
    if isinstance(kind.action, Friction):
        return (kind.action.limit,)
    return (kind.action.force, *kind.action.rates) if isinstance(kind.action, Law) else ()


def _compiled(name: str, held: Iterable[object]) -> tuple[Kind, ...]:
    """Keep the kinds of effect of a plug-in, their laws compiled."""
    kinds = tuple(value for value in held if isinstance(value, Kind))
    if not kinds:
        raise EffectFileError(
            f"{name} holds no kind of effect. Put `KIND = Kind(...)` into it."
        )
    try:
        for kind in kinds:
            for law in _laws(kind):
                law_address(law)
    except ValueError as error:
        raise EffectFileError(f"{name}: {error}") from None
    return kinds

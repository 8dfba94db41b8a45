"""A Python file of a user's own in, the kinds of effect that it holds out."""

import importlib.util
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from slowtime.dynamics.effects import Friction, Kind, Law, catalogue
from slowtime.dynamics.effects.compiled import law_address


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
        raise EffectFileError(f"{path.name} is no Python file. Give one that ends in .py.")
    module = importlib.util.module_from_spec(spec)
    # Compiled laws are kept on disk, and ask for their module by its name when they come back.
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except OSError:
        raise
    except Exception as error:
        raise EffectFileError(f"{path.name} fails: {type(error).__name__}: {error}") from error
    kinds = tuple(value for value in vars(module).values() if isinstance(value, Kind))
    if not kinds:
        raise EffectFileError(
            f"{path.name} holds no kind of effect. Put `KIND = Kind(...)` into it."
        )
    try:
        for kind in kinds:
            for law in _laws(kind):
                law_address(law)
    except ValueError as error:
        raise EffectFileError(f"{path.name}: {error}") from None
    return kinds


def known(paths: Iterable[str | Path] = ()) -> Mapping[str, Kind]:
    """Every kind: the catalogue, and those in files of the user's own."""
    own = [kind for path in paths for kind in load(path)]
    try:
        return catalogue(own)
    except ValueError as error:
        raise EffectFileError(str(error)) from None


def _laws(kind: Kind) -> tuple:  # type: ignore[type-arg]
    if isinstance(kind.action, Friction):
        return (kind.action.limit,)
    return (kind.action.force, *kind.action.rates) if isinstance(kind.action, Law) else ()

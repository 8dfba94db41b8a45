"""The catalogue of physical effects."""

import dataclasses
from typing import Any

from slowtime.dynamics.effects import Kind
from slowtime_services.argument_checks import checked
from slowtime_services.plugins.effect_kinds import known

from .results import Result


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class EffectCatalogue(Result):
    """Kinds of effects that a model may hold and a diagnosis may name.

    Parameters
    ----------
    kinds
        By name: equation, meaning, place, and parameters with unit, range and default.
    """

    kinds: dict[str, Kind]

    def __len__(self) -> int:
        return len(self.kinds)

    def __contains__(self, name: object) -> bool:
        return name in self.kinds

    def __getitem__(self, name: str) -> Kind:
        """Return the kind of a name.

        Raises
        ------
        KeyError
            If there is none.
        """
        return self.kinds[name]

    @property
    def heading(self) -> str:
        """How many there are, in a line."""
        return f"{len(self)} effects"

    def rows(self) -> list[dict[str, Any]]:
        """Return each effect.

        Returns
        -------
        One dictionary per effect: ``name``, ``title``, ``where`` (the place that it sits on),
        ``equation`` and ``parameters`` with their units.
        """
        return [
            {
                "name": kind.name, "title": kind.title, "where": kind.where,
                "equation": kind.equation,
                "parameters": ", ".join(
                    f"{one.name} [{one.unit}]" if one.unit else one.name
                    for one in kind.parameters
                ),
            }
            for kind in self.kinds.values()
        ]  # fmt: skip


@checked
def effects(*names: str) -> EffectCatalogue:
    """List the physical effects that slowtime knows, those of plug-ins included.

    Parameters
    ----------
    *names
        Names of effects; all where none is given.

    Returns
    -------
    The effects, as the catalogue orders them.

    Raises
    ------
    ValueError
        If there is no effect of a name.

    Examples
    --------
    >>> effects("coulomb").rows()[0]["parameters"]
    'friction_n [N]'
    >>> "bouc_wen" in effects()
    True
    """
    every = known(())
    unknown = [name for name in names if name not in every]
    if unknown:
        raise ValueError(f"There is no effect {unknown[0]!r}. Allowed: {', '.join(every)}.")
    return EffectCatalogue(kinds={name: every[name] for name in names or every})

"""Priors of a plant's constants, from the tolerances of its description."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.plant import Name, Plant

DEFAULT_RELATIVE_SD = {"stiffness": 0.2, "damping": 1.0, "mass": 0.0}
"""[1] Relative standard deviations where a model states no tolerance; masses are weighed, and
damping is hardly ever known. Source: docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prior:
    """Normal priors and bounds of the free constants.

    Parameters
    ----------
    mean, sd
        In each one's unit; the standard deviation is infinite where nothing is known.
    scale
        Typical size of a change, in each one's unit.
    """

    names: tuple[Name, ...]
    index: tuple[int, ...]
    mean: Float[np.ndarray, " free"]
    sd: Float[np.ndarray, " free"]
    low: Float[np.ndarray, " free"]
    high: Float[np.ndarray, " free"]
    scale: Float[np.ndarray, " free"]

    def cost(self, values: Float[np.ndarray, " free"]) -> float:
        """Sum of squared deviations from the means, in standard deviations."""
        return float(np.sum(((values - self.mean) / self.sd) ** 2))


def prior_of(plant: Plant, free: Sequence[Name] | None = None, within: float = np.inf) -> Prior:
    """Read the priors of a plant from the tolerances of its description.

    Parameters
    ----------
    free
        Names of the constants that may move; where not given, all that are claimed with a
        tolerance above zero, and all fitted parameters of effects. What the model claims
        nothing about moves by `DEFAULT_RELATIVE_SD`.
    within
        Tolerances by which constants of the structure may move at most.

    Raises
    ------
    ValueError
        Where the plant has no constant of a given name.
    """
    names, index, sds = [], [], []
    for i, (name, entry) in enumerate(plant.entries.items()):
        sd = entry.sd
        if np.isinf(sd) and name[0] != "effect":
            sd = DEFAULT_RELATIVE_SD[str(name[0])] * abs(entry.value)
        wanted = entry.fitted and sd > 0 if free is None else name in free
        if wanted:
            names.append(name)
            index.append(i)
            sds.append(sd if sd > 0 else np.inf)
    unknown = set(free or ()) - set(plant.entries)
    if unknown:
        raise ValueError(
            f"There is no {sorted(map(str, unknown))[0]} in the plant. There are: "
            f"{', '.join(map(str, plant.entries))}."
        )
    entries = [plant.entries[name] for name in names]
    mean, spread = np.array([e.value for e in entries]), np.array(sds)
    reach = np.array([np.inf if name[0] == "effect" else within for name in names])
    with np.errstate(invalid="ignore"):
        room = np.where(np.isinf(reach), np.inf, reach * spread)
    return Prior(
        names=tuple(names),
        index=tuple(index),
        mean=mean,
        sd=spread,
        low=np.maximum([e.low for e in entries], mean - room),
        high=np.minimum([e.high for e in entries], mean + room),
        scale=np.where(mean != 0, np.abs(mean), np.where(np.isfinite(spread), spread, 1.0)),
    )

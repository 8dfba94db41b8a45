"""Response of a twin to a load."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime_services.argument_checks import checked

from .plotting import Axes, new_figure, save
from .results import Result

Series = Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TwinResponse(Result):
    """Response of each node of a twin to a load, by the uncertainty of its present estimates.

    Parameters
    ----------
    time_s
        Times [s].
    load
        Load at each time: acceleration of the base [m/s^2], or force [N].
    quantity, unit
        Quantity of the response, and its unit.
    value, sd, lo, hi
        By node: mean over the structures drawn, standard deviation, and ends of the band.
    peak, rms
        By node: largest magnitude and root mean square, each with value, sd, lo and hi.
    assumed
        Quantities that were assumed, not estimated.
    reasons
        Why the twin is not valid, in sentences.
    """

    time_s: Series
    load: Series
    quantity: str
    unit: str
    value: dict[str, Series]
    sd: dict[str, Series]
    lo: dict[str, Series]
    hi: dict[str, Series]
    peak: dict[str, dict[str, float]]
    rms: dict[str, dict[str, float]]
    assumed: tuple[str, ...]
    reasons: tuple[str, ...]

    @classmethod
    @checked
    def of(cls, body: Mapping[str, Any]) -> "TwinResponse":
        """Make one of the answer of a server to a simulation.

        Parameters
        ----------
        body
            Answer, as `simulate` of a client returns it.

        Returns
        -------
        The response.
        """
        nodes = body["outputs"]
        series = {
            part: {name: np.array(one[part], dtype=float) for name, one in nodes.items()}
            for part in ("value", "sd", "lo", "hi")
        }
        return cls(
            time_s=np.array(body["t_s"], dtype=float), load=np.array(body["load"], dtype=float),
            quantity=body["quantity"], unit=body["unit"],
            peak={name: one["peak"] for name, one in nodes.items()},
            rms={name: one["rms"] for name, one in nodes.items()},
            assumed=tuple(body["assumed"]), reasons=tuple(body["reasons"]), **series,
        )  # fmt: skip

    @property
    def heading(self) -> str:
        """What was simulated, in a line."""
        return f"Response of a twin: {self.quantity} [{self.unit}], {self.time_s[-1]:g} s"

    def rows(self) -> list[dict[str, Any]]:
        """Return peak and root mean square of each node.

        Returns
        -------
        One dictionary per node and measure: ``node``, ``measure``, ``value``, ``sd``, ``lo``
        and ``hi``.
        """
        return [
            {"node": name, "measure": measure}
            | {part: found[part] for part in ("value", "sd", "lo", "hi")}
            for name in self.value
            for measure, found in (("peak", self.peak[name]), ("rms", self.rms[name]))
        ]

    @checked
    def plot(self, path: str | Path | None = None) -> list[Axes]:
        """Draw the response of each node with its band.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes, one for each node.
        """
        axes = new_figure(len(self.value))
        for panel, name in zip(axes, self.value, strict=True):
            panel.fill_between(self.time_s, self.lo[name], self.hi[name], alpha=0.3)
            panel.plot(self.time_s, self.value[name])
            panel.set(xlabel="time [s]", ylabel=f"{self.quantity} [{self.unit}]", title=name)
        return list(save(axes, path))

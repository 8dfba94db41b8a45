"""Positions of sensors that tell most about the parameters of a model."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from slowtime.evolution.assessment import (
    AssessmentSettings,
    DetectionLimit,
    expected_modes,
    plan_limits,
)
from slowtime.evolution.structures import (
    ModePrecision,
    PlacementProblem,
    ReducedStructure,
    place_sensors,
    updatable_model,
)
from slowtime.finite_elements.degrees_of_freedom import DIRECTIONS, DofMap
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_services.argument_checks import Count, Positive, Share, checked
from slowtime_services.assessment import members_of
from slowtime_services.matrices import MatrixFileError, MatrixModel

from .matrix_models import Direction, FiniteElementModel

Candidate = tuple[str, tuple[str, ...]]
"""Node (or channel) and directions of a site."""
Parameters = Float[np.ndarray, " parameter"]

POORLY_IDENTIFIABLE = 0.5
"""Posterior over prior standard deviation [1] above which a parameter is named: more than half
of what was not known beforehand is still not known."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PlacedSensors(Result):
    """Chosen positions, and what they will tell about each parameter.

    Parameters
    ----------
    sites
        Node, or channel of a sensor that is kept, and directions of each site, in the order of
        what they add.
    parameters
        Names of the parameters.
    prior_sd, posterior_sd
        Standard deviation of the logarithm of each factor before and after the test [1].
    evenly_spread_sd
        The same after a test with as many evenly spread sensors [1].
    limits, evenly_spread_limits
        With the criterion ``"detection"``, the smallest loss of each member that ``assess``
        will find with the chosen sensors, and with evenly spread ones; else empty.
    """

    sites: tuple[Candidate, ...]
    parameters: tuple[str, ...]
    prior_sd: Parameters
    posterior_sd: Parameters
    evenly_spread_sd: Parameters
    limits: tuple[DetectionLimit, ...] = ()
    evenly_spread_limits: tuple[DetectionLimit, ...] = ()

    @property
    def heading(self) -> str:
        """What was placed, in a line."""
        places = "; ".join(" ".join((site, *ways)) for site, ways in self.sites)
        return f"{len(self.sites)} sites in the order of what they add: {places}"

    @property
    def poorly_identifiable(self) -> tuple[str, ...]:
        """Parameters of which more than half of the prior standard deviation remains."""
        ratio = self.posterior_sd / self.prior_sd
        named = zip(self.parameters, ratio, strict=True)
        return tuple(name for name, one in named if one > POORLY_IDENTIFIABLE)

    def rows(self) -> list[dict[str, Any]]:
        """Return each parameter.

        Returns
        -------
        One dictionary per parameter: ``parameter``, ``prior_sd``, ``posterior_sd`` and
        ``evenly_spread_sd`` [1].
        """
        columns = (self.prior_sd, self.posterior_sd, self.evenly_spread_sd)
        keys = ("parameter", "prior_sd", "posterior_sd", "evenly_spread_sd")
        rows = zip(self.parameters, *(column.tolist() for column in columns), strict=True)
        return [dict(zip(keys, row, strict=True)) for row in rows]

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the standard deviation of each parameter before and after.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        at = np.arange(len(self.parameters))
        for shift, name in enumerate(("prior_sd", "evenly_spread_sd", "posterior_sd")):
            label = name.replace("_", " ")
            axes.bar(at + 0.27 * (shift - 1), getattr(self, name), width=0.25, label=label)
        axes.set_xticks(at, self.parameters)
        axes.set(ylabel="standard deviation of a parameter [1]")
        axes.legend()
        return save(axes, path)


@checked
def place(
    model: FiniteElementModel | str | Path,
    sensors: Count,
    *,
    modes: Count = 10,
    directions: Sequence[Direction] = ("ux", "uy", "uz"),
    together: bool = False,
    keep: bool = False,
    frequency_sd: Positive = 0.002,
    shape_sd: Positive = 0.02,
    criterion: Literal["determinant", "variance", "detection"] = "determinant",
    power: Share = 0.9,
    settings: AssessmentSettings | None = None,
) -> PlacedSensors:
    """Choose the sensor positions that are most informative about the parameters of a model.

    Parameters
    ----------
    model
        Model with parameters and named degrees of freedom, or the path of its file.
    sensors
        Number of sensors; of sites, with `together`.
    modes
        Number of lowest modes that will be measured.
    directions
        Directions in which a sensor may measure.
    together
        Whether each site has a sensor in every direction.
    keep
        Whether the sensors of the model are there already; they count among `sensors`.
    frequency_sd
        Relative standard deviation of a measured frequency [1].
    shape_sd
        Standard deviation of a component of a shape, over its largest component [1].
    criterion
        ``"determinant"`` maximises the determinant of the information, ``"variance"``
        minimises the mean variance, ``"detection"`` the largest of the losses of single
        members that ``assess`` just finds between two measurements.
    power
        With ``"detection"``: probability with which the losses of `limits` are found, below
        0.95 [1].
    settings
        With ``"detection"``: what is assumed of model, temperature, damage and false alarms
        (``slowtime.evolution.assessment.AssessmentSettings``).

    Returns
    -------
    Sites in the order of what they add, and the expected standard deviation of each parameter;
    with ``"detection"`` also the smallest loss of each member that will be found.

    Raises
    ------
    ValueError
        If the model has no parameters or named degrees of freedom, no node is free in the
        directions, or both `together` and `keep` are given.

    References
    ----------
    .. [1] D. C. Kammer, "Sensor placement for on-orbit modal identification and correlation of
       large space structures", Journal of Guidance, Control, and Dynamics 14 (1991) 251-259.

    Examples
    --------
    >>> stiffness = np.array([[800.0, -400.0], [-400.0, 400.0]])
    >>> parts = {"k1": [[400.0, 0.0], [0.0, 0.0]], "k2": [[400, -400], [-400, 400]]}
    >>> model = FiniteElementModel.from_matrices(stiffness, np.eye(2), parts)
    >>> place(model, 1, modes=2, directions=["ux"]).sites
    (('x1', ('ux',)),)
    """
    if together and keep:
        raise ValueError("together=True and keep=True were given. Give one of them.")
    read = (
        model if isinstance(model, FiniteElementModel) else FiniteElementModel.from_file(model)
    )
    matrices, found = read.model.matrices, read.model
    if not matrices.names or matrices.dofs is None:
        raise MatrixFileError(
            f"{read.name} needs `parameters` (the quantities to identify) and `dofs` (possible "
            "sensor positions) under `matrices`."
        )
    kept = len(read.channels) if keep else 0
    rows, sites, names = _candidates(
        found, matrices.dofs, directions, together=together, keep=keep
    )
    count = min(modes, matrices.size)
    settings_of_basis = BasisSettings(
        modes=count, coordinates=min(max(100, 3 * count), matrices.size)
    )
    reduced = reduce_modal(matrices, settings_of_basis, trials=0)
    precision = ModePrecision(modes=count, frequency_sd=frequency_sd, shape_sd=shape_sd)
    problem = PlacementProblem(
        ReducedStructure(model=reduced), rows, sites, precision, found.prior_sd
    )
    fixed, spread = tuple(range(kept)), _evenly(names, sensors, kept)
    limits = None
    if criterion == "detection":
        limits = _DamagePlan(found, rows, sites, precision, power, settings)
        best = limits.placed(sensors, fixed)
    else:
        best = place_sensors(problem, sensors, fixed=fixed, criterion=criterion).sites
    after, even = problem.placement(best), problem.placement(spread)
    return PlacedSensors(
        sites=tuple(names[site] for site in best), parameters=tuple(after.names),
        prior_sd=after.prior_sd, posterior_sd=after.posterior_sd,
        evenly_spread_sd=even.posterior_sd,
        limits=limits.limits(best) if limits else (),
        evenly_spread_limits=limits.limits(spread) if limits else (),
    )  # fmt: skip


class _DamagePlan:
    """Candidate sensors, and the losses of members that are found with some of them."""

    def __init__(
        self,
        model: MatrixModel,
        rows: Float[np.ndarray, "sensor dof"],
        sites: Int[np.ndarray, " sensor"],
        precision: ModePrecision,
        power: float,
        settings: AssessmentSettings | None,
    ) -> None:
        members = members_of(model).matrices
        self._structure = updatable_model(members, precision.modes)
        self._sites, self._precision = sites, precision
        self._power, self._settings = power, settings or AssessmentSettings()
        self._expected = expected_modes(
            self._structure,
            rows,
            precision.modes,
            frequency_sd=precision.frequency_sd,
            shape_sd=precision.shape_sd,
        )
        self._rows = rows

    def placed(self, number: int, fixed: tuple[int, ...]) -> tuple[int, ...]:
        """Choose the sites of which the largest loss that is just found is least."""
        # The errors of both states are in a difference.
        differences = dataclasses.replace(
            self._precision,
            frequency_sd=math.sqrt(2.0) * self._precision.frequency_sd,
            shape_sd=math.sqrt(2.0) * self._precision.shape_sd,
        )
        problem = PlacementProblem(
            self._structure,
            self._rows,
            self._sites,
            differences,
            prior_sd=1.0,
            common_sd=self._settings.temperature_sd,
        )
        return place_sensors(problem, number, fixed=fixed, criterion="detection").sites

    def limits(self, chosen: tuple[int, ...]) -> tuple[DetectionLimit, ...]:
        """Find the smallest loss of each member that is found with sensors at some sites."""
        own, expected = np.isin(self._sites, chosen), self._expected
        if own.sum() < 2 or expected.shapes is None or expected.shape_sd is None:
            expected = dataclasses.replace(expected, shapes=None, shape_sd=None, channels=None)
        else:
            expected = dataclasses.replace(
                expected,
                shapes=expected.shapes[:, own],
                shape_sd=expected.shape_sd[:, own],
                channels=self._rows[own],
            )
        return plan_limits(self._structure, expected, self._settings, power=self._power)


def _candidates(
    read: MatrixModel, dofs: DofMap, directions: Sequence[str], *, together: bool, keep: bool
) -> tuple[np.ndarray, np.ndarray, list[Candidate]]:
    """Rows of all candidate sensors, their sites, and the names of the sites."""
    wanted = [DIRECTIONS.index(word) for word in directions]
    free = np.ones(dofs.size, dtype=bool)
    if read.matrices.expansion is not None:
        free = np.diff(read.matrices.expansion.indptr) > 0
    rows, names = [], list[Candidate]()
    if keep:
        rows += list(read.sensors)
        names += [(channel, ()) for channel in read.channels]
    for node, name in enumerate(dofs.node_names):
        own = np.flatnonzero((dofs.node == node) & free)
        found = [k for way in wanted for k in own if dofs.direction[k] == way]
        if together and len(found) < len(wanted):
            continue
        sets = [found] if together else [[k] for k in found]
        for one in sets:
            rows += [np.eye(1, dofs.size, int(k))[0] for k in one]
            names.append((name, tuple(DIRECTIONS[dofs.direction[k]] for k in one)))
    if not names:
        raise MatrixFileError(
            f"No node is free in {', '.join(directions)}. Give another direction."
        )
    each = len(wanted) if together else 1
    return np.array(rows), np.repeat(np.arange(len(names)), each), names


def _evenly(names: list[Candidate], number: int, kept: int) -> tuple[int, ...]:
    """As many sites, spread evenly over the list of candidates."""
    others = np.linspace(kept, len(names) - 1, max(number - kept, 0)).round().astype(int)
    return (*range(kept), *others.tolist())

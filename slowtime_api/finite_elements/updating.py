"""Parameters of a finite-element model from measured modes."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from slowtime.evolution.structures import (
    ShapeScatter,
    StructurePosterior,
    estimate_with_scatter,
    identifiability_limits,
    updatable_model,
)
from slowtime.evolution.structures.fit import total_misfit
from slowtime_api.arguments import existing_file
from slowtime_api.modal_estimates import Modes
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_services.argument_checks import Share, checked
from slowtime_services.matrices import MatrixFileError
from slowtime_services.matrices.measured_files import measured_modes, read_measured_modes

from .matrix_models import FiniteElementModel

UNLIKELY = 0.01
"""Probability of a misfit as large [1], below which it is told."""

Parameters = Float[np.ndarray, " parameter"]
PerMode = Float[np.ndarray, " mode"]


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class UpdatedModel(Result):
    """Parameters of a model as measured modes have them.

    Parameters
    ----------
    parameters
        Names of the parameters.
    change, sd, lo, hi
        Relative change of each [1], its standard deviation and 95 % interval.
    ratio
        Posterior over prior standard deviation: 1 where nothing was learnt [1].
    measured_hz, measured_sd_hz
        Measured natural frequencies and standard deviations, model errors included [Hz].
    as_given_hz, updated_hz
        Frequencies of the paired modes of the model before and after [Hz].
    pairs
        Mode of the model for each measured mode, counted from 0.
    p_value
        Probability of a misfit as large, if the updated model were right [1].
    not_determined
        Parameters that the modes do not determine, and why, in sentences.
    warnings
        Where the stated errors do not explain the misfit, in sentences.
    scatter
        Scatter of the measured shapes about the updated model.
    posterior
        All that is known of the parameters.
    """

    parameters: tuple[str, ...]
    change: Parameters
    sd: Parameters
    lo: Parameters
    hi: Parameters
    ratio: Parameters
    measured_hz: PerMode
    measured_sd_hz: PerMode
    as_given_hz: PerMode
    updated_hz: PerMode
    pairs: Int[np.ndarray, " mode"]
    p_value: float
    not_determined: tuple[str, ...]
    warnings: tuple[str, ...]
    scatter: ShapeScatter
    posterior: StructurePosterior

    @property
    def heading(self) -> str:
        """What was updated, in a line."""
        count = len(self.measured_hz)
        return f"Updated model: {len(self.parameters)} parameters from {count} modes"

    def rows(self) -> list[dict[str, Any]]:
        """Return each parameter.

        Returns
        -------
        One dictionary per parameter: ``parameter``, ``change``, ``sd``, ``lo``, ``hi`` and
        ``ratio`` [1].
        """
        columns = (self.change, self.sd, self.lo, self.hi, self.ratio)
        keys = ("parameter", "change", "sd", "lo", "hi", "ratio")
        rows = zip(self.parameters, *(column.tolist() for column in columns), strict=True)
        return [dict(zip(keys, row, strict=True)) for row in rows]

    def mode_rows(self) -> list[dict[str, float]]:
        """Return each measured mode.

        Returns
        -------
        One dictionary per mode: ``measured_hz``, ``sd_hz``, ``as_given_hz`` and ``updated_hz``.
        """
        columns = (self.measured_hz, self.measured_sd_hz, self.as_given_hz, self.updated_hz)
        keys = ("measured_hz", "sd_hz", "as_given_hz", "updated_hz")
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return [dict(zip(keys, row, strict=True)) for row in rows]

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the change of each parameter with its 95 % interval.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        error = [self.change - self.lo, self.hi - self.change]
        axes.errorbar(
            range(len(self.parameters)), 100 * self.change, yerr=100 * np.array(error),
            fmt="o", capsize=3,
        )  # fmt: skip
        axes.axhline(0.0, color="0.8", linewidth=0.8)
        axes.set_xticks(range(len(self.parameters)), self.parameters)
        axes.set(ylabel="change [%]")
        return save(axes, path)


@checked
def update(
    model: FiniteElementModel | str | Path,
    modes: Modes | str | Path,
    *,
    frequency_error: Share = 0.002,
    shape_error: Share = 0.02,
) -> UpdatedModel:
    """Estimate the parameters of a finite-element model from measured modes.

    Parameters
    ----------
    model
        Model with parameters, or the path of its file.
    modes
        Modes of a whole record with shapes, or the path of a modes file. Channels are paired
        with the model's sensors by name.
    frequency_error
        Relative standard deviation of frequencies due to model errors that no parameter can
        explain [1].
    shape_error
        Standard deviation of components of shapes of norm 1 due to model errors that no
        parameter can explain [1].

    Returns
    -------
    Changes of the parameters with intervals, what the modes do not determine, and frequencies
    before and after.

    Raises
    ------
    ValueError
        If the model has no parameters, or no mode is structural.

    References
    ----------
    .. [1] J. E. Mottershead and M. I. Friswell, "Model updating in structural dynamics: a
       survey", Journal of Sound and Vibration 167 (1993) 347-375.

    Examples
    --------
    >>> import slowtime as st
    >>> chain = st.Model.chain([1.0, 1.0], [360.0, 400.0], rayleigh=(0.1, 1e-4))
    >>> modes = st.identify(st.simulate(chain, rate_hz=50.0, duration_s=900.0), method="modes")
    >>> spring = {"k1": [[400.0, 0.0], [0.0, 0.0]]}
    >>> model = FiniteElementModel.from_matrices(
    ...     [[800.0, -400.0], [-400.0, 400.0]], np.eye(2), spring,
    ...     nodes=["m1", "m2"],
    ... )
    >>> found = update(model, modes)
    >>> bool(found.lo[0] < -0.1 < found.hi[0])
    True
    """
    read = (
        model if isinstance(model, FiniteElementModel) else FiniteElementModel.from_file(model)
    )
    if not read.parameters:
        raise MatrixFileError(
            f"{read.name} has no `parameters`. List there which quantities may differ from the "
            "model."
        )
    if isinstance(modes, Modes):
        measured = measured_modes(
            modes.file(), read.model, frequency_error=frequency_error, shape_error=shape_error
        )
    else:
        measured = read_measured_modes(
            existing_file(modes), read.model, frequency_error=frequency_error,
            shape_error=shape_error,
        )  # fmt: skip
    structure = updatable_model(read.model.matrices, len(measured.frequency_hz))
    found, scatter = estimate_with_scatter(structure, measured, read.model.prior_sd)
    pairs = total_misfit(structure, (measured,), found.theta, found.prior_sd).pairs
    rows = np.zeros((1, structure.size))
    before, after = (
        structure.sensed_modes(theta, rows, int(pairs.max()) + 1).frequency_hz[pairs]
        for theta in (np.zeros(len(found.theta)), found.theta)
    )
    lower, upper = found.interval()
    return UpdatedModel(
        parameters=found.names, change=found.change, sd=np.exp(found.theta) * found.sd,
        lo=lower, hi=upper, ratio=found.ratio, measured_hz=measured.frequency_hz,
        measured_sd_hz=measured.frequency_sd_hz, as_given_hz=before, updated_hz=after,
        pairs=pairs, p_value=found.p_value, scatter=scatter, posterior=found,
        not_determined=tuple(one.sentence for one in identifiability_limits(structure, found)),
        warnings=tuple(one for one in (scatter.sentence, _misfit(found)) if one),
    )  # fmt: skip


def _misfit(found: StructurePosterior) -> str:
    if found.p_value >= UNLIKELY:
        return ""
    return (
        f"The updated model does not explain the modes (p = {found.p_value:.2g}): a part "
        "without parameters is wrong, or the stated errors of frequencies and shapes are "
        "too small."
    )

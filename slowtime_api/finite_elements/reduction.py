"""Small models of finite-element matrices, with their error."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float

from slowtime.finite_elements.reduction import (
    AdaptiveModel,
    BasisSettings,
    reduce_modal,
    settings_for_band,
)
from slowtime_api.models import Model
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_services.argument_checks import Bounds, Count, Positive, checked
from slowtime_services.matrices import describe_reduced, write_reduced
from slowtime_services.models import model_file_of, write_model
from slowtime_services.wireframes import geometry_of, with_geometry

from .matrix_models import FiniteElementModel

MODEL_FILES = (".yaml", ".yml", ".json")
"""Endings of a reduced model that is written as a model file."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ReducedFiniteElements(Result):
    """A small model of a large one, and its verified error.

    Parameters
    ----------
    full
        The model that was reduced.
    reduced
        Matrices over the coordinates of the small model, with parameters and error.
    settings
        What was kept.
    frequency_hz
        Natural frequencies of the small model as built [Hz].
    """

    full: FiniteElementModel
    reduced: AdaptiveModel
    settings: BasisSettings
    frequency_hz: Float[np.ndarray, " mode"]

    @property
    def frequency_error(self) -> float | None:
        """Largest relative error of a frequency at random parameters [1]; None if not tried."""
        return None if self.reduced.error is None else self.reduced.error.frequency

    @property
    def shape_agreement(self) -> float | None:
        """Smallest mass-weighted MAC of a shape at random parameters [1]; None if not tried."""
        return None if self.reduced.error is None else self.reduced.error.agreement

    @property
    def heading(self) -> str:
        """What was reduced, in a line."""
        return f"{len(self.full)} degrees of freedom, {self.reduced.size} coordinates"

    def rows(self) -> list[dict[str, Any]]:
        """Return each mode.

        Returns
        -------
        One dictionary per mode: ``mode``, counted from 1, and ``frequency_hz``.
        """
        return [
            {"mode": k + 1, "frequency_hz": hz}
            for k, hz in enumerate(self.frequency_hz.tolist())
        ]

    def model(self) -> Model:
        """Return the small model with sensors and inputs, to be simulated or diagnosed.

        Returns
        -------
        Model over the motions of sensors and inputs and further coordinates.

        Raises
        ------
        ValueError
            If the model has no sensors that it could keep.
        """
        return Model(describe_reduced(self.full.model, self.settings).description)

    @checked
    def save(self, path: str | Path) -> tuple[str, ...]:
        """Write the small model.

        Parameters
        ----------
        path
            ``.yaml`` or ``.json``: a model file, for a twin, a diagnosis and simulation; other
            endings: an archive of NumPy for updating.

        Returns
        -------
        Channels of strains, which a model file leaves out.
        """
        out = Path(path)
        if out.suffix.lower() not in MODEL_FILES:
            write_reduced(out, self.reduced)
            return ()
        read = self.full.model
        found = describe_reduced(read, self.settings)
        file = with_geometry(model_file_of(found.description), geometry_of(read, found))
        if out.suffix.lower() == ".json":
            out.write_text(file.model_dump_json(), encoding="utf-8")
        else:
            write_model(out, file)
        return found.left_out

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the natural frequencies of the small model.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        axes.plot(range(1, len(self.frequency_hz) + 1), self.frequency_hz, "o")
        axes.set(xlabel="mode", ylabel="natural frequency [Hz]", title=self.heading)
        return save(axes, path)


@checked
def reduce(
    model: FiniteElementModel | str | Path,
    modes: Count | None = None,
    *,
    band_hz: Positive | None = None,
    coordinates: Count = 100,
    span: Annotated[float, Bounds(above=0, below=1)] = 0.3,
    trials: int = 2,
    seed: int = 0,
) -> ReducedFiniteElements:
    """Reduce finite-element matrices to a small model, and verify it by full solutions.

    Keeps the lowest modes and their responses to every parameter, so that a changed parameter
    needs no solution of the full model.

    Parameters
    ----------
    model
        Model, or the path of its file.
    modes
        Number of lowest modes to keep.
    band_hz
        Upper end of the sensors' band, instead of `modes`: modes up to 1.5 times it are kept
        [Hz].
    coordinates
        Maximum number of coordinates.
    span
        Largest relative change of a parameter for which the model must hold [1].
    trials
        Random parameters at which the model is verified by full solutions.
    seed
        Of the random parameters.

    Returns
    -------
    The small model, its frequencies and its error.

    Raises
    ------
    ValueError
        If not one of `modes` and `band_hz` is given, or the model cannot be reduced so.

    References
    ----------
    .. [1] R. J. Craig and A. J. Kurdila, Fundamentals of Structural Dynamics, 2nd ed., Wiley,
       2006, chapter 17.

    Examples
    --------
    >>> model = FiniteElementModel.from_matrices(
    ...     np.diag(np.arange(1.0, 21.0)), np.eye(20), {"all": np.diag(np.arange(1.0, 21.0))}
    ... )
    >>> found = reduce(model, modes=3)
    >>> found.frequency_hz.round(3)
    array([0.159, 0.225, 0.276])
    """
    if (modes is None) == (band_hz is None):
        raise ValueError(f"modes={modes} and band_hz={band_hz} were given. Give one of them.")
    read = (
        model if isinstance(model, FiniteElementModel) else FiniteElementModel.from_file(model)
    )
    matrices = read.model.matrices
    settings = BasisSettings(modes=modes or 1, coordinates=coordinates, span=span, seed=seed)
    if band_hz is not None:
        settings = settings_for_band(matrices, band_hz, settings)
    reduced = reduce_modal(matrices, settings, trials=trials)
    found = reduced.modes(np.zeros(len(reduced.names)), settings.modes)
    return ReducedFiniteElements(
        full=read, reduced=reduced, settings=settings, frequency_hz=found.frequency_hz
    )

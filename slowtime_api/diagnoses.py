"""Diagnosis: what a model lacks to explain measured signals."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime.discrepancy.refinement.force_surface import SurfaceDemand
from slowtime.discrepancy.search import SearchOptions
from slowtime_schemas.files.diagnosis import DiagnosisFile
from slowtime_services.argument_checks import Positive, checked
from slowtime_services.diagnose import Source, diagnose_records, read_any, write_results
from slowtime_services.diagnose.labels import number
from slowtime_services.files import RecordError
from slowtime_services.plugins.effect_kinds import known

from .arguments import with_arguments
from .models import Model
from .plotting import Axes, new_figure, save
from .signals import Signals

Given = Signals | str | Path


class DiagnosisResult:
    """The answer of a diagnosis.

    Parameters
    ----------
    diagnosis
        Arrays of the diagnosis.
    document
        What ``report.json`` holds.
    """

    @checked
    def __init__(self, diagnosis: Diagnosis, document: DiagnosisFile) -> None:
        self.diagnosis, self.document = diagnosis, document

    @property
    def verdict(self) -> str:
        """``missing_effect``, ``nothing_missing``, ``undecided`` and so on."""
        return self.document.verdict

    @property
    def sentence(self) -> str:
        """The answer in words."""
        return self.document.sentence

    @property
    def experiment(self) -> str | None:
        """What to measure next, where the signals cannot decide."""
        return self.document.experiment

    @property
    def error(self) -> dict[str, float]:
        """Error of free runs over the scatter of the measurement [1], on signals not fitted.

        Of the model as given, refitted, with the effects found, and of noise alone.
        """
        gap = self.document.gap
        return {
            "as given": gap.nominal,
            "refitted": gap.refitted_nominal,
            "with effects": gap.augmented,
            "noise": gap.noise_floor,
        }

    @property
    def augmented(self) -> Model:
        """The model with the effects that were found, and refitted constants."""
        return Model(self.diagnosis.augmented)

    def effects(self) -> list[dict[str, Any]]:
        """Return each effect with its place, probability and parameters with units.

        Returns
        -------
        One dictionary per effect: ``effect``, ``place``, ``probability`` [1], ``parameters``
        (values with their units as text) and ``sentence``.
        """
        return [
            {
                "effect": one.effect,
                "place": f"{one.where.kind} {one.where.id}",
                "probability": one.probability,
                "parameters": {name: number(value) for name, value in one.parameters.items()},
                "sentence": one.sentence,
            }
            for one in self.document.effects
        ]

    @checked
    def report(self, folder: str | Path) -> Path:
        """Write report.html, report.json, augmented.yaml and arrays into a folder.

        Parameters
        ----------
        folder
            Folder to write; made where it is missing.

        Returns
        -------
        Path of report.html.
        """
        write_results(Path(folder), self.diagnosis, self.document)
        return Path(folder) / "report.html"

    @checked
    def plot_gap(self, path: str | Path | None = None) -> Axes:
        """Draw the error of free runs: as given, refitted, after each effect, and noise.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        gap = self.document.gap
        steps = [
            ("as given", gap.nominal), ("refitted", gap.refitted_nominal),
            *((f"with {one.effect}", one.nrmse) for one in gap.steps),
            ("noise alone", gap.noise_floor),
        ]  # fmt: skip
        (axes,) = new_figure()
        bars = axes.bar(range(len(steps)), [100 * value for _, value in steps], color="C0")
        axes.bar_label(bars, fmt="%.3g %%")
        axes.set_xticks(range(len(steps)), [name for name, _ in steps])
        on = "held-out signals" if gap.on == "holdout" else "the last third of the signals"
        axes.set(ylabel="error of the free run [%]", title=f"On {on}")
        axes.margins(y=0.15)
        return save(axes, path)

    @checked
    def plot_force(self, path: str | Path | None = None) -> Axes:
        """Draw the force surface that closes the gap, where no law of the catalogue does.

        Force with its 95 % band over elongation and over rate, the measured range shaded, the
        law that it most resembles dashed, and below it where the signals measured it.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.

        Raises
        ------
        ValueError
            If no force surface was adopted.
        """
        from .force_figure import draw_force

        measured = self.diagnosis.measured_force
        if measured is None:
            raise ValueError(
                "This diagnosis adopted no force surface: one is fitted only where no law of "
                f"the catalogue explains the signals, and kept where it reduces the error. The "
                f"verdict is {self.verdict.replace('_', ' ')}; plot_gap() draws its errors."
            )
        return save(draw_force(measured, self.diagnosis.nominal.unit_of_coordinate), path)

    def _repr_html_(self) -> str:
        """Return verdict, effects and errors as HTML, for notebooks."""
        from html import escape

        rows = "".join(
            f"<tr><td>{escape(one['effect'])}</td><td>{escape(one['place'])}</td>"
            f"<td>{one['probability']:.3f}</td><td>"
            f"{escape(', '.join(f'{k} = {v}' for k, v in one['parameters'].items()))}</td></tr>"
            for one in self.effects()
        )
        table = (
            "<table><tr><th>effect</th><th>place</th><th>probability</th><th>parameters</th>"
            f"</tr>{rows}</table>"
            if rows
            else ""
        )
        errors = ", ".join(f"{name} {100 * value:.3g} %" for name, value in self.error.items())
        title = escape(self.verdict.replace("_", " "))
        return (
            f"<p><b>{title}</b>: {escape(self.sentence)}</p>{table}"
            f"<p>Error of the free run: {errors}</p>"
        )

    def __repr__(self) -> str:
        return f"{self.verdict.replace('_', ' ')}: {self.sentence}"


@checked
def diagnose(
    model: Model | str | Path,
    signals: Given | Sequence[Given],
    *,
    holdout: Given | Sequence[Given] = (),
    channels: Mapping[str, str] | None = None,
    patience_s: Positive | None = None,
    surface: str = "auto",
    progress: Callable[[str, float], None] | None = None,
) -> DiagnosisResult:
    """Find the effects that a model lacks to explain measured signals.

    Parameters
    ----------
    model
        Model, or the path of its file.
    signals
        Signals or files to learn from; channels are those of the model's sensors and inputs.
    holdout
        Signals or files to judge by. Where none are given, the last third of `signals` is kept
        for that.
    channels
        For channels of the model that are called otherwise in the signals, their name there,
        or an expression of several.
    patience_s
        Budget of work, in seconds of a reference machine [s]; chosen by the size of the model
        where not given. The same signals give the same answer on any machine.
    surface
        Shape of the force surface that is fitted where no law explains the signals: auto, free,
        odd, even or monotone, or several words separated by commas.
    progress
        Called with the stage in words and the share done [1].

    Returns
    -------
    Verdict, effects with places and probabilities, errors on held-out signals, and the model
    with the effects.

    Raises
    ------
    ValueError
        If signals do not fit the model, or there is no such shape of a surface; the message
        says what is missing.
    TypeError
        If model, signals or channels are of another type.
    """
    demand = SurfaceDemand.of(surface.split(","))
    known_model = model if isinstance(model, Model) else Model.from_file(model)
    learnt = _sources(signals, "signals")
    if not learnt:
        raise ValueError("No signals were given. Give those to learn from.")
    if not known_model.description.sensors:
        raise ValueError("The model has no sensors. List them, with the channel of each.")
    from slowtime_services.diagnose import roles_of

    try:
        found, document = diagnose_records(
            known_model.description,
            learnt,
            _sources(holdout, "holdout"),
            roles=roles_of([f"{name}={there}" for name, there in (channels or {}).items()]),
            kinds=known(()),
            options=SearchOptions(surface=demand),
            progress=progress,
            patience_s=patience_s,
        )
    except RecordError as error:
        raise RecordError(with_arguments(str(error))) from error
    return DiagnosisResult(found, document)


def _sources(given: Given | Sequence[Given], name: str) -> list[Source]:
    """Read files, and name signals that have no file."""
    many: list[Any] = [given] if isinstance(given, Signals | str | Path) else []
    if not many and isinstance(given, Sequence):
        many = list(given)
    elif not many:
        raise TypeError(
            f"{name} of type {type(given).__name__} was given. Give Signals or the path of a "
            "file, or a list of them; slowtime.Signals(samples, rate_hz=...) takes arrays."
        )
    for one in many:
        if not isinstance(one, Signals | str | Path):
            raise TypeError(
                f"{name} holds a {type(one).__name__}. Give Signals and paths of files only."
            )
    return [
        Source(f"{name} {i + 1}", one.record) if isinstance(one, Signals) else read_any(one)
        for i, one in enumerate(many)
    ]

"""Arguments and help of the verb `distortion`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import POSITIVE, OutFile
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option


class Period(click.ParamType):  # type: ignore[type-arg]  # generic in stubs only
    """A number of samples, or ``auto``."""

    name = "SAMPLES|auto"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> int | None:
        """Read the number; None where it is to be found."""
        if value is None or value == "auto" or isinstance(value, int):
            return value if isinstance(value, int) else None
        if not str(value).isdigit() or int(str(value)) < 1:
            self.fail(
                f"{value!r} is not a period. Give a whole number of samples, or auto.",
                param,
                ctx,
            )
        return int(str(value))


@click.command(
    cls=Deferred,
    work="records.distortion:distortion",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime modes distortion run1.csv run2.csv --input u --output y --setting period=4096
  slowtime modes distortion weak.npz strong.npz --input force --output a1 \\
    --report distortion.html
  slowtime modes distortion swing.csv --decay --output angle --out -
""",
)
@click.argument("records", nargs=-1, required=True)
@click.option("--input", "given", metavar="CHANNEL", help="Channel of the excitation.")
@click.option(
    "--output", "told", metavar="CHANNEL", required=True, help="Channel of the response."
)
@click.option(
    "--band-hz",
    "band",
    type=(float, float),
    metavar="LOW HIGH",
    help="Frequencies to analyse [Hz]; all that are excited by default.",
)
@click.option("--decay", is_flag=True, help="The records are free decays: no input, no period.")
@click.option(
    "--rate-hz", type=POSITIVE, help="Sampling rate of records that do not state it [Hz]."
)
@out_option("JSON file to write.", ".json", to="out")
@click.option("--report", "plot", type=OutFile(".html"), help="HTML page with plots to write.")
@settings_option(
    setting(
        "--period",
        type=Period(),
        default="auto",
        show_default=True,
        help="Samples in one period of the multisine.",
    ),
    setting(
        "--transient",
        "transient_s",
        type=click.FloatRange(min=0),
        default=0.0,
        show_default=True,
        help="Time to leave out at the beginning of each record [s].",
    ),
    setting(
        "--near-hz",
        type=POSITIVE,
        help="Frequency near the resonance to fit [Hz]; by default the highest peak.",
    ),
)
def distortion(given: str | None, decay: bool, plot: Path | None, **_rest: object) -> None:
    """Measure nonlinear distortion, or damping against amplitude.

    Each record holds whole periods of a random-phase multisine (FILE@FROM:TO takes a part of a
    record). Records of the same level count as realisations, each with its own random phases.
    Scatter over periods estimates the noise; scatter over realisations, noise and nonlinear
    distortion together. Response at frequency lines that are not excited shows whether the
    nonlinearity is odd or even. For each level, frequency and damping of the resonance at the
    highest peak are printed. With --decay, records are free decays, and frequency and damping
    are printed against amplitude.
    """
    if decay and given is not None:
        raise click.UsageError("--decay and --input exclude each other. Leave one of them out.")
    if not decay and given is None:
        raise click.UsageError("Missing option '--input'. Give it, or --decay.")

"""Arguments and help of the verb `import`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import record_flags
from slowtime_cli.shared.options import POSITIVE, Instant, Name, OutFile
from slowtime_cli.shared.settings import setting, settings_option


@click.command(
    "import",
    cls=Deferred,
    work="records.import_record:import_",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime import record.csv --out record.mcap
  slowtime import trial.txt --out trial.mcap --asset beam --start 2022-07-19T22:55:00Z
  slowtime import sensors.npy --rate-hz 256 --out sensors.mcap
""",
)
@record_flags
@click.option(
    "--out",
    required=True,
    type=OutFile(".mcap"),
    help="MCAP file to write; it must not exist yet.",
)
@click.option(
    "--site", default="import", show_default=True, type=Name(), help="Site of the asset."
)
@click.option(
    "--asset", type=Name(), help="Name of the asset.  [default: from the file's name]"
)
@click.option(
    "--start",
    "start_ns",
    type=Instant(),
    help="Time of the first sample, such as 2022-07-19T22:55:00Z; overrides the file.",
)
@settings_option(
    setting(
        "--block-s",
        default=0.1,
        show_default=True,
        type=POSITIVE,
        help="Length of a raw block.",
    ),
)
def import_(**_given: object) -> None:
    """Turn a record into an MCAP recording.

    RECORD is text of any delimiter, NumPy, MATLAB, Excel, TDMS, WAV, miniSEED, HDF5, Parquet,
    UFF and others (docs/files.md). The recording holds raw blocks with their rate, channels and
    units; the same file gives the same bytes. `slowtime edge --file` and `slowtime
    identify` read it; so do Foxglove's and other MCAP tools.
    """

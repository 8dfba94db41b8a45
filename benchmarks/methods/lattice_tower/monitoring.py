"""The lattice tower of 30 groups under 24 channels, one group of which loses stiffness.

Run `python -m benchmarks.methods.lattice_tower.monitoring [--seeds 50] [--samples]`. Features
are drawn from the full model of 20,160 degrees of freedom, whose groups differ from the file by
some 5 %, or identified from simulated samples of its modes as an edge agent does. They go
through the estimation of the twin server, which has the reduced model: it learns the structure,
a group loses 10 %, and the suspects of the next epoch are compared with the truth. Prints how
often the group was named alone or among those that cannot be told apart, how often another was,
and chi-square per parameter.
"""

import argparse
import dataclasses
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.methods.monitored_tower import LossOutcome, TowerTwin, show
from slowtime.finite_elements.reduction import BasisSettings

from .structure import TowerLayout, export_tower

MODES, WINDOW_S = 20, 3600.0
"""Modes that are identified, and windows of an hour [s], as the lowest mode takes 9 s."""

COORDINATES = 64
"""Of the reduced model: 24 channels, and 40 that hold the modes over the parameters [1]."""

SPAN = 0.2
"""Largest change of a group for which the reduced model must hold [1]: four standard deviations
of what the structure differs from the file by."""


def read_monitored(layout: TowerLayout) -> TowerTwin:
    """Make a tower, write its files, and reduce it.

    Parameters
    ----------
    layout
        How tall it is, and how finely it is divided.

    Returns
    -------
    The full model and its twin.
    """
    with tempfile.TemporaryDirectory() as folder:
        settings = BasisSettings(modes=MODES, coordinates=COORDINATES, span=SPAN)
        model = export_tower(Path(folder), layout)
        return TowerTwin.read(model, settings, modes=MODES, window_s=WINDOW_S)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; return 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--storeys", type=int, default=TowerLayout().storeys)
    parser.add_argument("--samples", action="store_true", help="identify from samples")
    given = parser.parse_args(arguments)
    tower = read_monitored(TowerLayout(storeys=given.storeys))
    tower = dataclasses.replace(tower, sampled=given.samples)
    found: list[LossOutcome] = []
    for seed in range(given.seeds):
        found.append(tower.run(seed, later=1))
        print(f"seed {seed}: {found[-1].group} lost 10 %, said "
              f"{', '.join(found[-1].suspects) or 'nothing'}", flush=True)  # fmt: skip
    return 0 if show(found, tower.twin.free) else 1


if __name__ == "__main__":
    sys.exit(main())

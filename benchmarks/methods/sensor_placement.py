"""Placed sensors against uniformly spread ones: what updates of a tower really err by.

Run `python -m benchmarks.methods.sensor_placement [--seeds 200] [--sensors 8] [--modes 4]
[--criterion variance]`.
Sensors are placed on `docs/examples/lattice_tower.yaml` as `slowtime model place` does. For
each seed a structure is drawn from the prior, its modes at the sensors from the full model with
errors as stated, and its parameters are estimated. Prints the root mean square error of each
parameter beside the standard deviation that the placement expected, for both sets of sensors,
and chi-square per parameter.
"""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np
from jaxtyping import Float

from slowtime.evolution.structures import (
    Criterion,
    MeasuredModes,
    ModePrecision,
    Placement,
    PlacementProblem,
    ReducedStructure,
    estimate,
    place_sensors,
)
from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime_services.matrices import MatrixModel, read_matrix_model

TOWER = Path(__file__).parents[2] / "docs/examples/lattice_tower.yaml"

FREQUENCY_SD, SHAPE_SD = 0.002, 0.02
"""Relative error of a frequency, and error of a component of a shape over its largest one [1];
the defaults of `slowtime model place`."""

BETTER = 0.8
"""Error of the placed sensors over that of the spread ones that is to be undercut [1]."""

HONEST = (0.8, 1.25)
"""Actual over expected standard deviation [1] within which the expectation is called right."""

BEYOND = 6
"""Modes of the reduced model beyond those that are measured, for pairing and slopes."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SensorCandidates:
    """The tower, and every place where a sensor can be.

    Parameters
    ----------
    full
        The full model.
    structure
        The reduced model that is updated.
    rows
        What a sensor at each free translation of a node sees.
    problem
        Information that each would give.
    modes
        Number of lowest modes that are measured.
    """

    full: MatrixModel
    structure: ReducedStructure
    rows: Float[np.ndarray, "site dof"]
    problem: PlacementProblem
    modes: int

    @classmethod
    def read(cls, modes: int, path: Path = TOWER) -> "SensorCandidates":
        """Read and reduce the tower, of which as many modes will be measured."""
        full = read_matrix_model(path)
        dofs, expansion = full.matrices.dofs, full.matrices.expansion
        assert dofs is not None
        assert expansion is not None
        free = (np.diff(expansion.indptr) > 0) & (dofs.direction < 3)
        rows = np.eye(dofs.size)[free]
        settings = BasisSettings(modes=modes + BEYOND, coordinates=100)
        structure = ReducedStructure(model=reduce_modal(full.matrices, settings, trials=0))
        precision = ModePrecision(modes=modes, frequency_sd=FREQUENCY_SD, shape_sd=SHAPE_SD)
        sites = np.arange(len(rows))
        problem = PlacementProblem(structure, rows, sites, precision, full.prior_sd)
        return cls(full, structure, rows, problem, modes)

    def placed(self, number: int, criterion: Criterion = "determinant") -> Placement:
        """Place sensors by a criterion of `slowtime model place`."""
        return place_sensors(self.problem, number, criterion=criterion)

    def spread(self, number: int) -> Placement:
        """Spread sensors uniformly over the list of places, which goes up the tower."""
        chosen = np.linspace(0, len(self.rows) - 1, number).round().astype(int)
        return self.problem.placement(tuple(chosen.tolist()))

    def errors(
        self, seed: int, *sites: tuple[int, ...]
    ) -> Float[np.ndarray, "set parameter 2"]:
        """Update the tower from simulated modes at several sets of sensors.

        Parameters
        ----------
        seed
            Of the structure and of all errors; all sets see one structure.
        sites
            Places of each set.

        Returns
        -------
        Error of ln(1 + change) of each parameter [1], and the standard deviation that the
        estimate states, for each set.
        """
        rng = np.random.default_rng(seed)
        sd = self.problem.prior_sd
        log_factor = sd * rng.standard_normal(len(sd))
        modes = lowest_modes(*self.full.matrices.at(np.expm1(log_factor)), self.modes)
        seen = self.full.matrices.rows(self.rows) @ modes.shapes
        seen = (seen / np.abs(seen).max(axis=0)).T
        off = 1.0 + FREQUENCY_SD * rng.standard_normal(self.modes)
        frequency = modes.frequency_hz * off
        shapes = seen + SHAPE_SD * rng.standard_normal(seen.shape)
        found = []
        for chosen in sites:
            own = shapes[:, list(chosen)]
            measured = MeasuredModes(
                frequency_hz=frequency,
                frequency_sd_hz=FREQUENCY_SD * frequency,
                shapes=own,
                shape_sd=np.full_like(own, SHAPE_SD),
                channels=self.rows[list(chosen)],
            )
            posterior = estimate(self.structure, measured, sd)
            found.append(np.column_stack([posterior.theta - log_factor, posterior.sd]))
        return np.array(found)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; return 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--sensors", type=int, default=8)
    parser.add_argument("--modes", type=int, default=4)
    parser.add_argument("--criterion", choices=get_args(Criterion), default="determinant")
    given = parser.parse_args(arguments)
    tower = SensorCandidates.read(given.modes)
    sets = [tower.placed(given.sensors, given.criterion), tower.spread(given.sensors)]
    found = np.array(
        [tower.errors(seed, *(one.sites for one in sets)) for seed in range(given.seeds)]
    )
    actual = np.sqrt(np.mean(found[..., 0] ** 2, axis=0))
    print(f"{'':16}{'placed':^24}{'uniformly spread':^24}")
    print(f"{'parameter':16}" + f"{'expected [%]':>12}{'actual [%]':>12}" * 2)
    for k, name in enumerate(tower.problem.names):
        pairs = ((one.posterior_sd[k], actual[s, k]) for s, one in enumerate(sets))
        print(f"{name:16}" + "".join(f"{100 * v:12.2f}" for pair in pairs for v in pair))
    means = [
        (float(one.posterior_sd.mean()), float(actual[s].mean())) for s, one in enumerate(sets)
    ]
    print(f"{'mean':16}" + "".join(f"{100 * v:12.2f}" for pair in means for v in pair))
    chi2 = np.mean((found[..., 0] / found[..., 1]) ** 2, axis=(0, 2))
    print(f"chi-square per parameter: placed {chi2[0]:.2f}, spread {chi2[1]:.2f}")
    ratio = means[0][1] / means[1][1]
    print(f"actual error of placed over spread sensors: {ratio:.3f} ({given.seeds} seeds)")
    honest = all(HONEST[0] <= own / expected <= HONEST[1] for expected, own in means)
    return 0 if ratio <= BETTER and honest else 1


if __name__ == "__main__":
    sys.exit(main())

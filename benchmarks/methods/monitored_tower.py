"""A tower of six parameter groups under 24 channels, one of which loses stiffness.

Run `python -m benchmarks.methods.monitored_tower [--seeds 50] [--samples]`. Features are drawn
from the full model of `docs/examples/lattice_tower.yaml`, whose groups differ from the file by
some 5 %, or identified from simulated samples of its modes as an edge agent does. They go
through the estimation of the twin server: it learns the structure, a group loses 10 %, and the
suspects of the last epoch are compared with the truth. Prints how often the group was named
alone or among those that cannot be told apart, how often another was, and chi-square per
parameter.
"""

import argparse
import dataclasses
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.reduction import BasisSettings
from slowtime_schemas.messages import Features, Mode, Quality, Shape
from slowtime_schemas.quantities import Quantity
from slowtime_services.matrices import MatrixModel, describe_reduced, read_matrix_model
from slowtime_services.models import description_of, model_file_of
from twin_server.estimate.elements.epochs import track_epochs
from twin_server.estimate.elements.memory import ElementMemory
from twin_server.registration.structure import ElementModel, model_of

TOWER = Path(__file__).parents[2] / "docs/examples/lattice_tower.yaml"

LOSS = -0.1
BUILT_SD = 0.05
"""Standard deviation of what the groups of the structure differ from the file by [1]; the
`tolerance` of the file."""

WINDOW_S, DAMPING_RATIO, SHAPE_SD = 600.0, 0.01, 0.01
"""Windows of ten minutes [s]; damping of all modes [1]; errors of components of shapes of norm
1 that are identified from such a window [1], which fall with the square root of its length."""

MODES = 8
LEARN, LATER = 8, 6
PRIOR_SD = 0.2
"""Standard deviation of ln(1 + change) of each group [1]; that of the file."""

START_NS = 1_795_000_000 * 10**9
CHI2 = (0.8, 1.25)
NAMED = 0.9
"""What the figures are held to: chi-square per parameter, and the share of seeds in which the
group is named, alone or among those that cannot be told apart."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class LossOutcome:
    """What the twin says of one seed after the loss.

    Parameters
    ----------
    group
        The group that lost stiffness.
    suspects
        What is said to have changed; rivals are joined by "or".
    misses
        Error over standard deviation of each group's change, of ln(1 + change) [1].
    ratio
        Posterior over prior standard deviation of each [1].
    seconds
        Time of the processor for an epoch after learning.
    """

    group: str
    suspects: tuple[str, ...]
    misses: Float[np.ndarray, " group"]
    ratio: Float[np.ndarray, " group"]
    seconds: float

    @property
    def alone(self) -> bool:
        """Whether the group is named, and nothing else."""
        return self.suspects == (self.group,)

    @property
    def among(self) -> bool:
        """Whether it is named among groups that cannot be told apart, and nothing else."""
        return len(self.suspects) == 1 and self.group in self.suspects[0].split(" or ")


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ChannelModes:
    """Modes at the channels: frequencies [Hz], and one column of each shape."""

    frequency_hz: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "channel mode"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class TowerTwin:
    """The full model of the tower, and the reduced one of its twin.

    Parameters
    ----------
    full
        The full model, of which features are drawn.
    twin
        The reduced one, as the twin has it.
    modes
        Number of modes that are identified.
    window_s
        Length of the windows [s].
    sampled
        Whether features are identified from simulated samples, as an edge agent does.
    """

    full: MatrixModel
    twin: ElementModel
    modes: int = MODES
    window_s: float = WINDOW_S
    sampled: bool = False

    @classmethod
    def read(
        cls,
        path: Path = TOWER,
        settings: BasisSettings | None = None,
        *,
        modes: int = MODES,
        window_s: float = WINDOW_S,
    ) -> "TowerTwin":
        """Read a tower, and reduce it as a registration does.

        Parameters
        ----------
        path
            Model file.
        settings
            Of the reduction; those of a registration by default.
        modes, window_s
            Number of modes that are identified, and length of the windows [s].

        Returns
        -------
        Both models.
        """
        full = read_matrix_model(path)
        file = model_file_of(describe_reduced(full, settings).description)
        names = dict.fromkeys(full.matrices.names, PRIOR_SD)
        return cls(full, model_of(description_of(file), names), modes, window_s)

    def at(self, theta: Float[np.ndarray, " group"]) -> ChannelModes:
        """Modes of the full model at the channels.

        Parameters
        ----------
        theta
            Relative changes of the groups from the file [1].

        Returns
        -------
        Frequencies and shapes without errors.
        """
        found = lowest_modes(*self.full.matrices.at(theta), self.modes, check=False)
        seen = self.full.matrices.rows(self.full.sensors) @ found.shapes
        return ChannelModes(found.frequency_hz, seen)

    def epoch(self, sequence: int, true: ChannelModes, rng: np.random.Generator) -> Features:
        """Draw the features of one epoch of the full model.

        Parameters
        ----------
        sequence
            Number of the epoch.
        true
            Modes of the full model.
        rng
            Of the errors.

        Returns
        -------
        Message of the lowest modes at all channels.
        """
        found = [
            _mode(f, true.shapes[:, j], j + 1, self.window_s, rng)
            for j, f in enumerate(true.frequency_hz.tolist())
        ]
        t_ns = START_NS + sequence * round(self.window_s * 1e9)
        return Features(
            site="lab", asset="tower", boot="b1", sequence=sequence, t_ns=t_ns, start_ns=t_ns,
            slow_time=float(sequence), time_base="simulated", method="ssi",
            channels=self.full.channels,
            modes=tuple(sorted(found, key=lambda mode: mode.frequency_hz.value)),
            quality=Quality(samples=1000), truth=None,
        )  # fmt: skip

    def features(
        self, whole: ChannelModes, softer: ChannelModes, later: int, rng: np.random.Generator
    ) -> tuple[list[Features], list[Features]]:
        """Make the features before and after the loss.

        Parameters
        ----------
        whole, softer
            Modes before and after it.
        later
            Number of epochs after it.
        rng
            Of the errors.

        Returns
        -------
        Messages of the epochs that are learnt from, and of the later ones.
        """
        if self.sampled:
            from .sampled_tower import SampledTower

            agent = SampledTower(self)
            before = [agent.epoch(whole, rng) for _ in range(LEARN)]
            return before, [agent.epoch(softer, rng) for _ in range(later)]
        before = [self.epoch(k, whole, rng) for k in range(LEARN)]
        return before, [self.epoch(LEARN + k, softer, rng) for k in range(later)]

    def run(self, seed: int, later: int = LATER) -> LossOutcome:
        """Let one group lose stiffness, and see what the twin says.

        Parameters
        ----------
        seed
            Of the structure as built, of the group, and of all errors.
        later
            Number of epochs after the loss.

        Returns
        -------
        What is said of the last epoch.
        """
        rng = np.random.default_rng(seed)
        names = self.twin.free
        built = np.exp(BUILT_SD * rng.standard_normal(len(names))) - 1.0
        which = seed % len(names)
        change = np.zeros(len(names))
        change[which] = LOSS
        lost = (1.0 + built) * (1.0 + change) - 1.0
        whole, softer = self.at(built), self.at(lost)
        before, after = self.features(whole, softer, later, rng)
        memory = track_epochs(ElementMemory(), self.twin, before, LEARN).memory
        begin = time.process_time()
        reading = track_epochs(memory, self.twin, after, LEARN).readings[-1]
        seconds = (time.process_time() - begin) / later
        assert reading.changes is not None
        assert reading.ratio is not None
        value, sd = reading.changes[:, 0], reading.changes[:, 1]
        misses = (np.log1p(value) - np.log1p(change)) / (sd / (1.0 + value))
        said = tuple(one.word for one in reading.suspects)
        return LossOutcome(names[which], said, misses, reading.ratio, seconds)


def frequency_sd(frequency_hz: float, window_s: float = WINDOW_S) -> float:
    r"""Relative standard deviation of a frequency that is identified from a window.

    .. math:: \sigma_f / f = \sqrt{\zeta / (2 \pi f T)}

    References
    ----------
    .. [1] S.-K. Au, "Uncertainty law in ambient modal identification - part I: theory",
       Mechanical Systems and Signal Processing 48 (2014) 15-33, of a wide band.
    """
    return math.sqrt(DAMPING_RATIO / (2.0 * math.pi * frequency_hz * window_s))


def _mode(
    frequency_hz: float,
    shape: Float[np.ndarray, " channel"],
    identity: int,
    window_s: float,
    rng: np.random.Generator,
) -> Mode:
    """One mode as an edge would identify it: complex, of norm 1, with its errors."""
    own = rng.standard_normal(1 + 2 * len(shape))
    shape_sd = SHAPE_SD * math.sqrt(WINDOW_S / window_s)
    drawn = shape / np.linalg.norm(shape)
    drawn = drawn + shape_sd * (own[1::2] + 1j * own[2::2]) / np.sqrt(2.0)
    drawn = drawn / np.linalg.norm(drawn)
    largest = drawn[np.argmax(np.abs(drawn))]
    drawn = drawn * largest.conjugate() / abs(largest)
    relative = frequency_sd(frequency_hz, window_s)
    value = frequency_hz * (1.0 + relative * float(own[0]))
    return Mode(
        frequency_hz=Quantity(value=value, sd=relative * frequency_hz),
        damping_ratio=Quantity(value=DAMPING_RATIO, sd=0.1 * DAMPING_RATIO),
        identity=identity,
        shape=Shape(
            re=tuple(drawn.real.tolist()),
            im=tuple(drawn.imag.tolist()),
            sd=(shape_sd,) * len(shape),
        ),
    )


def show(found: Sequence[LossOutcome], names: Sequence[str]) -> bool:
    """Print the figures; return whether they are within what they are held to.

    Parameters
    ----------
    found
        What the twin said of each seed.
    names
        Of the groups.

    Returns
    -------
    Whether the groups were named and the errors covered.
    """
    alone, among = sum(one.alone for one in found), sum(one.among for one in found)
    silent = sum(not one.suspects for one in found)
    chi2 = float(np.mean([one.misses**2 for one in found]))
    print(f"{'group':16}{'chi-square':>12}{'posterior/prior':>17}")
    for k, name in enumerate(names):
        own = float(np.mean([one.misses[k] ** 2 for one in found]))
        told = float(np.median([one.ratio[k] for one in found]))
        print(f"{name:16}{own:12.2f}{told:17.3f}")
    print(f"named alone {alone}, among others {among - alone}, nothing said {silent}, "
          f"of {len(found)}")  # fmt: skip
    for one in found:
        if not one.among:
            print(f"  {one.group} lost 10 %, said: {', '.join(one.suspects) or 'nothing'}")
    seconds = float(np.median([one.seconds for one in found]))
    print(f"chi-square per parameter {chi2:.2f}, {seconds:.2f} s of CPU an epoch")
    return CHI2[0] <= chi2 <= CHI2[1] and among >= NAMED * len(found)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; return 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--samples", action="store_true", help="identify from samples")
    given = parser.parse_args(arguments)
    tower = dataclasses.replace(TowerTwin.read(), sampled=given.samples)
    found = [tower.run(seed) for seed in range(given.seeds)]
    return 0 if show(found, tower.twin.free) else 1


if __name__ == "__main__":
    sys.exit(main())

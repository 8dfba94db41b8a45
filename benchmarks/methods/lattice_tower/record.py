"""Samples of the lattice tower before and after a loss, and the registration of its twin.

Writes what a real edge agent reads and a real twin server is given, so that both can run as
processes. The structure differs from the file of its twin by some 5 % in each group.
"""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.methods.monitored_tower import BUILT_SD, LOSS, PRIOR_SD, START_NS, TowerTwin
from benchmarks.methods.sampled_tower import RATE_RATIO, accelerations
from slowtime.finite_elements.reduction import BasisSettings
from slowtime_services.matrices import describe_reduced, read_matrix_model
from slowtime_services.models import description_of, model_file_of
from slowtime_services.wireframes import geometry_of, with_geometry
from twin_server.registration.structure import model_of

from .monitoring import COORDINATES, MODES, SPAN, WINDOW_S
from .structure import TowerLayout, export_tower

LEARN, LATER = 8, 2
"""Windows that are learnt from, and windows after the loss [1]."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class TowerRecord:
    """A record of samples, and the settings of the processes that take it in.

    Parameters
    ----------
    path
        Record, `.npz`, whose samples have 24 channels.
    edge
        Settings of the edge agent, without addresses.
    registration
        Body of the registration of the twin.
    change
        True relative change of the stiffness of each group after learning [1].
    windows
        Number of windows in the record.
    """

    path: Path
    edge: dict[str, Any]
    registration: dict[str, Any]
    change: dict[str, float]
    windows: int


def write_record(
    folder: Path,
    group: str,
    *,
    layout: TowerLayout | None = None,
    later: int = LATER,
    seed: int = 1,
) -> TowerRecord:
    """Simulate a tower of which one group loses 10 %, and write the samples of its channels.

    Parameters
    ----------
    folder
        Folder of the files.
    group
        Group that loses stiffness after the windows that are learnt from.
    layout
        How tall the tower is, and how finely it is divided; 20,160 degrees of freedom by
        default.
    later
        Number of windows after the loss.
    seed
        Of the structure as built, of forces and of noise.

    Returns
    -------
    The record, and what both processes are given.
    """
    full = read_matrix_model(
        export_tower(folder / "model", layout or TowerLayout(), ending=".npz")
    )
    settings = BasisSettings(modes=MODES, coordinates=COORDINATES, span=SPAN)
    reduced = describe_reduced(full, settings)
    file = with_geometry(model_file_of(reduced.description), geometry_of(full, reduced))
    prior = dict.fromkeys(full.matrices.names, PRIOR_SD)
    twin = model_of(description_of(file), prior)
    tower = TowerTwin(full, twin, MODES, WINDOW_S, sampled=True)

    rng = np.random.default_rng(seed)
    built = np.exp(BUILT_SD * rng.standard_normal(len(twin.free))) - 1.0
    change = np.where(np.array(twin.free) == group, LOSS, 0.0)
    whole, softer = tower.at(built), tower.at((1.0 + built) * (1.0 + change) - 1.0)
    rate_hz = math.ceil(10.0 * RATE_RATIO * float(whole.frequency_hz.max())) / 10.0
    rows = np.concatenate(
        [
            accelerations(whole, LEARN * WINDOW_S, rate_hz, rng),
            accelerations(softer, later * WINDOW_S, rate_hz, rng),
        ]
    ).astype(np.float32)
    path = folder / "record.npz"
    columns = dict(zip(full.channels, rows.T, strict=True))
    np.savez(path, rate_hz=np.array(rate_hz), **columns)
    return TowerRecord(
        path=path,
        edge={
            "site": "lab",
            "asset": "tower",
            "extract": {"method": "modes", "window_s": WINDOW_S, "most": MODES},
            "publish": {"linger_s": 600.0},
            "input": {"kind": "file", "path": str(path), "speed": 0.0, "start_ns": START_NS},
        },
        registration={
            "name": "Lattice tower",
            "changes": "elements",
            "model": file.model_dump(mode="json", exclude_defaults=True),
            "parameters": prior,
            "learn_epochs": LEARN,
            "confirm_readings": LATER,
        },
        change=dict(zip(twin.free, change.tolist(), strict=True)),
        windows=LEARN + later,
    )

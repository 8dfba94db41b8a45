"""Large parametric models: reduction, updating, placement of sensors, and full solutions.

Run `python -m benchmarks.methods.finite_elements [--part tower chain peer placement]
[--trials 200] [--levels 220]`. The tower is a hollow one of hexahedra with diaphragms, made by
scikit-fem, whose stiffness has 30 groups; its matrices go through files. Times of updated
models are ratios to one full solution, those of updating to one dense eigenvalue solution of
the same matrix, and to `scipy.optimize.least_squares` on the same residuals.
"""

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import scipy.linalg
from scipy import sparse
from scipy.optimize import least_squares

from slowtime.evolution.structures import (
    MeasuredModes,
    ModePrecision,
    PlacementProblem,
    ReducedStructure,
    SparseStructure,
    estimate,
    place_sensors,
)
from slowtime.evolution.structures.fit import total_misfit
from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime.finite_elements.reduction import AdaptiveModel, BasisSettings, reduce_modal
from slowtime.finite_elements.reduction.verification import compare_modes
from slowtime_services.matrices import read_matrix, write_matrix

GROUPS, MODES, SPAN = 30, 20, 0.3
HEIGHT_M, WIDTH_M, ACROSS = 80.0, 4.0, 5
YOUNG_PA, POISSON, DENSITY = 3e10, 0.2, 2500.0
CHAINS = (10, 50, 100, 500)

FREQUENCY_ERROR, AGREEMENT = 1e-3, 0.999
SECONDS, GIGABYTES, UPDATE_S = 60.0, 2.0, 5e-3
EXPONENT, LONGEST_S, BETTER = 1.5, 1.0, 0.20
"""What the figures are held to."""

SENSORS, PLACEMENT_LEVELS = 12, 40

Matrices = tuple[sparse.csr_array, sparse.csr_array, list[sparse.csr_array], np.ndarray]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; return 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parts: dict[str, Callable[[argparse.Namespace], bool]] = {
        "tower": _tower,
        "chain": _chain,
        "peer": _peer,
        "placement": _placement,
    }
    parser.add_argument("--part", nargs="*", choices=tuple(parts), default=tuple(parts))
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--levels", type=int, default=220)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    kept = [parts[name](given) for name in given.part]
    return 0 if all(kept) else 1


def tower_matrices(levels: int) -> Matrices:
    """Matrices of the hollow tower, clamped at its foot.

    Stiffness, mass, stiffness of each group; position and direction (0 to 2) of each degree of
    freedom, one column each.
    """
    import skfem
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    across = np.linspace(0, WIDTH_M, ACROSS + 1)
    mesh = skfem.MeshHex.init_tensor(across, across, np.linspace(0, HEIGHT_M, levels + 1))
    centre = mesh.p[:, mesh.t].mean(axis=1)
    wall = np.abs(centre[:2] - WIDTH_M / 2).max(axis=0) > WIDTH_M * (0.5 - 1 / ACROSS)
    level = np.floor(centre[2] / HEIGHT_M * levels).astype(int)
    mesh = mesh.restrict(np.flatnonzero(wall | (level % 10 == 9)))
    height = mesh.p[2, mesh.t].mean(axis=0)
    group = np.minimum((height / HEIGHT_M * GROUPS).astype(int), GROUPS - 1)
    element = skfem.ElementVector(skfem.ElementHex1())
    basis = skfem.Basis(mesh, element)
    free = basis.complement_dofs(basis.get_dofs(lambda x: x[2] < 1e-9).all())

    def inner(matrix: sparse.csr_matrix) -> sparse.csr_array:
        return sparse.csr_array(sparse.csr_array(matrix)[free][:, free])

    elastic = linear_elasticity(*lame_parameters(YOUNG_PA, POISSON))
    weigh = skfem.BilinearForm(lambda u, v, _: DENSITY * dot(u, v))
    parts = [
        inner(elastic.assemble(skfem.Basis(mesh, element, elements=np.flatnonzero(group == g))))
        for g in range(GROUPS)
    ]
    direction = np.zeros(basis.N, dtype=int)
    for way in range(3):
        direction[basis.nodal_dofs[way]] = way
    places = np.vstack([basis.doflocs, direction])[:, free]
    whole = sparse.csr_array(sum(parts[1:], parts[0]))
    return whole, inner(weigh.assemble(basis)), parts, places


def _tower(given: argparse.Namespace) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        stiffness, mass, parts, _ = tower_matrices(given.levels)
        files = [Path(folder, f"{k}.npz") for k in range(GROUPS + 2)]
        for file, matrix in zip(files, (stiffness, mass, *parts), strict=True):
            write_matrix(file, matrix)
        del stiffness, mass, parts
        start = time.perf_counter(), time.process_time()
        model, reduced = _read_and_reduce(files)
        took = time.perf_counter() - start[0], time.process_time() - start[1]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"Degrees of freedom {model.size}, groups {GROUPS}, coordinates {reduced.size}")
    print(
        f"Reading and reduction: {took[0]:.1f} s ({took[1]:.1f} s of CPU), at most {SECONDS:g}"
    )
    print(f"Peak memory of the process: {peak:.2f} GiB, at most {GIGABYTES:g}")
    error, agreement, full_s, own_s = _trials(model, reduced, given.trials, given.seed)
    print(f"{given.trials} random parameters up to {SPAN}, first {MODES} modes:")
    print(f"  largest error of a frequency {error:.2e}, at most {FREQUENCY_ERROR:g}")
    print(f"  smallest agreement of shapes {agreement:.6f}, at least {AGREEMENT:g}")
    print(
        f"  an updated model {own_s * 1e3:.2f} ms of CPU, at most {UPDATE_S * 1e3:g}; "
        f"full solution over it {full_s / own_s:.0f}"
    )
    return (
        took[0] <= SECONDS
        and peak <= GIGABYTES
        and reduced.size <= 100
        and error <= FREQUENCY_ERROR
        and agreement >= AGREEMENT
        and own_s <= UPDATE_S
    )


def _read_and_reduce(files: list[Path]) -> tuple[ParametricMatrices, AdaptiveModel]:
    stiffness, mass, *parts = (read_matrix(file) for file in files)
    model = ParametricMatrices(
        stiffness=stiffness,
        mass=mass,
        names=tuple(f"group {g + 1}" for g in range(len(parts))),
        stiffness_parts=tuple(parts),
    )
    return model, reduce_modal(model, BasisSettings(modes=MODES, span=SPAN), trials=0)


def _trials(
    model: ParametricMatrices, reduced: AdaptiveModel, trials: int, seed: int
) -> tuple[float, float, float, float]:
    """Largest error, smallest agreement, and median times of full and reduced solutions."""
    random = np.random.default_rng(seed + 100)
    thetas = random.uniform(-SPAN, SPAN, (trials, GROUPS))
    errors, alike, full_s, own_s = [], [], [], []
    reduced.modes(np.zeros(GROUPS), MODES)
    for theta in thetas:
        start = time.process_time()
        reduced.modes(theta, MODES)
        own_s.append(time.process_time() - start)
    for theta in thetas:
        start = time.process_time()
        full = lowest_modes(*model.at(theta), MODES + 4, check=False)
        full_s.append(time.process_time() - start)
        error, agreement = compare_modes(
            model, reduced, reduced.modes(theta, MODES), full, theta
        )
        errors.append(error)
        alike.append(agreement)
    return max(errors), min(alike), float(np.median(full_s)), float(np.median(own_s))


def chain(number: int) -> SparseStructure:
    """Build unit masses in a row from a support, each spring a parameter."""
    stiff, parts = float(number) ** 2, []
    for e in range(number):
        places = [e] if e == 0 else [e - 1, e]
        values = np.array([[1.0]]) if e == 0 else np.array([[1.0, -1.0], [-1.0, 1.0]])
        row, column = np.meshgrid(places, places, indexing="ij")
        entries = (stiff * values.ravel(), (row.ravel(), column.ravel()))
        parts.append(sparse.csr_array(entries, shape=(number, number)))
    return SparseStructure(
        matrices=ParametricMatrices(
            stiffness=sparse.csr_array(sum(parts[1:], parts[0])),
            mass=sparse.csr_array(sparse.eye_array(number)),
            names=tuple(f"spring {e + 1}" for e in range(number)),
            stiffness_parts=tuple(parts),
        )
    )


def measured(
    structure: SparseStructure | ReducedStructure,
    sensors: np.ndarray,
    theta: np.ndarray,
    modes: int,
    random: np.random.Generator,
    largest: np.ndarray | None = None,
) -> MeasuredModes:
    """Modes of a changed structure with errors: 0.1 % of frequencies, 1 % of shapes.

    The errors of shapes are relative to `largest` of each mode, else to what the sensors see.
    """
    true = structure.sensed_modes(theta, sensors, modes)
    frequency, shapes = true.frequency_hz[:modes], true.sensed[:, :modes].T
    size = np.abs(shapes).max(axis=1) if largest is None else largest
    sd = 0.01 * size[:, None] * np.ones(shapes.shape)
    return MeasuredModes(
        frequency_hz=frequency * (1 + 1e-3 * random.standard_normal(modes)),
        frequency_sd_hz=1e-3 * frequency,
        shapes=shapes + sd * random.standard_normal(shapes.shape),
        shape_sd=sd,
        channels=sensors,
    )


def _chain(given: argparse.Namespace) -> bool:
    took = []
    print("Chain of n springs, 8 modes at 8 sensors: whole estimate with 9 starts, CPU time")
    for number in CHAINS:
        structure, random = chain(number), np.random.default_rng(given.seed)
        theta = np.zeros(number)
        theta[number // 3] = np.log(0.8)
        sensors = np.eye(number)[np.linspace(0, number - 1, 8).round().astype(int)]
        data = measured(structure, sensors, theta, 8, random)
        runs = []
        for _ in range(3):
            start = time.process_time()
            estimate(structure, data, 0.1)
            runs.append(time.process_time() - start)
        took.append(min(runs))
        dense = structure.matrices.stiffness.toarray()
        start = time.process_time()
        scipy.linalg.eigh(dense)
        once = time.process_time() - start
        print(f"  n = {number}: {took[-1]:.3f} s, {took[-1] / once:.0f} dense solutions")
    growth = float(np.polyfit(np.log(CHAINS), np.log(took), 1)[0])
    print(
        f"  time grows as n^{growth:.2f}, at most n^{EXPONENT}; longest at most {LONGEST_S:g} s"
    )
    return growth <= EXPONENT and took[-1] <= LONGEST_S


def _peer(given: argparse.Namespace) -> bool:
    """Sixty parameters: the same residuals handed to SciPy's least squares."""
    number = 60
    structure, random = chain(number), np.random.default_rng(given.seed)
    theta = 0.1 * random.standard_normal(number)
    sensors = np.eye(number)[np.linspace(2, number - 1, 16).round().astype(int)]
    data = measured(structure, sensors, theta, 12, random)
    start = time.process_time()
    found = estimate(structure, data, 0.1, starts=0)
    own = time.process_time() - start
    prior = np.full(number, 0.1)

    def residual(white: np.ndarray) -> np.ndarray:
        here = total_misfit(structure, (data,), prior * white, prior)
        return np.concatenate([here.residual, -white])

    start = time.process_time()
    peer = least_squares(residual, np.zeros(number), method="lm", xtol=1e-12, ftol=1e-12)
    theirs = time.process_time() - start
    slope = np.asarray(peer.jac, dtype=np.float64)
    sd = np.sqrt(np.diag(np.linalg.inv(slope.T @ slope))) * prior
    apart = np.abs(found.theta - prior * peer.x).max() / sd.min()
    ratio = found.sd / sd
    print("Sixty parameters, 12 modes at 16 sensors, beside scipy.optimize.least_squares:")
    print(f"  largest difference {apart:.1e} standard deviations")
    print(f"  standard deviations over theirs {ratio.min():.4f} to {ratio.max():.4f}")
    print(f"  their time over ours {theirs / own:.1f}")
    return apart < 0.05 and bool((np.abs(ratio - 1) < 0.05).all())


def _placement(given: argparse.Namespace) -> bool:
    """Sensors on the tower: expected and simulated errors beside those at even heights."""
    stiffness, mass, parts, places = tower_matrices(PLACEMENT_LEVELS)
    model = ParametricMatrices(
        stiffness=stiffness,
        mass=mass,
        names=tuple(f"group {g + 1}" for g in range(GROUPS)),
        stiffness_parts=tuple(parts),
    )
    reduced = reduce_modal(model, BasisSettings(modes=12), trials=0)
    structure = ReducedStructure(model=reduced)
    # Horizontal sensors along two opposite edges.
    edge = (places[0] == places[1]) & np.isin(places[0], (0.0, WIDTH_M)) & (places[3] < 2)
    where = np.flatnonzero(edge)
    candidates = np.eye(model.size)[where]
    precision = ModePrecision(modes=10, frequency_sd=1e-3, shape_sd=0.01)
    problem = PlacementProblem(structure, candidates, np.arange(len(where)), precision, 0.1)
    best = place_sensors(problem, SENSORS, criterion="variance")
    even = problem.placement(_at_even_heights(places[:, where]))
    gain = 1 - float(best.posterior_sd.mean() / even.posterior_sd.mean())
    print(f"{SENSORS} sensors on a tower of {model.size} degrees of freedom, {GROUPS} groups:")
    print(f"  expected posterior sd {gain:.0%} below even heights, at least {BETTER:.0%}")
    nominal = structure.sensed_modes(np.zeros(GROUPS), candidates, 10).sensed[:, :10]
    largest, errors = np.abs(nominal).max(axis=0), []
    for sites in (best.sites, even.sites):
        random, squares = np.random.default_rng(given.seed), []
        for _ in range(20):
            theta = 0.1 * random.standard_normal(GROUPS)
            data = measured(structure, candidates[list(sites)], theta, 10, random, largest)
            squares.append((estimate(structure, data, 0.1, starts=0).theta - theta) ** 2)
        errors.append(float(np.sqrt(np.mean(squares))))
    print(f"  simulated rms error {1 - errors[0] / errors[1]:.0%} below even heights")
    return gain >= BETTER


def _at_even_heights(places: np.ndarray) -> tuple[int, ...]:
    """Pairs of sensors along x and y on one edge, at evenly spaced heights up to the top."""
    heights = np.linspace(0, HEIGHT_M, SENSORS // 2 + 1)[1:]
    chosen = []
    for height in heights:
        for direction in (0, 1):
            off = np.abs(places[2] - height) + 1e3 * (places[3] != direction) + places[0]
            chosen.append(int(np.argmin(off)))
    return tuple(chosen)


if __name__ == "__main__":
    sys.exit(main())

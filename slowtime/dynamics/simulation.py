"""Exact simulation of structures under sampled forces.

A force that is constant or linear between samples moves each complex mode by one multiplication
a sample: no step size has to be chosen, and the cost is that of a one-pole filter per mode. The
few structures whose modes do not span all motion are stepped by their matrix exponential.
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy
import scipy.fft
import scipy.linalg
from jaxtyping import Complex, Float

from .modes import ComplexModes, DefectiveModesError, complex_modes
from .sdof.simulation import FORGOTTEN
from .structure import Structure, state_matrix
from .transfer import derivative_order

Motion = Float[np.ndarray, "time dof"]
State = Float[np.ndarray, " dof"]

CHUNK = 1 << 15
"""Samples moved at once: bounds the memory of the modal coordinates."""


def simulate_structure(
    structure: Structure,
    force: Motion,
    rate_hz: float,
    q0: State | None = None,
    v0: State | None = None,
    *,
    hold: str = "zero",
) -> tuple[Motion, Motion, Motion]:
    """Displacement, velocity and acceleration, relative to the base, at the samples of a force.

    Parameters
    ----------
    force
        One row a sample [N]; of base motion, `Structure.base_force`.
    q0, v0
        Displacement and velocity at the first sample; at rest where not given. Those of the
        last sample continue the run, with that sample's force given once more.
    hold
        ``"zero"``: the force keeps its value until the next sample; ``"first"``: it goes
        straight to the next value.

    Examples
    --------
    >>> pair = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> two = Structure(mass=np.eye(2), damping=0.2 * np.eye(2), stiffness=pair)
    >>> q, v, a = simulate_structure(two, np.ones((3000, 2)), 10.0)
    >>> q[-1].round(6)
    array([1., 1.])
    """
    if hold not in ("zero", "first"):
        raise ValueError(f"{hold=} is not a valid way to hold a force. Allowed: zero, first.")
    if not 0 < rate_hz < math.inf:
        raise ValueError(
            f"{rate_hz=} is not a valid sampling rate. Give samples per second, above 0."
        )
    if force.shape[1] != structure.dofs:
        raise ValueError(
            f"The force has {force.shape[1]} columns, the structure {structure.dofs} degrees "
            "of freedom. Give one column for each."
        )
    rest = np.zeros(structure.dofs)
    start = (rest if q0 is None else q0, rest if v0 is None else v0)
    try:
        modes = complex_modes(structure)
    except DefectiveModesError:
        q, v = _by_exponential(structure, force, rate_hz, start, hold)
    else:
        q, v = _by_modes(structure, modes, force, rate_hz, start, hold)
    inner = force - v @ structure.damping - q @ structure.stiffness
    return q, v, scipy.linalg.solve(structure.mass, inner.T, assume_a="pos").T


def ambient_structure(
    structure: Structure,
    samples: int,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    force_psd: float | State | Float[np.ndarray, "dof dof"] = 1.0,
    channels: Sequence[str] | None = None,
    quantity: str = "acceleration",
) -> Float[np.ndarray, "time channel"]:
    """Stationary response to white forces that are cut off at half the sampling rate.

    The density is exactly that of the structure up to half the sampling rate, without aliases
    and without a transient: see `stepping.ambient_acceleration`.

    Parameters
    ----------
    force_psd
        One-sided [N^2/Hz]: the same for every translation, each degree of freedom's own, or the
        matrix of forces that go together.
    channels
        Degrees of freedom that are listened to, by name; all where not given.
    quantity
        Relative to a base that stands still.
    """
    if samples < 1:
        raise ValueError(f"{samples=} is not a valid number of samples. Give 1 or more.")
    modes = complex_modes(structure)
    poles, shapes, norms = modes.all()
    slowest = -float(poles.real.max())
    if slowest <= 0:
        raise ValueError(
            "A motion that does not die away never becomes stationary under ambient force. "
            "Give every mode damping, or integrate a force of your own with simulate_structure."
        )
    rows = range(structure.dofs) if channels is None else [structure.dof(n) for n in channels]
    heard = shapes[list(rows)]
    margin = math.ceil(FORGOTTEN / slowest * rate_hz)
    period = scipy.fft.next_fast_len(samples + margin, real=True)
    s = 2j * np.pi * np.fft.rfftfreq(period, 1.0 / rate_hz)
    force = _amplitudes(structure, force_psd, len(s), period, rng) * math.sqrt(rate_hz * period)
    spectrum = np.zeros((len(s), len(heard)), dtype=complex)
    for pole, shape, norm, seen in zip(poles, shapes.T, norms, heard.T, strict=True):
        spectrum += np.multiply.outer((force @ shape) / (norm * (s - pole)), seen)
    spectrum *= (s ** derivative_order(quantity))[:, None]
    if period % 2 == 0:
        spectrum[-1] = math.sqrt(2.0) * spectrum[-1].real
    return np.asarray(scipy.fft.irfft(spectrum, period, axis=0)[:samples])


def force_density(
    structure: Structure, force_psd: float | State | Float[np.ndarray, "dof dof"]
) -> Float[np.ndarray, "dof dof"]:
    """Matrix of a force density.

    It is given by one number, one per degree of freedom, or a matrix.
    """
    density = np.asarray(force_psd, dtype=float)
    if density.ndim == 0:
        # A number is of forces: moments on rotations stay without.
        pushed = np.ones(structure.dofs) if structure.influence is None else structure.influence
        density = density * np.abs(pushed)
    matrix = np.diag(density) if density.ndim == 1 else density
    if matrix.shape != structure.mass.shape:
        raise ValueError(
            f"force_psd of shape {np.shape(force_psd)} does not fit {structure.dofs} degrees "
            "of freedom. Give one number, one for each, or their matrix."
        )
    return matrix


def density_root(density: Float[np.ndarray, "dof dof"]) -> Float[np.ndarray, "dof source"]:
    """Factor :math:`L` of :math:`S = L L^T`, one column an independent source."""
    values, vectors = scipy.linalg.eigh(density)
    largest = values.max(initial=0.0)
    if values.min(initial=0.0) < -1e-9 * largest or not largest > 0:
        raise ValueError(
            "force_psd is no density: it must be symmetric, with no negative eigenvalue and "
            "some power. Check its entries."
        )
    sources = values > 1e-14 * largest
    return np.asarray(vectors[:, sources] * np.sqrt(values[sources]))


def _amplitudes(
    structure: Structure,
    force_psd: float | State | Float[np.ndarray, "dof dof"],
    lines: int,
    period: int,
    rng: np.random.Generator,
) -> Complex[np.ndarray, "frequency dof"]:
    """Independent Gaussian lines of a spectrum with the density of the forces."""
    root = density_root(force_density(structure, force_psd)) / 2
    parts = rng.standard_normal((2, lines, root.shape[1]))
    return np.asarray((parts[0] + 1j * parts[1]) @ root.T)


def _by_modes(
    structure: Structure,
    modes: ComplexModes,
    force: Motion,
    rate_hz: float,
    start: tuple[State, State],
    hold: str,
) -> tuple[Motion, Motion]:
    """Sum of modes; of each pair, twice the real part of one."""
    poles = np.concatenate([modes.poles, modes.real_poles])
    shapes = np.concatenate([modes.shapes, modes.real_shapes], axis=1)
    norms = np.concatenate([modes.norms, modes.real_norms])
    share = np.where(np.arange(len(poles)) < len(modes.poles), 2.0, 1.0)
    momentum = structure.mass @ start[1] + structure.damping @ start[0]
    now = (shapes.T @ momentum + poles * (shapes.T @ (structure.mass @ start[0]))) / norms
    kept, before, after = _hold(poles / rate_hz, hold)
    to_modes = shapes / norms
    q, v = np.empty_like(force), np.empty_like(force)
    last = np.zeros(len(poles), dtype=complex)
    for first in range(0, len(force), CHUNK):
        pushed = (force[first : first + CHUNK] @ to_modes) / rate_hz
        come = after * pushed
        come[1:] += before * pushed[:-1]
        come[0] = now if first == 0 else kept * now + before * last + come[0]
        waves = np.stack(
            [
                scipy.signal.lfilter([1.0], [1.0, -pole], mode)
                for pole, mode in zip(kept, come.T, strict=True)
            ],
            axis=1,
        )
        now, last = waves[-1], pushed[-1]
        waves = share * waves
        q[first : first + CHUNK] = (waves @ shapes.T).real
        v[first : first + CHUNK] = ((waves * poles) @ shapes.T).real
    return q, v


def _hold(
    step: Complex[np.ndarray, " mode"], hold: str
) -> tuple[
    Complex[np.ndarray, " mode"], Complex[np.ndarray, " mode"], Complex[np.ndarray, " mode"]
]:
    r"""Weights of :math:`p_{k+1} = E p_k + B_0 f_k + B_1 f_{k+1}` for poles times the step."""
    whole = np.zeros((len(step), 3, 3), dtype=complex)
    whole[:, 0, 0] = step
    whole[:, 0, 1] = whole[:, 1, 2] = 1.0
    moved = scipy.linalg.expm(whole)
    kept, constant, ramp = moved[:, 0, 0], moved[:, 0, 1], moved[:, 0, 2]
    if hold == "zero":
        return kept, constant, 0 * ramp
    return kept, constant - ramp, ramp


def _by_exponential(
    structure: Structure,
    force: Motion,
    rate_hz: float,
    start: tuple[State, State],
    hold: str,
) -> tuple[Motion, Motion]:
    dofs = structure.dofs
    whole = np.zeros((4 * dofs, 4 * dofs))
    whole[: 2 * dofs, : 2 * dofs] = state_matrix(structure) / rate_hz
    whole[dofs : 2 * dofs, 2 * dofs : 3 * dofs] = scipy.linalg.inv(structure.mass) / rate_hz
    whole[2 * dofs : 3 * dofs, 3 * dofs :] = np.eye(dofs)
    moved = scipy.linalg.expm(whole)[: 2 * dofs]
    constant, ramp = moved[:, 2 * dofs : 3 * dofs], moved[:, 3 * dofs :]
    before, after = (constant, 0 * ramp) if hold == "zero" else (constant - ramp, ramp)
    pushed = force[:-1] @ before.T + force[1:] @ after.T
    states = np.empty((len(force), 2 * dofs))
    state = np.concatenate(start)
    for k in range(len(force)):
        states[k] = state
        if k < len(pushed):
            state = moved[:, : 2 * dofs] @ state + pushed[k]
    return states[:, :dofs], states[:, dofs:]

"""Least squares for the force at one place, with constants and initial states eliminated."""

import copy
import functools
from collections.abc import Iterable, Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.localization.latent_force import RIDGE, real_products
from slowtime.discrepancy.localization.pair_ranking import MIN_DISTINCT_SHARE
from slowtime.discrepancy.localization.perturbed_reference import (
    Columns,
    LinearConstants,
    PerturbedReference,
)
from slowtime.dynamics.effects import Place
from slowtime.signals.spectra import transform

MAX_FORCE = 1e60
"""[N] Modulus from which a force counts as none. Source: its fourth power still is a number
in double precision."""
ForceSpectra = Complex[np.ndarray, "frequency column"]


class ForceSpace:
    """Whitened lines of the residual, projected on forces at one place.

    Constants, under their priors, and initial states are eliminated from the normal equations
    (Schur complement).

    Raises
    ------
    numpy.linalg.LinAlgError
        Where the reference diverges, so that its spectra are not finite.
    """

    def __init__(
        self, fit: Fit, located: Localization, place: Place, *, keeps: bool = False
    ) -> None:
        found = located.group(place).explained
        self.located, self.place = located, place
        self.source = next(s for s in located.linear.sources() if s.place == place)
        known = _linear_constants(fit, located)
        change = known.within(found.constants)
        tuned = [PerturbedReference.of(located.linear, t, known, change) for t in located.lines]
        self.latents = [located.latent(place, i) for i in range(len(located.trials))]
        constants = len(known.sd)
        states = tuned[0].decays.shape[2]
        size = constants + states * len(tuned)
        matrix, right = np.zeros((size, size)), np.zeros(size)
        self.where: list[np.ndarray] = []
        white: list[Columns] = []
        self.square, self.count = 0.0, 0
        for i, one in enumerate(tuned):
            lines, force = located.lines[i], found.forces[i]
            motion = lines.motion + found.shifts[i] + one.free.moved(force.state)
            base = lines.base + self.source.base * force.mean
            explained = force.linear + force.transfer * force.mean[:, None]
            residual = one.residual + lines.gap_spectrum(explained + one.decays @ force.state)
            scale = np.sqrt(lines.noise)[:, :, None]
            whole = np.concatenate(
                [one.columns(known, motion, base), one.decays, residual[:, :, None]], axis=2
            )
            whole /= scale
            inner = 2 * real_products(whole.reshape(-1, whole.shape[2]))
            at = np.r_[0:constants, constants + i * states : constants + (i + 1) * states]
            matrix[np.ix_(at, at)] += inner[:-1, :-1]
            right[at] += inner[:-1, -1]
            self.square += float(inner[-1, -1])
            self.count += 2 * residual.size
            white.append(whole)
            self.where.append(at)
        self._see(tuned, white)
        self._kept = (tuned, white) if keeps else None
        off = (known.reference_change + change) / known.sd
        own = np.arange(constants)
        matrix[own, own] += 1 / known.sd**2
        right[own] -= off / known.sd
        self.square += float(off @ off)
        self.scale = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            raise np.linalg.LinAlgError(f"The model diverges: no finite forces at {place}.")
        inner = matrix * np.outer(self.scale, self.scale) + RIDGE * np.eye(size)
        self.factor = scipy.linalg.cho_factor(inner)
        self.right = right * self.scale
        self.solved = scipy.linalg.cho_solve(self.factor, self.right)
        self.cost_without = self.square - float(self.right @ self.solved)
        """Chi squared without any force at the place."""
        self.names, self.change = _constant_names(fit), change
        self.reference = fit.free[_constant_index(fit)]
        deviation = known.reference_change + change + (self.solved * self.scale)[:constants]
        self.sd, self.pulls = known.sd, deviation / known.sd

    def elsewhere(self, place: Place) -> "ForceSpace":
        """Give the space of another place to which the same motion belongs."""
        # What constants and initial states do along the motion is not computed again.
        if self._kept is None:
            raise ValueError("Make the space with keeps=True to see other places from it.")
        other = copy.copy(self)
        other.__dict__.pop("states", None)
        other.place, located = place, self.located
        other.source = next(s for s in located.linear.sources() if s.place == place)
        other.latents = [located.latent(place, i) for i in range(len(located.trials))]
        other._see(*self._kept)
        return other

    def _see(self, tuned: Sequence[PerturbedReference], white: Sequence[Columns]) -> None:
        """Compute the readings of a unit force, and its products with all columns."""
        self.along: list[ForceSpectra] = []
        self.units: list[ForceSpectra] = []
        """Whitened readings of a unit force (frequency, sensor), trial by trial."""
        self.signal: list[Float[np.ndarray, " frequency"]] = []
        for one, columns, lines in zip(tuned, white, self.located.lines, strict=True):
            unit = one.transfer(self.source) / np.sqrt(lines.noise)
            self.units.append(unit)
            self.along.append(2 * np.einsum("fs,fsb->fb", unit.conj(), columns))
            self.signal.append(2 * np.sum(np.abs(unit) ** 2, axis=1))

    @functools.cached_property
    def states(self) -> list[dict[tuple[str, str], float]]:
        """Initial state of each trial, by coordinate, given the force estimated here."""
        located, names = self.located, self.located.linear.structure.names
        own = [("displacement", n) for n in names] + [("velocity", n) for n in names]
        explained = located.group(self.place).explained
        begun = [located.motion(explained, i)[:2, 0] for i in range(len(located.trials))]
        return [dict(zip(own, one.ravel().tolist(), strict=True)) for one in begun]

    def lines_of(
        self, series: Iterable[Float[np.ndarray, "time column"]]
    ) -> list[ForceSpectra]:
        """Transform forces [N] (time, column) by trial; zero for one that is not finite."""
        whole = list(series)
        fine = np.all([(np.abs(one) < MAX_FORCE).all(axis=0) for one in whole], axis=0)
        return [
            transform(one if fine.all() else np.where(fine, one, 0.0), lines.rate_hz)[1][
                : len(lines.frequency_hz)
            ]
            for one, lines in zip(whole, self.located.lines, strict=True)
        ]

    def normal_equations(
        self, forces: list[ForceSpectra]
    ) -> tuple[Float[np.ndarray, "column column"], Float[np.ndarray, " column"]]:
        """Form the normal equations of several forces, all else eliminated."""
        cross, seen = self.products(forces)
        inner = np.zeros((len(seen), len(seen)))
        for force, signal in zip(forces, self.signal, strict=True):
            inner += (force.conj().T @ (signal[:, None] * force)).real
        taken = scipy.linalg.cho_solve(self.factor, cross)
        return inner - cross.T @ taken, seen - cross.T @ self.solved

    def power(self, forces: list[ForceSpectra]) -> Float[np.ndarray, " column"]:
        """Squared response of the sensors to each force, nothing eliminated."""
        heard = [
            one @ np.abs(force) ** 2 for one, force in zip(self.signal, forces, strict=True)
        ]
        return np.asarray(np.sum(heard, axis=0))

    def products(
        self, forces: list[ForceSpectra]
    ) -> tuple[Float[np.ndarray, "nuisance column"], Float[np.ndarray, " column"]]:
        """Products of forces with constants and initial states, and with the residual."""
        count = forces[0].shape[1]
        cross, seen = np.zeros((len(self.right), count)), np.zeros(count)
        for force, along, at in zip(forces, self.along, self.where, strict=True):
            both = (force.conj().T @ along).real
            cross[at] += both[:, :-1].T
            seen += both[:, -1]
        return cross * self.scale[:, None], seen

    def constants_beside(
        self, taken: Float[np.ndarray, " nuisance"]
    ) -> dict[tuple[str, str], float]:
        """Solve for the constants, given the products of known forces with them, scaled."""
        found = scipy.linalg.cho_solve(self.factor, self.right - taken)
        found *= self.scale
        count = len(self.change)
        whole = self.reference * (1 + self.change + found[:count])
        return dict(zip(self.names, whole.tolist(), strict=True))

    def separate_fits(
        self, forces: list[ForceSpectra]
    ) -> tuple[Float[np.ndarray, " column"], Float[np.ndarray, " column"]]:
        """Fit each force by itself; give its strength and the chi squared that it explains."""
        cross, seen = self.products(forces)
        whole = self.power(forces)
        power = whole - np.sum(cross * scipy.linalg.cho_solve(self.factor, cross), axis=0)
        seen -= cross.T @ self.solved
        heard = power > MIN_DISTINCT_SHARE * np.maximum(whole, np.finfo(float).tiny)
        strength = np.where(heard, seen / np.where(heard, power, 1.0), 0.0)
        return strength, strength * np.where(heard, seen, 0.0)

    def fit_within_tolerances(self, forces: list[ForceSpectra]) -> tuple[float, float]:
        """Fit a force that constants can reproduce, by the priors of these constants.

        Gives its strength, and the decrease of their squared deviations; zeros where the
        sensors tell the force from changed constants.
        """
        cross, whole = self.products(forces)[0][:, 0], float(self.power(forces)[0])
        taken = scipy.linalg.cho_solve(self.factor, cross)
        if not whole - float(cross @ taken) < MIN_DISTINCT_SHARE * whole:
            return 0.0, 0.0
        spared = (taken * self.scale)[: len(self.sd)] / self.sd
        along_pulls = float(spared @ self.pulls)
        square = float(spared @ spared)
        return along_pulls / square, along_pulls**2 / square


def _constant_names(fit: Fit) -> tuple[tuple[str, str], ...]:
    return tuple((name[0], str(name[1])) for name in fit.prior.names if name[0] != "effect")


def _constant_index(fit: Fit) -> list[int]:
    """Places of the constants of the structure among all that are free."""
    return [i for i, name in enumerate(fit.prior.names) if name[0] != "effect"]


def _linear_constants(fit: Fit, located: Localization) -> LinearConstants:
    index = _constant_index(fit)
    now, mean, sd = fit.free[index], fit.prior.mean[index], fit.prior.sd[index]
    return LinearConstants.of(
        located.linear, _constant_names(fit), (now - mean) / now, sd / np.abs(now)
    )

"""Choice of the multichannel identification method by name."""

import dataclasses

import numpy as np
from jaxtyping import Float

from . import checks
from .automatic.estimation import ModalResult, identify_modes, modelled_band
from .bayes import bayesian_modes
from .estimates import Measured
from .fdd.estimation import efdd, fdd
from .fdd.spectral_decomposition import decompose_spectrum, scaled_coefficients
from .harmonics.beside_lines import FLAG as BESIDE_A_LINE
from .harmonics.beside_lines import MachineLines
from .harmonics.detection import PeakClass, find_harmonics
from .harmonics.periodic_force import FLAG, mean_period, without_periodic_force
from .modes import Mode
from .options import AllChannels, Selection
from .subspace.stabilisation import Stabilisation

CONTRADICTION = 3.0
"""Distance of a Bayesian mode from its candidate, and its error, above which the candidate is
kept [standard deviations of the candidate]. Of independent errors 3 in 100 differences would
be larger; those of the same record are far smaller."""


def by_method(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    method: AllChannels,
    band_hz: tuple[float, float] | None = None,
    selection: Selection | None = None,
) -> ModalResult:
    """Modes of all channels together by one of several methods.

    Parameters
    ----------
    method
        `modes`: subspaces and likelihood, `identify_modes`. `bayes`: the candidates of these by
        the fast Bayesian FFT; a mode that contradicts its candidate is replaced by it, with the
        flag `misfit`, as is one whose fit did not end, with the flag `not_converged`. `fdd`,
        `efdd`: peaks of the first singular value, plain or enhanced; no stabilisation.
    band_hz
        Of the modes that are reported [Hz]. All of the record is modelled, so that a mode does
        not depend on where the edges are.
    selection
        A person's edits of the automatic choice, of `modes` and `bayes`; None for none.

    Raises
    ------
    ValueError
        Where an edit names no mode or pole, or the method has no poles to choose from.
    """
    if method == "modes":
        return identify_modes(samples, rate_hz, band_hz=band_hz, selection=selection)
    if method == "bayes":
        modelled = modelled_band(band_hz, rate_hz, len(samples))
        candidates = identify_modes(samples, rate_hz, band_hz=modelled, selection=selection)
        return _bayesian(samples, rate_hz, candidates).within(band_hz)
    if selection is not None:
        raise ValueError(f"Method {method} has no poles to choose from. Give modes or bayes.")
    return _decomposed(samples, rate_hz, method, band_hz).within(band_hz)


def _decomposed(
    samples: np.ndarray,
    rate_hz: float,
    method: AllChannels,
    band_hz: tuple[float, float] | None,
) -> ModalResult:
    """Modes and lines by frequency domain decomposition; of a periodic force, of its mean."""
    usual = checks.band(None, rate_hz, len(samples))
    everywhere, families = find_harmonics(
        samples, rate_hz, band_hz=checks.modelled_band(band_hz, usual)
    )
    found, periods = without_periodic_force(everywhere, rate_hz / len(samples))
    if periods > 1:
        samples = mean_period(samples.reshape(len(samples), -1), periods)
    lines = tuple(verdict.frequency_hz for verdict in found)
    modes = (efdd if method == "efdd" else fdd)(samples, rate_hz, band_hz=band_hz, lines=lines)
    if periods > 1:
        modes = tuple(dataclasses.replace(mode, flags=(*mode.flags, FLAG)) for mode in modes)
    else:
        modes = _doubted(modes, MachineLines(lines, families, len(samples) / rate_hz))
    spectra = decompose_spectrum(scaled_coefficients(samples, rate_hz, lines), band_hz=band_hz)
    return ModalResult(
        modes=_ascending([*modes, *(_line(verdict) for verdict in found)]),
        stabilisation=_empty(),
        spectrum_hz=spectra.frequency_hz,
        singular_values=spectra.values,
    )


def _doubted(modes: tuple[Mode, ...], machines: MachineLines) -> tuple[Mode, ...]:
    """Flag the modes that may be the rest of a line."""
    return tuple(
        dataclasses.replace(mode, flags=(*mode.flags, BESIDE_A_LINE))
        if machines.judge(mode.frequency_hz, mode.damping_ratio) != "mode"
        else mode
        for mode in modes
    )


def _bayesian(samples: np.ndarray, rate_hz: float, result: ModalResult) -> ModalResult:
    """Structural modes found anew, pole by pole; the lines stay."""
    # The Bayesian model has no periodic force: what is known of such a record is known already.
    if not result.structural or any(FLAG in mode.flags for mode in result.structural):
        return result
    lines = tuple(mode for mode in result.modes if mode.kind == "harmonic")
    modes = [
        dataclasses.replace(
            _agreed(mode, before),
            quality=before.quality,
            flags=tuple(dict.fromkeys((*before.flags, *_agreed(mode, before).flags))),
        )
        for mode, before in zip(
            bayesian_modes(
                samples,
                rate_hz,
                np.array([mode.frequency_hz.value for mode in result.structural]),
                lines=tuple(line.frequency_hz for line in lines),
            ),
            result.structural,
            strict=True,
        )
    ]
    whole = _ascending([*modes, *lines])
    now = dict(zip([*result.structural, *lines], [*modes, *lines], strict=True))
    places = [next(k for k, m in enumerate(whole) if m is now[old]) for old in result.modes]
    before = result.stabilisation.mode
    moved = np.where(before >= 0, np.array(places)[before], -1)
    stabilisation = dataclasses.replace(result.stabilisation, mode=moved)
    return dataclasses.replace(result, modes=whole, stabilisation=stabilisation)


def _agreed(mode: Mode, before: Mode) -> Mode:
    """Most probable mode, or its candidate, flagged, if they contradict or none was found."""
    # Both are likeliest values of one record, so that their difference is no larger than the
    # error of either. A larger one shows that the forces are not as the Bayesian model has
    # them: white within a band, with a flat noise floor.
    pairs = (
        (mode.frequency_hz, before.frequency_hz),
        (mode.damping_ratio, before.damping_ratio),
    )
    # Written so that a NaN contradicts.
    found = "not_converged" not in mode.flags
    agrees = found and all(
        abs(new.value - old.value) <= CONTRADICTION * old.sd
        and new.sd <= CONTRADICTION * old.sd
        for new, old in pairs
    )
    if agrees:
        return mode
    flag = "misfit" if found else "not_converged"
    return dataclasses.replace(before, flags=(*before.flags, flag))


def _line(verdict: PeakClass) -> Mode:
    """Line of a machine as a mode without damping."""
    error = np.sqrt(1.0 / max(10.0 ** (verdict.snr_db / 10.0), 1e-12))
    return Mode(
        frequency_hz=verdict.frequency_hz,
        damping_ratio=Measured(0.0, 0.0),
        correlation=0.0,
        shape=verdict.shape,
        shape_sd=np.where(verdict.shape != 0, min(float(error), 1.0), 0.0),
        kind="harmonic",
        quality=1.0 - verdict.p_structural,
    )


def _ascending(modes: list[Mode]) -> tuple[Mode, ...]:
    return tuple(sorted(modes, key=lambda mode: mode.frequency_hz.value))


def _empty() -> Stabilisation:
    nothing = np.zeros(0)
    return Stabilisation(
        order=np.zeros(0, dtype=int),
        frequency_hz=nothing,
        frequency_sd_hz=nothing,
        damping_ratio=nothing,
        damping_sd=nothing,
        mode=np.zeros(0, dtype=int),
    )

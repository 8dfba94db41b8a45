"""Description of the force found at a place: when it acts, where in frequency, and how."""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import scipy.special
from jaxtyping import Bool, Float

from slowtime.dynamics.effects import Place

from .places import LatentForce, Localization
from .spectral_lines import TrialLines


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class CharacterThresholds:
    """Thresholds of the description of a force, each with its unit, meaning and source."""

    min_signal_to_noise: float = 4.0
    """[1] Power of the force over that of its noise from which a window counts. Source: two
    standard deviations of the noise."""
    min_window_power: float = 0.03
    """[share of the greatest power] That a window must have besides. Source:
    docs/what_decides.md: half and double change no answer."""
    throughout: float = 0.9
    """[share of samples] From which the force acts all the time. Source: docs/what_decides.md:
    half and double change no answer."""
    linear_rest: float = 0.015
    """[share of the force's power] That a linear relation may leave, noise apart. Source:
    docs/what_decides.md: half and double change no answer."""
    min_band_lines: int = 6
    """[lines] Of a band at least, over all trials; two go into its relation. Source:
    docs/what_decides.md: half and double change no answer."""
    onset_power: float = 0.03
    """[share of the greatest power] Up to which there is hardly any force. Source:
    docs/what_decides.md: half and double change no answer."""
    exponent_deviation: float = 0.3
    """[1] Difference of the exponent from 1 that contradicts a linear relation. Source:
    docs/what_decides.md: half and double change no answer."""
    steady_p_value: float = 1e-4
    """[probability] p-value below which a force is called changing. Source: one false alarm
    in ten thousand forces."""
    height_sd: float = 0.03
    """[1] Relative standard deviation of a height that is due to the surface itself. Source:
    docs/what_decides.md: half and double change no answer."""


THRESHOLDS = CharacterThresholds()


Series = Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MotionRange:
    """Root mean square and peak of a motion while the force acts."""

    rms: float
    peak: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Character:
    """Properties of the force at one place.

    Parameters
    ----------
    elongation, rate
        Motion along the place while it acts [m], [m/s]; of sensors and inputs, the reading.
    onset
        Elongation below which there is hardly any force [m]; 0 where there is no such gap, or
        the force is proportional.
    linear_share
        Share of the force's power that one linear filter of the motion gives, the same in all
        trials.
    static_share
        Share of the force's power that one surface over elongation and rate gives (restoring
        force surface).
    odd, even
        Shares of the surface that change, and do not change, sign with the motion; together 1.
    offset
        Constant part of the force [N]; it is left out of what follows.
    exponent
        Of force against motion from window to window: 1 linear, 3 cubic, 0 friction.
    steady
        Whether the surface has the same height at all times; None where there is no surface.
    """

    times_s: tuple[tuple[float, float], ...]
    bands_hz: tuple[tuple[float, float], ...]
    elongation: MotionRange
    rate: MotionRange
    onset: float
    linear_share: float
    linear: bool
    static_share: float
    odd: float
    even: float
    offset: float
    exponent: float
    steady: bool | None

    def amplitude(self, of: str, coordinate: str) -> str:
        """State the motion while the force acts; empty where nothing moves."""
        ranges = ((of, self.elongation, coordinate), ("a rate", self.rate, f"{coordinate}/s"))
        words = [
            f"{name} of {motion.rms:.3g} {unit} rms, {motion.peak:.3g} {unit} at most"
            for name, motion, unit in ranges
            if motion.peak > 0
        ]
        if not words:
            return ""
        below = f"; hardly any below {self.onset:.3g} {coordinate}" if self.onset > 0 else ""
        return f"The force acts at {', and '.join(words)}{below}."


def characterise(located: Localization, place: Place) -> Character:
    """Describe the force at a place.

    References
    ----------
    .. [1] S. F. Masri, T. K. Caughey, "A nonparametric identification technique for nonlinear
       dynamic problems", J. Appl. Mech. 46 (1979), for the restoring force surface.
    """
    latents = [located.latent(place, i) for i in range(len(located.trials))]
    lowest = _lowest_frequency_hz(located)
    windows = [
        _windows(latent, trial.rate_hz, lowest)
        for latent, trial in zip(latents, located.trials, strict=True)
    ]
    acting = _acting_samples(latents, windows)
    share, linear = _linear_share(located, place, latents)
    surface = _ForceSurface.of(latents)
    centred = [dataclasses.replace(m, force=m.force - surface.offset) for m in latents]
    exponent = _exponent(centred, windows)
    models = [located.attenuated(place, i, surface.at(m)) for i, m in enumerate(latents)]
    return Character(
        times_s=_acting_times(latents, acting, located),
        bands_hz=_bands(located, place),
        elongation=_motion_range([m.motion.e[a] for m, a in zip(latents, acting, strict=True)]),
        rate=_motion_range([m.motion.v[a] for m, a in zip(latents, acting, strict=True)]),
        onset=_onset(centred) if exponent[0] > 1 + THRESHOLDS.exponent_deviation else 0.0,
        linear_share=share,
        linear=linear
        and not abs(exponent[0] - 1) > max(3 * exponent[1], THRESHOLDS.exponent_deviation),
        static_share=surface.share,
        odd=surface.odd,
        even=1.0 - surface.odd,
        offset=surface.offset,
        exponent=exponent[0],
        steady=_is_steady(centred, models, surface.share, lowest),
    )


def _lowest_frequency_hz(located: Localization) -> float:
    """Lowest natural frequency [Hz]; bounded by the shortest record where rigid modes exist."""
    s = np.linalg.eigvals(
        np.linalg.solve(located.linear.structure.mass, located.linear.structure.stiffness)
    )
    least = min(4.0 / trial.duration_s for trial in located.trials)
    return max(float(np.sqrt(np.abs(s).min()) / (2 * np.pi)), 2 * least)


def _windows(latent: LatentForce, rate_hz: float, lowest_hz: float) -> list[slice]:
    """Stretches of two periods of the lowest mode."""
    length = max(round(2 * rate_hz / lowest_hz), 16)
    count = max(len(latent.force) // length, 1)
    return [slice(i * length, (i + 1) * length) for i in range(count)]


def _acting_samples(
    latents: Sequence[LatentForce], windows: Sequence[list[slice]]
) -> list[Bool[np.ndarray, " time"]]:
    """Mask of the samples at which the force exceeds its noise, window by window."""
    powers = [
        np.array([np.mean(latent.force[w] ** 2) for w in ws])
        for latent, ws in zip(latents, windows, strict=True)
    ]
    greatest = max(float(power.max()) for power in powers)
    found = []
    for latent, ws, power in zip(latents, windows, powers, strict=True):
        loud = power > max(
            THRESHOLDS.min_signal_to_noise * latent.noise_sd**2,
            THRESHOLDS.min_window_power * greatest,
        )
        at = np.zeros(len(latent.force), dtype=bool)
        for window, is_loud in zip(ws, loud, strict=True):
            at[window] = is_loud
        at[ws[-1].stop :] = loud[-1]
        found.append(at)
    return found


def _acting_times(
    latents: Sequence[LatentForce],
    acting: Sequence[Bool[np.ndarray, " time"]],
    located: Localization,
) -> tuple[tuple[float, float], ...]:
    whole = np.concatenate(list(acting))
    if whole.mean() > THRESHOLDS.throughout:
        return ()
    spans = []
    for trial, at in zip(located.trials, acting, strict=True):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(int)))
        for first, last in edges.reshape(-1, 2) / trial.rate_hz:
            spans.append((float(trial.start_s + first), float(trial.start_s + last)))
    return tuple(sorted(spans))


def _bands(located: Localization, place: Place) -> tuple[tuple[float, float], ...]:
    """Bands in which the force is stronger than the noise of its estimate, joined."""
    explained = located.group(place).explained
    found: list[tuple[float, float]] = []
    for lines, force in zip(located.lines, explained.forces, strict=True):
        heard = force.variance * force.signal
        for band in range(1, lines.bands):
            own = lines.band == band
            if heard[own].mean() > 1:
                spread = lines.frequency_hz[own]
                found.append((float(spread[0]), float(spread[-1])))
    return _merge_bands(
        found, 1.5 * max(float(lines.frequency_hz[1]) for lines in located.lines)
    )


def _merge_bands(
    spans: list[tuple[float, float]], gap: float
) -> tuple[tuple[float, float], ...]:
    joined: list[tuple[float, float]] = []
    for low, high in sorted(spans):
        if joined and low <= joined[-1][1] + gap:
            joined[-1] = (joined[-1][0], max(joined[-1][1], high))
        else:
            joined.append((low, high))
    return tuple(joined)


def _motion_range(parts: list[np.ndarray]) -> MotionRange:
    whole = np.concatenate(parts)
    if not whole.size:
        return MotionRange(rms=0.0, peak=0.0)
    return MotionRange(rms=float(np.sqrt(np.mean(whole**2))), peak=float(np.abs(whole).max()))


def _onset(latents: Sequence[LatentForce]) -> float:
    """Elongation [m] below which the force is its noise, and above which it grows."""
    size = np.concatenate([np.abs(m.motion.e) for m in latents])
    force = np.concatenate([m.force**2 for m in latents])
    noise = np.mean([m.noise_sd**2 for m in latents])
    edges = np.unique(np.quantile(size, np.linspace(0, 1, 25)))
    if len(edges) < 6:
        return 0.0
    bins = np.clip(np.searchsorted(edges, size, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(bins, minlength=len(edges) - 1)
    power = np.bincount(bins, force, minlength=len(edges) - 1) / np.maximum(count, 1)
    # Estimates are smoothed in time: windows without force keep some of their neighbours.
    so_far = np.cumsum(power * count) / np.maximum(np.cumsum(count), 1)
    quiet = np.flatnonzero(so_far < max(2 * noise, THRESHOLDS.onset_power * power.max()))
    below = int(quiet[-1]) + 1 if 0 < len(quiet) < len(so_far) else 0
    return float(edges[below]) if below >= 3 else 0.0


def _linear_share(
    located: Localization, place: Place, latents: Sequence[LatentForce]
) -> tuple[float, bool]:
    """Share of the force's power that one gain of the motion per band gives, in all trials."""
    explained = located.group(place).explained
    grid = np.concatenate([lines.frequency_hz for lines in located.lines])
    forces, motions, noises = [], [], []
    for lines, found, latent in zip(located.lines, explained.forces, latents, strict=True):
        forces.append(_tapered_spectrum(latent.force, lines))
        series = latent.motion.a if place.kind == "base" else latent.motion.e
        motions.append(_tapered_spectrum(series, lines))
        noises.append(found.posterior_variance**2 * found.signal)
    force, motion = np.concatenate(forces), np.concatenate(motions)
    scale = latents[0].noise_sd / max(
        float(np.sqrt(noises[0].sum() * located.lines[0].frequency_hz[1])), 1e-300
    )
    noise = float(np.concatenate(noises).sum()) * scale**2
    edges = _band_edges(grid)
    left = used = 0.0
    for low, high in itertools.pairwise(edges):
        own = (grid >= low) & (grid < high)
        if own.sum() < 3:
            left += float(np.sum(np.abs(force[own]) ** 2))
            continue
        ramp = (grid[own] - low) / (high - low) - 0.5
        basis, _ = np.linalg.qr(np.stack([motion[own], ramp * motion[own]], axis=1))
        rest = force[own] - basis @ (basis.conj().T @ force[own])
        left += float(np.sum(np.abs(rest) ** 2)) * own.sum() / max(own.sum() - 2, 1)
        used += 1
    total = float(np.sum(np.abs(force) ** 2))
    true = max(total - noise, 1e-12 * total, 1e-300)
    excess = max(left - noise, 0.0)
    share = float(np.clip(1 - excess / true, 0, 1))
    return share, bool(excess < max(THRESHOLDS.linear_rest * true, 0.1 * noise))


def _band_edges(grid: Float[np.ndarray, " line"]) -> list[float]:
    """Edges of bands of constant relative width, wider where they would have too few lines."""
    lines = np.sort(grid[grid > 0])
    first, *others, last = np.geomspace(lines[0], lines[-1] * 1.001, 60).tolist()
    edges = [first]
    for edge in others:
        below = np.searchsorted(lines, [edges[-1], edge])
        if min(below[1] - below[0], len(lines) - below[1]) >= THRESHOLDS.min_band_lines:
            edges.append(edge)
    return [*edges, last]


def _tapered_spectrum(series: Series, lines: TrialLines) -> np.ndarray:
    """Spectrum of a tapered series, in the scale of the lines."""
    taper = np.hanning(len(series)) * np.sqrt(8 / 3)
    scale = np.sqrt(2.0 / (lines.rate_hz * len(series)))
    return np.asarray(scale * np.fft.rfft(series * taper)[: len(lines.frequency_hz)])


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _ForceSurface:
    """Force as a sum of simple functions of elongation and rate."""

    scales: tuple[float, float]
    weights: Float[np.ndarray, " function"]
    share: float
    odd: float
    offset: float

    @classmethod
    def of(cls, latents: Sequence[LatentForce]) -> "_ForceSurface":
        e = np.concatenate([m.motion.e for m in latents])
        v = np.concatenate([m.motion.v for m in latents])
        force = np.concatenate([m.force for m in latents])
        scales = (_rms_or_one(e), _rms_or_one(v))
        functions = _surface_functions(e / scales[0], v / scales[1])
        weights = np.linalg.lstsq(np.hstack(functions), force, rcond=1e-8)[0]
        first_even = functions[0].shape[1]
        odd, even = (
            basis @ part
            for basis, part in zip(functions, np.split(weights, [first_even]), strict=True)
        )
        total = float(np.sum(force**2))
        left = float(np.sum((force - odd - even) ** 2))
        even = even - weights[first_even]
        parts = float(np.sum(odd**2)), float(np.sum(even**2))
        return cls(
            scales=scales,
            weights=weights,
            share=max(0.0, 1 - left / total) if total > 0 else 0.0,
            odd=parts[0] / sum(parts) if sum(parts) > 0 else 1.0,
            offset=float(weights[first_even]),
        )

    def at(self, latent: LatentForce) -> Series:
        e, v = latent.motion.e / self.scales[0], latent.motion.v / self.scales[1]
        return np.asarray(np.hstack(_surface_functions(e, v)) @ self.weights - self.offset)


def _surface_functions(
    e: Series, v: Series
) -> tuple[Float[np.ndarray, "time odd"], Float[np.ndarray, "time even"]]:
    """Functions that change sign with the motion, and those that do not, the constant first."""
    sign = np.tanh(10 * v)
    odd = [e, v, e**3, v**3, e**2 * v, e * v**2, sign, v * np.abs(v), e * np.abs(e), e**5]
    even = [np.ones_like(e), e**2, v**2, e * v, np.abs(e), np.abs(v), e**4]
    return np.stack(odd, axis=1), np.stack(even, axis=1)


def _rms_or_one(series: Series) -> float:
    return float(np.sqrt(np.mean(series**2))) or 1.0


def _exponent(
    latents: Sequence[LatentForce], windows: Sequence[list[slice]]
) -> tuple[float, float]:
    """Slope of log force against log motion from window to window, and its sd."""
    force, motion = [], []
    for latent, ws in zip(latents, windows, strict=True):
        for w in ws:
            power = np.mean(latent.force[w] ** 2) - latent.noise_sd**2
            size = np.mean(latent.motion.e[w] ** 2)
            if power > THRESHOLDS.min_signal_to_noise * latent.noise_sd**2 and size > 0:
                force.append(np.log(power) / 2)
                motion.append(np.log(size) / 2)
    if len(force) < 4 or np.ptp(motion) < 0.2:
        return 0.0, np.inf
    x, y = np.array(motion) - np.mean(motion), np.array(force) - np.mean(force)
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    return slope, math.sqrt(float(left @ left / (len(x) - 2) / (x @ x)))


def _is_steady(
    latents: Sequence[LatentForce], models: Sequence[Series], share: float, lowest_hz: float
) -> bool | None:
    """Whether the surface has the same height in all stretches of the campaign."""
    if share < 0.3:
        return None
    heights, errors = [], []
    for latent, model in zip(latents, models, strict=True):
        times = latent.motion.times
        # Neighbouring samples go together over about a period of the lowest mode.
        together = max(1.0 / (lowest_hz * (times[1] - times[0])) / 2, 1.0)
        for part in np.array_split(np.arange(len(model)), 4):
            m, f = model[part], latent.force[part]
            power = float(m @ m)
            if power <= len(part) * latent.noise_sd**2:
                continue
            height = float(m @ f) / power
            left = float(np.mean((f - height * m) ** 2))
            heights.append(height)
            errors.append(np.sqrt(left * together / power))
    if len(heights) < 2:
        return None
    # A height is no better than the surface it is the height of.
    values = np.array(heights)
    sds = np.maximum(np.array(errors), THRESHOLDS.height_sd)
    mean = float(np.sum(values / sds**2) / np.sum(1 / sds**2))
    spread = float(np.sum(((values - mean) / sds) ** 2))
    return bool(
        scipy.special.chdtrc(max(len(values) - 1, 1), spread) > THRESHOLDS.steady_p_value
    )

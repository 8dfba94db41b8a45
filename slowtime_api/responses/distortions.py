"""Nonlinear distortion under periodic excitation."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.identification.nonlinear_distortion import (
    Distortion,
    MeasuredResonance,
    distortion_of,
    find_period,
    fit_resonance,
    realisation_of,
    sort_by_level,
)
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_services.argument_checks import Count, NotNegative, Positive, checked

SYMMETRIES = {
    "none": "No nonlinear distortion was found above the noise.",
    "odd": "The nonlinearity is odd (equal in both directions), such as "
    "a cubic spring or dry friction.",
    "even": "The nonlinearity is even (different in the two directions), such as a one-sided "
    "stop "
    "or a quadratic spring.",
    "odd and even": "The nonlinearity has odd and even parts.",
    "unknown": "The symmetry is not determined. Measure several periods of an odd multisine, "
    "with some odd lines left out or in several realisations.",
}
"""Symmetry of a nonlinearity → sentence."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MeasuredDistortion(Result):
    """Best linear approximation, noise and nonlinear distortion at each level of excitation.

    Parameters
    ----------
    levels
        One per level, the weakest first: lines, response, noise and distortion at them.
    resonances
        Natural frequency and damping ratio at each level; None where no resonance was found.
    period
        Length of a period of the excitation [samples].
    """

    levels: tuple[Distortion, ...]
    resonances: tuple[MeasuredResonance | None, ...]
    period: int

    @property
    def sentence(self) -> str:
        """The answer in words."""
        strongest = self.levels[-1]
        said = [SYMMETRIES[strongest.symmetry]]
        first, last = self.resonances[0], self.resonances[-1]
        if len(self.levels) > 1 and first is not None and last is not None:
            said.append(
                f"From level {self.levels[0].level:.4g} to {strongest.level:.4g} the frequency "
                f"goes from {first.frequency_hz:.5g} ± {first.frequency_sd_hz:.2g} to "
                f"{last.frequency_hz:.5g} ± {last.frequency_sd_hz:.2g} Hz, the damping ratio "
                f"from {100 * first.damping:.3g} "
                f"± {100 * first.damping_sd:.2g} to {100 * last.damping:.3g} ± "
                f"{100 * last.damping_sd:.2g} %."
            )
        return " ".join(said)

    @property
    def heading(self) -> str:
        """The answer in words."""
        return self.sentence

    def rows(self) -> list[dict[str, Any]]:
        """Return each level.

        Returns
        -------
        One dictionary per level: ``level``, ``realisations``, ``periods``; medians of ``noise``
        and ``nonlinear`` distortion over the response [1]; ``p_value`` [1]; amplitudes and
        noise of the odd and even lines that the input leaves out; ``symmetry``; frequency [Hz]
        and damping ratio [1] of the resonance. Numbers that are not known are NaN.
        """
        return [
            _level(one, mode) for one, mode in zip(self.levels, self.resonances, strict=True)
        ]

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw response, noise and distortion at each level.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        for k, one in enumerate(self.levels):
            for part, values, style in (
                ("response", np.abs(one.response), "-"),
                ("noise", one.noise_sd, ":"),
                ("distortion", one.nonlinear_sd, "."),
            ):
                label = f"{part}, level {one.level:.3g}"
                axes.semilogy(one.frequency_hz, values, style, color=f"C{k}", label=label)
        axes.set(xlabel="frequency [Hz]", ylabel="output over input")
        axes.legend(fontsize="small")
        return save(axes, path)


def _level(found: Distortion, mode: MeasuredResonance | None) -> dict[str, Any]:
    """Return the row of a level."""
    size = np.abs(found.response)
    nothing = float("nan")
    return {
        "level": found.level,
        "realisations": found.realisations,
        "periods": found.periods,
        "noise": float(np.median(found.noise_sd / size)),
        "nonlinear": float(np.median(found.nonlinear_sd / size)),
        "p_value": found.p_value,
        "odd_lines": found.odd.amplitude if found.odd else nothing,
        "odd_noise": found.odd.noise if found.odd else nothing,
        "even_lines": found.even.amplitude if found.even else nothing,
        "even_noise": found.even.noise if found.even else nothing,
        "symmetry": found.symmetry,
        "frequency_hz": mode.frequency_hz if mode else nothing,
        "frequency_sd_hz": mode.frequency_sd_hz if mode else nothing,
        "damping": mode.damping if mode else nothing,
        "damping_sd": mode.damping_sd if mode else nothing,
    }


@checked
def distortion(
    signals: Signals | Sequence[Signals],
    input_channel: str,
    output_channel: str,
    *,
    period: Count | None = None,
    transient_s: NotNegative = 0.0,
    band_hz: tuple[float, float] | None = None,
    near_hz: Positive | None = None,
) -> MeasuredDistortion:
    """Measure nonlinear distortion from responses to periodic excitation.

    `slowtime.fit_decay` measures damping against amplitude from free decays.

    Parameters
    ----------
    signals
        Records under periodic excitation, such as multisines of several realisations and
        levels. Records of the same level are averaged.
    input_channel, output_channel
        Channels of the excitation and of the response.
    period
        Length of a period [samples]; found in the first record where not given.
    transient_s
        Time at the beginning of each record that is left out [s].
    band_hz
        Least and largest frequency [Hz]; all that are excited where not given.
    near_hz
        Frequency near which the resonance is fitted [Hz]; the highest peak where not given.

    Returns
    -------
    Response, noise and distortion at each level, and the symmetry of the nonlinearity.

    Raises
    ------
    ValueError
        If a record has gaps, is not periodic, or has no such channel.

    References
    ----------
    .. [1] R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach,
       2nd ed., Wiley, 2012, chapter 4.

    Examples
    --------
    >>> rng, odd = np.random.default_rng(0), np.arange(1, 120, 2)
    >>> lines = odd[odd % 10 != 5]
    >>> spectrum = np.zeros(257, dtype=complex)
    >>> spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    >>> force = np.tile(np.fft.irfft(spectrum), 6)
    >>> both = np.stack([force, 2.0 * force + 1e-5 * rng.standard_normal(len(force))], 1)
    >>> record = Signals(both, 512.0, ["force", "motion"])
    >>> distortion(record, "force", "motion", period=512).levels[0].symmetry
    'none'
    """
    records = [signals] if isinstance(signals, Signals) else list(signals)
    if not records:
        raise ValueError("signals=[] was given. Give at least one record.")
    given = []
    for one in records:
        u, y = (column_of(one, name) for name in (input_channel, output_channel))
        skipped = round(transient_s * one.rate_hz)
        if period is None:
            period = find_period(u[skipped:])
        given.append(realisation_of(u, y, one.rate_hz, period, skipped))
    assert period is not None
    found = tuple(distortion_of(group, band_hz) for group in sort_by_level(given))
    modes = tuple(
        fit_resonance(d.frequency_hz, d.response, _known_sd(d), near_hz) for d in found
    )
    return MeasuredDistortion(levels=found, resonances=modes, period=period)


def column_of(signals: Signals, name: str) -> Float[np.ndarray, " time"]:
    """Return the samples of one channel without gaps.

    Raises
    ------
    ValueError
        If there is no such channel, or samples are missing.
    """
    if signals.record.gaps:
        raise ValueError(
            "Samples are missing within the signals. Give a part without gaps, by "
            "signals[first_s:last_s]."
        )
    if name not in signals:
        raise ValueError(f"Channel {name!r} was given. Allowed: {', '.join(signals.channels)}.")
    return np.asarray(signals[name].samples[:, 0], dtype=float)


def _known_sd(found: Distortion) -> Float[np.ndarray, " line"] | None:
    for sd in (found.total_sd, found.noise_sd):
        if np.isfinite(sd).all():
            return np.asarray(sd)
    return None

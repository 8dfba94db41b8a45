"""What a diagnosis says: for people, for machines, and for pictures."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description, Input, Sensor
from slowtime.dynamics.effects import Effect, Place

from .data.screening import Finding

Verdict = Literal[
    "missing_effect",
    "nothing_missing",
    "parameters_only",
    "sensor_fault",
    "input_fault",
    "undecided",
    "unknown_effect",
]


@dataclasses.dataclass(frozen=True, slots=True)
class Number:
    """A parameter that was estimated, in its unit; "1" is that of a ratio."""

    value: float
    sd: float
    unit: str

    @property
    def text(self) -> str:
        """Write it to the digits that its standard deviation leaves.

        Examples
        --------
        >>> Number(20.3881, 0.142, "N").text
        '20.39 ± 0.14 N'
        >>> Number(1.2345e7, 650.0, "N/m^3").text
        '1.2345e+07 ± 6.5e+02 N/m^3'
        """
        unit = "" if self.unit == "1" else self.unit
        if not self.sd > 0:
            return f"{self.value:.6g} {unit}".rstrip()
        places = 1 - math.floor(math.log10(self.sd))
        if 0 <= places <= 6 and abs(self.value) < 1e6:
            text = f"{self.value:.{places}f} ± {self.sd:.{places}f}"
        else:
            digits = math.floor(math.log10(max(abs(self.value) / self.sd, 1.0))) + 2
            text = f"{self.value:.{max(min(digits, 8), 2)}g} ± {self.sd:.2g}"
        return f"{text} {unit}".rstrip()


@dataclasses.dataclass(frozen=True, slots=True)
class Rival:
    """Another effect that might stand in the place of the one that was named."""

    effect: str
    place: Place
    probability: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class NamedEffect:
    """One effect that was found.

    Parameters
    ----------
    effect
        Kind, place, and the values of its parameters.
    family
        Confusing two of one family costs less.
    numbers
        Parameters with their standard deviations, by name.
    probability
        That this effect at this place, and no other, is what was missing.
    rivals
        Others, the most probable first.
    sentence
        For people.
    """

    effect: Effect
    family: str
    numbers: Mapping[str, Number]
    probability: float
    rivals: tuple[Rival, ...]
    sentence: str


@dataclasses.dataclass(frozen=True, slots=True)
class Suspect:
    """A place, by how much of the residual a force there explains.

    Parameters
    ----------
    score
        Gain of log likelihood by one unknown force there.
    p_value
        Probability of such a gain where nothing is missing.
    share
        Of the residual power beyond the noise that it explains.
    """

    place: Place
    score: float
    p_value: float
    share: float


@dataclasses.dataclass(frozen=True, slots=True)
class When:
    """Times, bands [Hz] and motion in which the residual stands out, and its manner."""

    times_s: tuple[tuple[float, float], ...]
    bands_hz: tuple[tuple[float, float], ...]
    amplitude: str
    linear: bool | None = None
    steady: bool | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class GapStep:
    """Error of the free run once one more effect had been added."""

    effect: str
    place: Place
    nrmse: float


@dataclasses.dataclass(frozen=True, slots=True)
class Gap:
    """Error of the free run over the scatter of the measurement, averaged over sensors.

    Parameters
    ----------
    on
        What it was judged on: `holdout`, or `tail` of the records where none was given.
    worst
        Largest error of the augmented model at one sensor.
    """

    nominal: float
    refitted_nominal: float
    steps: tuple[GapStep, ...]
    augmented: float
    noise_floor: float
    on: Literal["holdout", "tail"]
    worst: float


@dataclasses.dataclass(frozen=True, slots=True)
class Experiment:
    """What to measure next, so that rivals part: one more record.

    Parameters
    ----------
    level
        Factor on the excitation of the strongest record, or on the initial state of a release;
        1 as it was.
    band_hz
        Of the excitation; None as it was.
    excitation
        Its form; None as it was.
    start_s
        Campaign time at which to begin [s]; None at any.
    add_inputs
        Measured forces that drive the structure instead of what did; the others rest.
    """

    sentence: str
    level: float = 1.0
    band_hz: tuple[float, float] | None = None
    excitation: (
        Literal["random", "multisine", "sweep", "sine", "free_decay", "release"] | None
    ) = None
    start_s: float | None = None
    add_sensors: tuple[Sensor, ...] = ()
    add_inputs: tuple[Input, ...] = ()
    separation: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """One record, measured and free-run, for pictures; columns are sensors.

    Where motion was imposed, ``of_force`` is set and the one column is the force.
    """

    times_s: Float[np.ndarray, " time"]
    measured: Float[np.ndarray, "time sensor"]
    nominal: Float[np.ndarray, "time sensor"]
    refitted: Float[np.ndarray, "time sensor"]
    augmented: Float[np.ndarray, "time sensor"]
    of_force: bool = False


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """Densities [unit^2/Hz] of the residual before and after, and of the noise, by sensor."""

    frequency_hz: Float[np.ndarray, " frequency"]
    measured: Float[np.ndarray, "frequency sensor"]
    before: Float[np.ndarray, "frequency sensor"]
    after: Float[np.ndarray, "frequency sensor"]
    noise: Float[np.ndarray, "frequency sensor"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The force that was missing at one place, as recovered, against the motion there.

    Parameters
    ----------
    e, v, force
        Elongation, its rate, and the latent force, at instants of the records.
    law
        Of the effect that was named, at the same instants; None for an unknown effect.
    """

    place: Place
    e: Float[np.ndarray, " point"]
    v: Float[np.ndarray, " point"]
    force: Float[np.ndarray, " point"]
    law: Float[np.ndarray, " point"] | None


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ForceCut:
    """A measured force surface along a straight line of elongations or rates.

    Parameters
    ----------
    at
        Elongation [m] or rate [m/s].
    held
        Rate [m/s] of a cut along the elongation, elongation [m] of one along the rate.
    force, sd
        Force and its standard deviation [N].
    law
        Force of the law that the surface is most like, with the spring and damper beside it
        [N]; not-a-number outside the measured range, None where there is no such law or it
        depends on past motion.
    """

    at: Float[np.ndarray, " point"]
    held: float
    force: Float[np.ndarray, " point"]
    sd: Float[np.ndarray, " point"]
    law: Float[np.ndarray, " point"] | None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeasuredForce:
    """A fitted force surface, for pictures.

    Parameters
    ----------
    low, high, most
        Measured range: least and largest elongation [m], largest rate [m/s].
    e, v
        Elongation [m] and rate [m/s] at instants of the records.
    grid_e, grid_v, grid_force
        Force [N] over (elongation, rate); not-a-number where the records do not come.
    shape
        Shape that it was made to have, in words; empty for any.
    remembers
        Whether it depends on past motion as well, which cuts and grid leave out.
    law
        Name of the law that it is most like; empty for none.
    share
        Of its force that this law explains [1].
    limits
        Elongation and rate above which it is not like the law, in words; empty for none.
    """

    place: Place
    over_e: ForceCut
    over_v: ForceCut
    low: float
    high: float
    most: float
    e: Float[np.ndarray, " sample"]
    v: Float[np.ndarray, " sample"]
    grid_e: Float[np.ndarray, " elongation"]
    grid_v: Float[np.ndarray, " rate"]
    grid_force: Float[np.ndarray, "rate elongation"]
    shape: str
    remembers: bool
    law: str
    share: float
    limits: str


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Answer:
    """What is said alike of the records of a campaign and of a history of features.

    Parameters
    ----------
    verdict
        One word.
    sentence
        For people.
    effects
        In the order in which they were found.
    undecided
        Effects that the records cannot tell apart; empty where all is decided.
    experiment
        What would decide; None where all is decided.
    nothing_probability
        That the nominal model, refitted within its tolerances, lacks nothing.
    residual_white, white_p_value
        Whether what remains looks like the noise that the sensors have anyway.
    """

    verdict: Verdict
    sentence: str
    effects: tuple[NamedEffect, ...]
    undecided: tuple[Rival, ...]
    experiment: Experiment | None
    nothing_probability: float
    residual_white: bool
    white_p_value: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Diagnosis(Answer):
    """The answer of a campaign; fields that are not told here are those of `Answer`.

    Parameters
    ----------
    moved
        Constants of the model that left their tolerance, with new values.
    where
        Places, the most suspect first.
    findings
        Of the screening of channels.
    chi2_per_datum
        Mean square of what the last fit leaves, over the noise; 1 is as good as can be.
    nominal, refitted, augmented
        Models; `augmented` has the effects in. It is the nominal one where the effect is
        unknown, and a fit does worse on what was held out.
    traces, spectra, surface
        For pictures, of the records that were judged on.
    measured_force
        The force surface of `augmented`, where one closes the gap.
    notes
        What the reader should know of the data.
    exhausted
        Whether the computing budget ended the search before every law was tried.
    seconds
        Of computing; filled in by what ran it, for there is no clock here.
    """

    moved: Mapping[str, Number]
    where: tuple[Suspect, ...]
    when: When
    findings: tuple[Finding, ...]
    gap: Gap
    chi2_per_datum: float
    nominal: Description
    refitted: Description
    augmented: Description
    traces: tuple[Traces, ...]
    spectra: Spectra
    surface: Surface | None
    notes: tuple[str, ...]
    measured_force: MeasuredForce | None = None
    exhausted: bool = False
    seconds: float = 0.0

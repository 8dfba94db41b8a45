"""Kinds of effect: names, units, bounds, texts, and laws."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from .compilation import Scalar

Where = Literal["element", "node", "base", "input", "sensor"]
Series = Float[np.ndarray, " time"]
Several = Float[np.ndarray, "*any time"]
Shape = Mapping[str, float]
Values = Float[np.ndarray, " parameter"]
Square = Float[np.ndarray, "own own"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A number that an effect has.

    Parameters
    ----------
    name
        As in a model file, ending in its unit.
    low, high
        Of what is allowed, ends included.
    nonzero
        Zero is not allowed either: for scales that are divided by.
    default
        Where a file leaves it out; None where it must be given. NaN stands for the end of the
        record.
    fitted
        False for what is chosen, as a side or a span, and not estimated.
    choices
        All values allowed, where there are few.
    natural
        Value that it has in the simplest form of the law, or "stiffness" for that of the
        element; None where no value is simpler than others.
    spread
        Name of the parameter that holds the standard deviation of its prior; nothing is known
        about it where empty.
    direction
        Name of the parameter that says which sign this one must have: 1 at least zero, -1 at
        most zero, 0 any. Any where empty.
    """

    name: str
    unit: str
    meaning: str
    low: float = -math.inf
    high: float = math.inf
    nonzero: bool = False
    default: float | None = None
    fitted: bool = True
    choices: tuple[float, ...] = ()
    natural: float | Literal["stiffness"] | None = None
    spread: str = ""
    direction: str = ""

    def refuses(self, value: float) -> str | None:
        """Explain why a value is not allowed.

        Parameters
        ----------
        value
            Value in the unit of the parameter.

        Returns
        -------
        Message to the user; None where the value is allowed.
        """
        if self.default is not None and math.isnan(self.default) and math.isnan(value):
            return None
        if self.choices:
            fine = value in self.choices
            allowed = " or ".join(f"{choice:g}" for choice in self.choices)
        else:
            fine = self.low <= value <= self.high and math.isfinite(value)
            fine = fine and not (self.nonzero and value == 0)
            allowed = self._interval()
        return None if fine else f"`{self.name}` is {value:g}; allowed: {allowed}."

    def bounds(self, known: Mapping[str, float]) -> tuple[float, float]:
        """Give the least and the largest value allowed, given the direction that was chosen.

        Parameters
        ----------
        known
            Values of the other parameters by name, in their units.
        """
        chosen = known.get(self.direction, 0.0)
        return max(self.low, 0.0 if chosen > 0 else self.low), min(
            self.high, 0.0 if chosen < 0 else self.high
        )

    def _interval(self) -> str:
        edge = "above" if self.nonzero else "at least"
        least = f"{edge} {self.low:g}" if math.isfinite(self.low) else ""
        edge = "below" if self.nonzero else "at most"
        most = f"{edge} {self.high:g}" if math.isfinite(self.high) else ""
        both = " and ".join(part for part in (least, most) if part)
        return both or ("any number but 0" if self.nonzero else "any finite number")


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion along an element (second node minus first), or of a node against the base.

    Parameters
    ----------
    e, v, a
        Elongation [m], its rate [m/s], and the rate of that [m/s^2].
    times
        Campaign time of the samples [s].
    """

    e: Series
    v: Series
    a: Series
    times: Series


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    r"""A force :math:`F(e, v, t, z; p)`, with internal states :math:`\dot z_i = r_i(...)`.

    Parameters
    ----------
    force
        Scalar function (e, v, t, z, p) of numbers, which must be written so that numba
        compiles it: numbers, `math`, `if`. On an element, it resists elongation; on a node, it
        pushes the node.
    rates
        One function of the same arguments for each internal state; states start at 0.
    switches
        Names of parameters that are instants [s] at which the force jumps.
    along
        (Known motion, parameters) to the force, where internal states only stand for the
        acceleration; None where the force follows from the functions above.
    """

    force: Scalar
    rates: tuple[Scalar, ...] = ()
    switches: tuple[str, ...] = ()
    along: "Callable[[Motion, Values], Series] | None" = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RecordOffset(Law):
    """A constant on an input or a sensor that each record has a value of its own of.

    It is an internal state that never changes. So it is estimated as initial states are: for
    each fitted record from that record, for a held-out one from its first samples. On an input
    it is a force that acts with it; a sensor reads it in addition, and no force acts.
    """


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Friction:
    r"""A set-valued law :math:`F \in g \operatorname{Sgn}(v)`: real sticking at v = 0.

    Parameters
    ----------
    limit
        :math:`g(e, |v|, t, z, p) \ge 0`, the force of sliding; at :math:`v = 0` the most that
        sticking holds.
    """

    limit: Scalar


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Hidden:
    """A linear addition to mass, damping and stiffness, with hidden coordinates if need be.

    Parameters
    ----------
    matrices
        From parameters to mass, damping and stiffness over (place, hidden coordinates): place
        is the elongation of an element, or the motion of a node. What the base does to hidden
        masses goes by their being carried along.
    coordinates
        How many hidden ones.
    ends
        Whether it couples the motions of the two ends of an element, first and second, which
        are then the place instead of its elongation.
    """

    matrices: Callable[[Values], tuple[Square, Square, Square]]
    coordinates: int = 0
    ends: bool = False


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class InputChange:
    """What reaches the structure in place of what was recorded.

    Parameters
    ----------
    act
        (recorded series, campaign times, parameters) to the series that acts; linear in the
        series but for a constant. There may be several: the last axis is time.
    """

    act: Callable[[Several, Series, Values], Several]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SensorChange:
    """What a sensor tells in place of what is there.

    Parameters
    ----------
    act
        (true series, campaign times, parameters) to the series that is told. There may be
        several: the last axis is time.
    affine
        Whether it is linear in the series, but for a constant.
    undo
        The same the other way round, for a difference of two series told: when it was there.
        None where it is told at its own time.
    """

    act: Callable[[Several, Series, Values], Several]
    affine: bool = True
    undo: Callable[[Several, Series, Values], Several] | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Unmeasured:
    """Motion of the base that nobody measured: nothing in the mean, random otherwise."""


Action = Law | Friction | Hidden | InputChange | SensorChange | Unmeasured


def always(parameters: Mapping[str, float], motion: Motion) -> bool:
    """Tell that a motion shows the effect: for kinds that any motion shows.

    Parameters
    ----------
    parameters
        Parameters of the effect, by name, in their units.
    motion
        Motion of the place of the effect.

    Returns
    -------
    True.
    """
    return True


def no_contradiction(parameters: Mapping[str, float]) -> str | None:
    """Of kinds whose parameters may have any values together: no message."""
    return None


def no_shapes(motion: Motion) -> list[Shape]:
    """Of kinds without a shape: one point, which says nothing."""
    return [{}]


def no_guesses(mass_kg: float, frequencies_hz: Sequence[float]) -> list[Shape]:
    """List no values to begin with: for kinds that a linear model says nothing about."""
    return []


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of effect.

    Parameters
    ----------
    name
        As in a model file.
    family
        One that other kinds have: confusing two of one family costs less, and families tell
        which laws remember (``hysteresis``), dissipate or change by themselves.
    where
        What it sits on.
    parameters
        In the order in which laws see them.
    equation, source, sentence
        For people: the law as text, where it comes from, and what it means on a structure.
    action
        The law.
    strength
        Parameter which the force is proportional to, together with `scales`; None where there
        is no such.
    scales
        Parameters which grow along with the strength.
    quadrature
        Phase [rad], where the force of any phase is a sum of those at 0 and a quarter turn.
    shapes
        From the motion seen to values of the other parameters that make sense for it.
    guesses
        From the mass of a node and the undamped natural frequencies of the model to values of
        all parameters, to begin with where the motion seen misleads.
    shown
        Whether a motion goes through what sets the law, with these parameters, apart from a
        simpler one: who never was as fast as its speed has not seen friction fall.
    title
        What a person calls it; the name in words where not given.
    contains
        Simpler kinds that it becomes for some values of its parameters, or in a limit, beside
        other linear constants of the element.
    similar
        Simpler kinds with a force like its own, which it does not become. A kind that contains
        others, or is similar to such, is tried where none of them explains the records.
    joins
        True for what joins two points that nothing joins in the model, False for a change of
        what joins them there; None for what acts between any two points.
    is_surface
        Whether it is no law but a surface with coefficients, fitted where no law explains the
        records.
    contradiction
        From the parameters by name to a message to the user where their values contradict each
        other, though each is allowed by itself.
    """

    name: str
    family: str
    where: Where
    parameters: tuple[Parameter, ...]
    equation: str
    source: str
    sentence: str
    action: Action
    strength: str | None = None
    scales: tuple[str, ...] = ()
    quadrature: str | None = None
    shapes: Callable[[Motion], list[Shape]] = no_shapes
    guesses: Callable[[float, Sequence[float]], list[Shape]] = no_guesses
    shown: Callable[[Mapping[str, float], Motion], bool] = always
    title: str = ""
    contains: tuple[str, ...] = ()
    similar: tuple[str, ...] = ()
    joins: bool | None = None
    is_surface: bool = False
    contradiction: Callable[[Shape], str | None] = no_contradiction

    def __post_init__(self) -> None:
        names = self.names
        known = (self.strength, self.quadrature, *self.scales)
        strange = [name for name in known if name is not None and name not in names]
        if isinstance(self.action, Law):
            strange += [name for name in self.action.switches if name not in names]
        if strange or len(set(names)) < len(names):
            raise ValueError(
                f"Kind {self.name!r} speaks of {', '.join(strange) or 'one parameter twice'}; "
                f"its parameters are: {', '.join(names) or 'none'}."
            )
        fits = {
            Law: ("element", "node"),
            RecordOffset: ("input", "sensor"),
            Friction: ("element",),
            Hidden: ("element", "node"),
            InputChange: ("input",),
            SensorChange: ("sensor",),
            Unmeasured: ("base",),
        }[type(self.action)]
        if self.where not in fits:
            raise ValueError(
                f"Kind {self.name!r}: a {type(self.action).__name__} cannot sit on "
                f"{self.where!r}. Allowed: {', '.join(fits)}."
            )

        if isinstance(self.action, Hidden) and self.action.coordinates and self.where != "node":
            raise ValueError(
                f"Kind {self.name!r}: hidden coordinates ride on nodes. For memory within an "
                "element, use a Law with rates."
            )

    @property
    def words(self) -> str:
        """Say it for people: the title, and the name by which machines know it."""
        plain = self.name.replace("_", " ").capitalize()
        return f"{self.title} ({self.name})" if self.title else plain

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def states(self) -> int:
        """How many internal states it adds to those of the structure."""
        if isinstance(self.action, Law):
            return len(self.action.rates)
        return 2 * self.action.coordinates if isinstance(self.action, Hidden) else 0

    @property
    def simpler(self) -> tuple[str, ...]:
        """Kinds in place of which it is tried: those it contains or is similar to."""
        return (*self.contains, *self.similar)

    @property
    def is_coupling(self) -> bool:
        """Whether it acts along two coordinates, and so by no force along one motion."""
        return isinstance(self.action, Hidden) and self.action.ends

    @property
    def is_by_record(self) -> bool:
        """Whether it is an offset that each record has a value of its own of."""
        return isinstance(self.action, RecordOffset)

    @property
    def is_factor(self) -> bool:
        """Whether it multiplies the series of an input or of a sensor by its one number."""
        action = self.action
        if not isinstance(action, InputChange | SensorChange) or len(self.names) != 1:
            return False
        times = np.linspace(0.0, 1.0, 65)
        series = 3.0 * np.sin(7.0 * times)
        return all(
            np.allclose(action.act(series, times, np.array([by])), by * series)
            for by in (1.0, 2.0)
        )

    def parameter(self, name: str) -> Parameter:
        """Look up a parameter by name."""
        return self.parameters[self.names.index(name)]

    def values(self, parameters: Mapping[str, float]) -> Values:
        """Parameters in the order in which laws see them, with defaults filled in.

        Parameters
        ----------
        parameters
            Values by name, in their units.

        Returns
        -------
        Values [parameter].

        Raises
        ------
        ValueError
            Where a parameter without a default is missing, or a name is unknown.
        """
        missing = [p.name for p in self.parameters if p.default is None]
        missing = [name for name in missing if name not in parameters]
        strange = [name for name in parameters if name not in self.names]
        if missing or strange:
            raise ValueError(
                f"{self.name} needs {', '.join(self.names) or 'no parameters'}; "
                f"{'missing' if missing else 'unknown'}: {', '.join(missing or strange)}."
            )
        return np.array(
            [float(parameters.get(p.name, p.default or 0.0)) for p in self.parameters]
        )

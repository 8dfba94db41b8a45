"""Settings of a virtual sensor, and S-N curves of points.

An edge that counts no fatigue imports no mechanics: these classes import it when they are used.
"""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from slowtime_schemas.quantities import Frozen, PlainText

if TYPE_CHECKING:
    from slowtime.estimation.virtual import Output
    from slowtime.fatigue.counter import Counter
    from slowtime.fatigue.curves import SNCurve

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Asked(Frozen):
    """A quantity that is asked of a model.

    Examples
    --------
    >>> Asked(name="s", quantity="force", element="k1", factor=2e-5, unit="MPa").unit
    'MPa'
    """

    name: PlainText
    quantity: Literal["displacement", "drift", "force", "moment"]
    node: str | None = None
    """Of a displacement."""
    between: tuple[str, str] | None = None
    """Lower and upper node of a drift; `base` for the ground."""
    element: str | None = None
    """Of a force or a moment."""
    end: Literal["first", "second"] = "first"
    """Of the beam whose moment is asked."""
    factor: float | None = None
    """Units for one of SI, such as MPa for one newton: 1e-6 / area [m^2]."""
    unit: PlainText | None = None
    """Of the values; left out, that of SI."""
    factor_sd: NotNegative = 0.0
    """Relative standard deviation of the factor."""

    @model_validator(mode="after")
    def _says_where(self) -> "Asked":
        needed = {"displacement": "node", "drift": "between"}.get(self.quantity, "element")
        if getattr(self, needed) is None:
            raise ValueError(
                f"{self.name}: a {self.quantity} needs `{needed}`. Give it, such as "
                f"{needed}={'[base, floor1]' if needed == 'between' else 'floor1'}."
            )
        if (self.factor is None) != (self.unit is None):
            raise ValueError(
                f"{self.name}: factor={self.factor} and unit={self.unit} belong together. Give "
                "both, or neither for SI."
            )
        return self

    def output(self) -> "Output":
        """Make the output of a virtual sensor."""
        from slowtime.estimation.virtual import displacement, drift, element_force, moment

        if self.quantity == "displacement":
            found = displacement(str(self.node), name=self.name)
        elif self.quantity == "drift":
            assert self.between is not None
            found = drift(*self.between, name=self.name)
        elif self.quantity == "force":
            found = element_force(str(self.element), name=self.name)
        else:
            found = moment(str(self.element), self.end, name=self.name)
        if self.factor is None or self.unit is None:
            return found
        return found.scaled(self.factor, self.unit, sd=self.factor_sd)


class PointCurve(Frozen):
    """S-N curve and rule for means of a point: a detail category, or constant and slope."""

    detail_category: Positive | None = None
    """Of EN 1993-1-9 [MPa]; the stress is then in MPa."""
    constant: Positive | None = None
    """Cycles times range to the power of the slope, at the median."""
    slope: Positive | None = None
    knee: NotNegative = 0.0
    lower_slope: Positive | None = None
    cut_off: NotNegative = 0.0
    log10_sd: NotNegative = 0.2
    """Standard deviation of log10 of the life; DNV-RP-C203 takes 0.20 for welded steel."""
    mean_stress: Literal["none", "goodman", "gerber"] = "none"
    strength: Positive | None = None
    """Tensile strength, in the unit of the stress."""
    constant_mean: float = 0.0
    """Stress at rest, which accelerations do not show, in the unit of the stress."""

    @model_validator(mode="after")
    def _is_one_curve(self) -> "PointCurve":
        given = (self.constant is not None, self.slope is not None)
        if given not in ((False, False), (True, True)) or (
            all(given) == (self.detail_category is not None)
        ):
            raise ValueError(
                f"detail_category={self.detail_category}, constant={self.constant}, "
                f"slope={self.slope}: give either a detail category, or constant and slope."
            )
        self.counter()
        return self

    @property
    def curve(self) -> "SNCurve":
        """The median curve."""
        from slowtime.fatigue.curves import SNCurve

        if self.detail_category is not None:
            return SNCurve.of_detail_category(self.detail_category, log10_sd=self.log10_sd)
        assert self.constant is not None
        assert self.slope is not None
        return SNCurve(
            constant=self.constant,
            slope=self.slope,
            knee=self.knee,
            lower_slope=self.lower_slope,
            cut_off=self.cut_off,
            log10_sd=self.log10_sd,
        )

    def counter(self) -> "Counter":
        """Make the counter of a point."""
        from slowtime.fatigue.counter import Counter
        from slowtime.fatigue.mean_stress import MeanStress

        rule = MeanStress(
            rule=self.mean_stress, strength=self.strength, constant_mean=self.constant_mean
        )
        return Counter(curve=self.curve, mean_stress=rule)

"""Sentences on effects, and on what to record where they cannot be told apart."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.diagnosis import Number
from slowtime.history_diagnosis.data.history import FilledCovariate


def number_text(number: Number, *, signed: bool = False) -> str:
    """Write a number, to four digits where its standard deviation is not known.

    Examples
    --------
    >>> number_text(Number(-0.1134, 0.0123, "%/K"))
    '−0.113 ± 0.012 %/K'
    >>> number_text(Number(12.34567, 0.0, "day"), signed=True)
    '+12.35 day'
    """
    if not number.sd > 0.0:
        number = dataclasses.replace(number, value=float(f"{number.value:.4g}"))
    plus = "+" if signed and number.value > 0.0 else ""
    return plus + number.text.replace("-", "−")


def effect_sentence(
    name: str,
    subject: str,
    numbers: Mapping[str, Number],
    covariate: FilledCovariate | None,
) -> str:
    """Describe one effect of the subject, such as "Stiffness"."""
    told = {
        key: number_text(number, signed="slope" in key or "change" in key)
        for key, number in numbers.items()
    }
    followed = covariate.name if covariate is not None else ""
    if name.endswith("_curved"):
        return f"{subject} follows {followed} along a curve that no law of the list draws."
    if name.endswith("_linear") and covariate is not None:
        return f"{subject} follows {followed}, {told['slope']}{_late(told)}."
    if name.endswith("_bilinear"):
        return (
            f"{subject} follows {followed}, bilinear at {told['kink']}: "
            f"{told['slope_below']} below, {told['slope_above']} above{_late(told)}."
        )
    return f"{subject} {_predicate(name, told, followed)}."


def _predicate(name: str, told: dict[str, str], followed: str) -> str:
    match name:
        case "step":
            return f"changes at once by {told['change']} at {told['time']}"
        case "drift_linear":
            since = f" since {told['onset']}" if "onset" in told else ""
            return f"drifts steadily, {told['rate']}{since}"
        case "drift_exponential":
            constant = told["time_constant"]
            how = "slowing down" if constant.startswith("−") else "speeding up"
            return (
                f"drifts exponentially, {how}: {told['change']} over the history, time "
                f"constant {constant.removeprefix('−')}"
            )
        case "drift_power":
            return f"drifts as time to the power {told['exponent']}, {told['change']} so far"
        case "sawtooth" if "last_reset_time" in told:
            return (
                f"goes on by {told['rate']} and falls back every {told['period']}, last at "
                f"{told['last_reset_time']}"
            )
        case "sawtooth":
            return (
                f"rises and falls back like a sawtooth: {told['height']} in each period of "
                f"{told['period']}"
            )
        case "periodic":
            return f"swings by ± ({told['amplitude']}) with a period of {told['period']}"
        case "amplitude_dependence":
            return (
                f"depends on {followed} to the power {told['exponent']}, "
                f"{told['change_at_mean_level']} at its mean"
            )
        case "breathing_crack":
            return (
                f"changes by {told['change']} at {told['time']} and from then on follows "
                f"{followed}, {told['opening_slope']}: a crack that breathes does so"
            )
        case "sensor_noise":
            return (
                f"is read with a scatter {told['factor']} times the stated one since "
                f"{told['time']}: look at the sensor"
            )
    raise ValueError(f"There are no words for {name!r}. Add them where the law was added.")


def suggest_experiment(names: list[str], followed: dict[str, str], span: str) -> str:
    """Suggest what to record so that undecided laws can be told apart."""
    covariates = sorted({followed[name] for name in names if name in followed})
    timed = [name for name in names if name not in followed and name != "nothing_missing"]
    if len(covariates) > 1:
        return (
            f"Record epochs at which {' and '.join(covariates)} do not move together: "
            "one held, the other changed."
        )
    if covariates and timed:
        return (
            f"Go on until {covariates[0]} has come back to where it was at the start: "
            "what follows it comes back too, what follows time does not."
        )
    if covariates and "nothing_missing" not in names:
        return (
            f"Record epochs at the lowest and highest {covariates[0]} there is: "
            "the laws differ most there."
        )
    return (
        f"Go on recording for another {span}, with smaller standard deviations if longer "
        "records allow: the laws part with time."
    )


def _late(told: dict[str, str]) -> str:
    if "lag" in told:
        return f", lagging by {told['lag']}"
    return f", late by {told['delay']}" if "delay" in told else ""

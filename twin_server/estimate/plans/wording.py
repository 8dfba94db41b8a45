"""Writes a plan in words: action, date, reasons, and what would change it."""

import dataclasses
import datetime
import math
from collections.abc import Callable, Mapping

import numpy as np

from slowtime.decisions import ITEMS, BreakEven, Option, Plan, Worth
from slowtime.evolution.life.probability_words import probability_in_words
from slowtime_schemas.slow_times import LAST_CLOCK_S, span_in_words

ITEM_WORDS = {
    "failure": "a failure", "repair": "a repair", "inspection": "an inspection",
    "downtime": "downtime", "closing": "closing", "closed": "being closed",
}  # fmt: skip
assert set(ITEM_WORDS) == set(ITEMS)

UNITS = {"slow_time": "", "s": "s", "h": "h", "d": "days", "month": "months", "year": "years"}

CHANGES_SHOWN = 3
"""Costs that are named, by whose change the plan would be another."""

TRIGGERED = ("estimate_threshold", "probability_threshold", "periodic_inspection")
"""Options that repair once something has been read or found, on no fixed date."""

FAR = 20.0
"""Break-even costs beyond so many times the given cost, or below its inverse, are not told."""


def money(amount: float, currency: str) -> str:
    """Write an amount with three digits.

    Parameters
    ----------
    amount
        Amount in `currency`.
    currency
        Code of the currency.

    Returns
    -------
    The amount rounded to three digits, with the currency.

    Examples
    --------
    >>> money(1234567.0, "EUR"), money(-0.01234, "EUR")
    ('1,230,000 EUR', '−0.0123 EUR')
    """
    rounded = float(f"{amount:.3g}")
    text = f"{rounded:,.0f}" if abs(rounded) >= 100 else f"{rounded:.3g}"
    return f"{text} {currency}".replace("-", "−")


@dataclasses.dataclass(frozen=True, slots=True)
class TimeWording:
    """Writes spans and instants for people, with dates if the calendar is known.

    Parameters
    ----------
    unit
        Of times, as in the registration.
    since_ns
        Sensor time of the last reading [ns].
    seconds
        In one unit; None where it is not known.
    slow_unit
        Unit of slow time, as messages name it; None where none was given.
    ahead
        Whether a repair is ordered some time before it takes effect.
    """

    unit: str
    since_ns: int | None
    seconds: float | None
    slow_unit: str | None = None
    ahead: bool = False

    def span(self, time: float) -> str:
        """Describe a span of time.

        Returns
        -------
        The span with its unit.
        """
        word = UNITS[self.unit]
        return f"{time:.3g} {word}" if word else span_in_words(time, self.slow_unit)

    def moment(self, time: float) -> str:
        """Describe an instant, relative to now.

        Parameters
        ----------
        time
            Time from now, in the owner's unit.

        Returns
        -------
        The span, with the date if the calendar is known and a day or more is left.
        """
        said = self.span(time)
        if self.since_ns is None or self.seconds is None or self.seconds * time < 86400.0:
            return said
        at_s = self.since_ns / 1e9 + time * self.seconds
        if at_s > LAST_CLOCK_S:
            return said
        return f"{said} ({datetime.datetime.fromtimestamp(at_s, datetime.UTC):%Y-%m-%d})"


def option_words(option: Option, when: TimeWording) -> str:
    """Name an option with its parameters."""
    given: Mapping[str, float] = option.parameters
    share = f"{100 * given.get('damage', 0.0):.3g} %"
    repair = "order a repair" if when.ahead else "repair"
    words: dict[str, Callable[[], str]] = {
        "nothing": lambda: "run to failure",
        "age": lambda: f"repair at an age of {when.span(given['age'])} from now on",
        "fixed_interval": lambda: f"repair every {when.span(given['every'])}",
        "estimate_threshold": lambda: f"{repair} once the estimate reaches {share} of failure",
        "probability_threshold": lambda: (
            f"{repair} once the probability of a failure within {when.span(given['window'])} "
            f"reaches {probability_in_words(given['probability'])}"
        ),
        "periodic_inspection": lambda: (
            f"inspect every {when.span(given['every'])} and {repair} from {share} of failure on"
        ),
        "repair_now": lambda: (
            f"order the repair now, done in {when.moment(given['at'])}"
            if when.ahead
            else "repair now"
        ),
        "repair_at": lambda: (
            f"order the repair in {when.moment(given['order'])}, done in "
            f"{when.moment(given['at'])}"
            if when.ahead
            else f"repair in {when.moment(given['at'])}"
        ),
        "inspect_now": lambda: "inspect now and decide by what is found",
        "inspect_at": lambda: (
            f"inspect in {when.moment(given['at'])} and decide by what is found"
        ),
        "read_on": lambda: (
            f"take readings for {when.moment(given['at'])} and decide by what they show"
        ),
        "close": lambda: "close",
        "close_until_repair": lambda: (
            f"close until the repair, ordered now, is done in {when.moment(given['at'])}"
        ),
    }
    return words[option.name]()


def sentence_of(plan: Plan, currency: str, when: TimeWording) -> str:
    """Describe the best option, its time and reason, or that it cannot be decided."""
    ranking = plan.ranking
    if not ranking.is_known and ranking.other is not None:
        return _undecided(plan, currency, when)
    words, horizon = option_words(plan.best, when), when.moment(plan.futures.horizon)
    cost = money(float(plan.costs[ranking.best]), currency)
    said = f"{words[0].upper()}{words[1:]}{_due(plan, when)}: expected cost {cost} in {horizon}"
    if ranking.other is not None:
        other = option_words(plan.options[ranking.other], when)
        said += f"; the alternative “{other}” costs {money(ranking.difference, currency)} more"
    failing = probability_in_words(float(plan.failure_probability[-1]))
    return f"{said}. Without a repair it fails within that time with probability {failing}."


def _due(plan: Plan, when: TimeWording) -> str:
    """Describe the time of a repair that depends on later readings."""
    best, weights = plan.best, plan.futures.weights
    times = best.repair_time
    if (
        times is None
        or best.now == "repair"
        or best.name in ("repair_at", "fixed_interval", "age")
    ):
        return ""
    order = np.argsort(times)
    total = np.cumsum(weights[order])
    at = float(times[order][min(int(np.searchsorted(total, 0.5)), len(times) - 1)])
    if not np.isfinite(at):
        return ", probably not within the horizon"
    return f", expected {'to be done ' if when.ahead else ''}in {when.moment(at)}"


def last_order_sentence(plan: Plan, when: TimeWording) -> str:
    """State the last safe day to order a repair, with the limit that it is judged by."""
    last = plan.last_order
    chance = probability_in_words(last.probability)
    if last.limit is None:
        limit = "An order after it costs more, by the costs that are registered."
        none = f"no repair on a fixed date costs less than running to failure{_but(plan, when)}"
    else:
        limit = (
            f"The accepted probability is {probability_in_words(last.limit)}, from the last "
            "reading until a repair takes effect."
        )
        none = f"the accepted probability is {probability_in_words(last.limit)}"
    if last.order == math.inf:
        horizon = when.moment(plan.futures.horizon)
        return (
            f"No repair has to take effect within {horizon}: a failure by then has the "
            f"probability {chance}, and {none}."
        )
    if last.order < 0.0:
        return f"{_passed(plan, when)} {limit}"
    spread = ""
    if last.high > last.low and math.isfinite(last.high):
        early, late = (when.span(max(end, 0.0)) for end in (last.low, last.high))
        spread = f" (90 % interval: {early} to {late})" if early != late else ""
    done = f", to be done in {when.moment(last.effect)}" if when.ahead else ""
    act, acted = ("order a repair", "ordered") if when.ahead else ("repair", "done")
    return (
        f"Last safe day to {act}: in {when.moment(last.order)}{spread}{done}. If the repair is "
        f"{acted} on that day, a failure before it takes effect has the probability {chance}. "
        f"{limit}"
    )


def _but(plan: Plan, when: TimeWording) -> str:
    """Name the cheapest repair that waits for a trigger, where it beats running to failure."""
    ranked = [option.name for option in plan.options]
    until = ranked.index("nothing") if "nothing" in ranked else 0
    triggered = [option for option in plan.options[:until] if option.name in TRIGGERED]
    return f"; “{option_words(triggered[0], when)}” does" if triggered else ""


def _passed(plan: Plan, when: TimeWording) -> str:
    last = plan.last_order
    if math.isfinite(last.order):
        said = f"The last safe day to order a repair was {when.span(-last.order)} ago."
    else:
        said = "No time at which a repair can be done comes soon enough."
    if not math.isfinite(last.now_effect):
        return f"{said} Ordered now, it is not done in any window that is given."
    chance = probability_in_words(last.now_probability)
    return (
        f"{said} Ordered now, it is done in {when.moment(last.now_effect)}; a failure before "
        f"that has the probability {chance}."
    )


def _undecided(plan: Plan, currency: str, when: TimeWording) -> str:
    ranking = plan.ranking
    assert ranking.other is not None
    first = option_words(plan.best, when)
    second = option_words(plan.options[ranking.other], when)
    low, high = money(ranking.low, currency), money(ranking.high, currency)
    said = (
        f"Cannot decide between “{first}” and “{second}”: their expected costs differ by "
        f"{money(ranking.difference, currency)} (90 % interval: {low} to {high})."
    )
    advice = plan.advice
    if advice is None:
        return (
            f"{said} No inspection or reading on offer is worth its cost: either will do, "
            "until the costs are known better."
        )
    return f"{said} It would be decided by {worth_words(advice, currency, when)}."


def worth_words(worth: Worth, currency: str, when: TimeWording) -> str:
    """Name an observation, its time, and its value beyond its cost."""
    place = "now" if worth.at == 0.0 else f"within {when.moment(worth.at)}"
    if worth.net > 0:
        return f"{worth.observation.name} {place}, worth {money(worth.net, currency)} net"
    return f"{worth.observation.name} {place}, not worth its cost or its wait"


def changes_of(plan: Plan, currency: str, when: TimeWording) -> list[str]:
    """Describe the costs at which another plan would be best."""
    if plan.ranking.other is None:
        return []
    other = option_words(plan.options[plan.ranking.other], when)
    near = [one for one in plan.ranking.break_even if 1 / FAR < one.at / one.given < FAR]
    return [_change(one, other, currency) for one in near[:CHANGES_SHOWN]]


def _change(one: BreakEven, other: str, currency: str) -> str:
    side = "more" if one.at > one.given else "less"
    words = ITEM_WORDS[one.item]
    return (
        f"“{other}” is better if {words} costs {side} than {money(one.at, currency)} "
        f"(given: {money(one.given, currency)})."
    )

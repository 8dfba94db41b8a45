"""Draw figures 9.1 and 9.2: two and seven ageing nonlinear masses and their twins.

``python -m docs.figures.chapter_9`` writes the figures and, beside each, a CSV with the very
numbers that it shows.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from docs.figures import sheet
from docs.figures.sheet import Array, Figure, Line
from slowtime.dynamics.plant.parameter_names import Name
from slowtime.dynamics.stochastic import Springs, WhiteForce, examples, simulate
from slowtime.estimation.epochs import Constants, Watched, identify_epoch
from slowtime.evolution.predicted_response.ageing import learn_ageing

DAYS = np.linspace(0.0, 10_000.0, 41)
KNOWN = 31
FEW_DAYS = np.linspace(0.0, 10_000.0, 6)


def twin(
    told: Springs, white: WhiteForce, records: examples.Records, free: tuple[Name, ...]
) -> Watched:
    """Make the twin, which takes the structure for something else."""
    nodes = len(told.nodes)
    wide = {"stiffness": 0.3, "damping": 0.8, "effect": 0.15}
    return Watched(
        springs=told,
        free=free,
        log_sd=np.array([wide[name[0]] for name in free]),
        step_s=records.step_s,
        white=white,
        force_sd=np.full(nodes, records.force_sd),
        sensors=np.arange(nodes),
        reading_sd=records.reading_sd,
        start_sd=np.full(2 * nodes, 1e-3),
    )


def free_of(nodes: int) -> tuple[Name, ...]:
    """Stiffness and damping of every spring, and Duffing's constant."""
    springs = [f"k{i + 1}" for i in range(nodes)]
    both: list[Name] = [(what, name) for what in ("stiffness", "damping") for name in springs]
    return (*both, ("effect", 0, "k3_n_per_m3"))


def two_masses() -> list[Line]:
    """Stiffness by epoch, over slow time, and the response at the last epoch."""
    true, white = Springs.of(examples.two_masses()), examples.TWO_MASSES_WHITE
    values, rng = examples.aged(true, DAYS), np.random.default_rng(9)
    records = examples.record(true, values, white, rng)
    wrong = Springs.of(examples.two_masses(90.0))
    factors = np.array([1.05, 0.95, 0.75, 1.5, 1.0, 1.0, 1.0])
    wrong = dataclasses.replace(wrong, values=wrong.values * factors)
    one = twin(wrong, white, records, free_of(2))
    found = identify_epoch(one, records.readings[:, :KNOWN], records.forces[:, :KNOWN])
    ageing = learn_ageing(wrong, DAYS[:KNOWN], found)
    lo, hi = found.interval()
    drawn = []
    for i, panel in enumerate("ab"):
        name: Name = ("stiffness", f"k{i + 1}")
        past, ahead = ageing.past(name), ageing.future(name, DAYS[KNOWN:])
        drawn += [
            Line(panel, "actual", DAYS, values[:, i], colour=sheet.SOFT),
            Line(
                panel, "each epoch", DAYS[:KNOWN], found.value[:, i], lo[:, i], hi[:, i],
                sheet.TRUTH, points=True,
            ),
            Line(panel, "over slow time", DAYS[:KNOWN], past.value, past.lo, past.hi),
            Line(panel, "forecast", DAYS[KNOWN:], ahead.value, ahead.lo, ahead.hi, sheet.OTHER),
        ]  # fmt: skip
    times = np.arange(0.0, 5.001, 0.01)
    forces = np.zeros((len(times), 1, 2))
    forces[:, 0, :] = (examples.FORCE_N * np.sin(examples.FORCE_RAD_PER_S * times))[:, None]
    response = ageing.respond(float(DAYS[-1]), forces, 100.0, white, rng, paths=400)
    start = np.zeros((1, 4))
    actual = simulate(true, forces, 100.0, white, rng, values=values[-1:], start=start)
    return [
        *drawn,
        Line(
            "c", "twin, 95 %", times, response.mean[:, 1], response.lo[:, 1], response.hi[:, 1]
        ),
        Line("c", "actual", times, actual[:, 0, 1], colour=sheet.TRUTH),
    ]


def seven_masses() -> list[Line]:
    """Relative errors of all constants of seven masses with intervals; the two valleys."""
    true, white = Springs.of(examples.seven_masses()), examples.SEVEN_MASSES_WHITE
    values, rng = examples.aged(true, FEW_DAYS), np.random.default_rng(10)
    records = examples.record(true, values, white, rng)
    wrong = Springs.of(examples.seven_masses(90.0))
    start = wrong.values.copy()
    start[:14] = [2100, 1900, 1050, -1050, 950, 950, 475, *[15.0] * 7]
    wrong = dataclasses.replace(wrong, values=start)
    one = twin(wrong, white, records, free_of(7))
    found = identify_epoch(one, records.readings, records.forces)
    drawn = [
        _errors(panel, found, values[:, place], place)
        for panel, place in (("a", slice(0, 7)), ("b", slice(7, 14)))
    ]
    return [*drawn, *_valleys(true, white, rng)]


def _errors(panel: str, found: Constants, truth: Array, place: slice) -> Line:
    error = 100.0 * (np.exp(found.log_ratio[:, place]) * found.nominal[place] / truth - 1.0)
    half = 100.0 * 1.96 * found.log_sd[:, place]
    epochs, constants = error.shape
    number = (np.arange(constants) + 1.0)[None] + 0.1 * (np.arange(epochs)[:, None] - 2.5)
    x, y, d = number.ravel(), error.ravel(), half.ravel()
    return Line(panel, "error and 95 %", x, y, y - d, y + d, points=True)


def _valleys(true: Springs, white: WhiteForce, rng: np.random.Generator) -> list[Line]:
    times = np.arange(0.0, 5.001, 0.005)
    path = simulate(
        true, np.zeros((len(times), 1, 7)), 200.0, white, rng, start=np.zeros((4, 14))
    )
    colours = (sheet.OURS, sheet.OTHER, sheet.TRUTH, sheet.SOFT)
    return [
        Line("c", f"path {i + 1}", times, path[:, i, 3] - path[:, i, 2], colour=colours[i])
        for i in range(4)
    ]


def caption_two(drawn: Sequence[Line]) -> str:
    """Say what is shown, with the errors of this very draw."""
    errors = [
        sheet.rmse(drawn, panel, name, "actual")
        for panel in "ab"
        for name in ("each epoch", "over slow time", "forecast")
    ]
    return (
        "Figure 9.1. Two masses, the first on a Duffing spring, under a sine and white forces; "
        "stiffness and damping fade together. Stiffness, damping and Duffing's constant are "
        "estimated from five seconds an epoch, stiffness 5 %, damping 25 and 50 % off at the "
        "start. (a), (b) Stiffness of both springs with 95 % intervals; (c) the second mass at "
        "the last epoch, which the twin has not seen. Root mean square error in N/m by epoch, "
        "over slow time, forecast: "
        + "; ".join(", ".join(f"{e:.2f}" for e in errors[i : i + 3]) for i in (0, 3))
        + "."
    )


def caption_seven(drawn: Sequence[Line]) -> str:
    """Say what is shown."""
    points = [one for one in drawn if one.points]
    held = [
        (one.lo <= 0) & (one.hi >= 0)
        for one in points
        if one.lo is not None and one.hi is not None
    ]
    inside = np.mean(np.concatenate(held))
    return (
        "Figure 9.2. Seven masses, the fourth spring a Duffing–van der Pol oscillator: a "
        "negative stiffness, a cubic one, and a white force that grows with the displacement "
        "of its mass. (a) Relative errors of the seven stiffnesses at six epochs, (b) of the "
        f"seven dampings, with 95 % intervals, of which {100 * inside:.0f} % hold the truth. "
        "(c) Elongation of the fourth spring without known forces: chance chooses the valley."
    )


FIGURES = {
    "figure_9_1": Figure(
        two_masses,
        {
            "a": ("(a) first spring", "days", "stiffness, N/m"),
            "b": ("(b) second spring", "days", "stiffness, N/m"),
            "c": ("(c) response at day 10,000", "t, s", "displacement, m"),
        },
        caption_two,
    ),
    "figure_9_2": Figure(
        seven_masses,
        {
            "a": ("(a) stiffness", "spring", "error, %"),
            "b": ("(b) damping", "spring", "error, %"),
            "c": ("(c) two valleys", "t, s", "elongation, m"),
        },
        caption_seven,
    ),
}

if __name__ == "__main__":
    sheet.main(FIGURES)

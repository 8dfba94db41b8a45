import dataclasses
import itertools

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import fit_within_tolerances
from slowtime.discrepancy.localization import latent_force, likeliest_places, likely_pairs
from slowtime.discrepancy.localization.pair_ranking import PairScreening
from slowtime.discrepancy.localization.ranking import linearise
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Spring, Tolerance
from slowtime.dynamics.effects import Place
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered

SIZE, RATE_HZ, SAMPLES = 6, 40.0, 800


@pytest.fixture(scope="module")
def model():
    names = [f"m{i + 1}" for i in range(SIZE)]
    return dataclasses.replace(
        chain([1.0] * SIZE, [900.0] * SIZE + [0.0], dampings_n_s_per_m=[0.6] * SIZE + [0.0]),
        inputs=(Input(channel="u", kind="force", node=names[-1], unit="N"),),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=names[i], unit="m/s^2")
            for i in (0, 2, 3, 5)
        ),
        tolerance=Tolerance(stiffness=0.03, damping=0.2, mass=0.0),
    )


def records(model, links):
    """Two records of a model that has more links than it states."""
    rng = np.random.default_rng(5)
    true = Plant.of(dataclasses.replace(model, elements=(*model.elements, *links)))
    found = []
    for _ in range(2):
        inputs = rng.normal(0.0, 1.0, (SAMPLES, 1))
        outputs = true.simulate(true.values, inputs, RATE_HZ)
        outputs += 0.01 * outputs.std(axis=0) * rng.normal(size=outputs.shape)
        found.append(Trial(inputs=inputs, outputs=outputs, rate_hz=RATE_HZ))
    return tuple(found)


def link(between, stiffness=0.0, damping=0.0):
    return Spring(
        id="-".join(between), between=between, stiffness_n_per_m=stiffness,
        damping_n_s_per_m=damping,
    )  # fmt: skip


def unjoined(model):
    joined = {frozenset(e.between) for e in model.elements}
    points = ["base", *(node.id for node in model.nodes)]
    return [p for p in itertools.combinations(points, 2) if frozenset(p) not in joined]


def test_gains_are_those_of_dense_least_squares(model):
    trials = records(model, [link(("m2", "m5"), stiffness=90.0)])
    fit = refit(Plant.of(model), trials)
    solver, _, _ = linearise(fit, trials)
    pairs = unjoined(model)
    gains = PairScreening(solver, pairs).gains()
    beside = PairScreening(solver, pairs).gains(pairs.index(("m2", "m5")))
    for number in (0, 4, pairs.index(("m2", "m5")), len(pairs) - 1):
        assert gains[number] == pytest.approx(dense_gain(solver, pairs[number]), rel=1e-5)
        both = dense_gain(solver, ("m2", "m5"), pairs[number])
        alone = dense_gain(solver, ("m2", "m5"))
        assert beside[number] == pytest.approx(both - alone, rel=1e-4, abs=1e-4)


def dense_gain(solver, *pairs):
    """By a least-squares solution over all lines, priors as rows of their own."""
    known, count = solver.known, len(solver.trials)
    constants = len(known.sd)
    rows, right = (
        [np.diag(1 / known.sd) / np.sqrt(2)],
        [-known.reference_change / known.sd / np.sqrt(2)],
    )
    states = solver.white[0].columns.shape[2] - 1 - constants
    width = constants + count * states + 3 * len(pairs)
    rows[0] = np.pad(rows[0], ((0, 0), (0, width - constants)))
    for i, (trial, tuned, white) in enumerate(
        zip(solver.trials, solver.tuned, solver.white, strict=True)
    ):
        columns = white.columns.reshape(-1, white.columns.shape[2])
        row = np.zeros((len(columns), width), complex)
        row[:, :constants] = columns[:, :constants]
        first = constants + i * states
        row[:, first : first + states] = columns[:, constants:-1]
        for j, pair in enumerate(pairs):
            along = np.array(
                [(n == pair[1]) * 1.0 - (n == pair[0]) for n in solver.linear.structure.names]
            )
            heard = tuned.sensed @ along / np.sqrt(trial.noise)
            for order in range(3):
                added = heard * (trial.motion[order] @ along)[:, None]
                row[:, constants + count * states + 3 * j + order] = added.ravel()
        rows += [row.real, row.imag]
        right += [columns[:, -1].real, columns[:, -1].imag]
    matrix, target = np.vstack(rows), np.concatenate(right)

    def left(kept):
        size = np.linalg.norm(matrix[:, :kept], axis=0)
        found = np.linalg.lstsq(matrix[:, :kept] / size, target, rcond=1e-12)[0]
        return np.sum((target - matrix[:, :kept] / size @ found) ** 2)

    return left(width - 3 * len(pairs)) - left(width)


@pytest.mark.parametrize(
    "links",
    [
        [link(("m2", "m5"), stiffness=300.0)],
        [link(("base", "m4"), damping=4.0)],
    ],
)
def test_what_is_missing_is_among_the_likeliest_few(model, links):
    trials = records(model, links)
    fit = fit_within_tolerances(Plant.of(model), trials)
    assert fit is not None
    chosen = likely_pairs(fit, trials, unjoined(model), 4)
    assert len(chosen) == 4
    assert {one.between for one in links} <= set(chosen)


def test_places_between_which_a_link_is_missing_are_the_likeliest_by_one_linearisation(model):
    trials = records(model, [link(("base", "m3"), stiffness=20.0)])
    fit = refit(Plant.of(model), trials)
    assert likeliest_places(fit, trials, 1) == [Place("node", "m3")]
    few = likeliest_places(fit, trials, 4)
    assert len(set(few)) == 4
    assert few[0] == Place("node", "m3")


def test_products_with_unit_forces_are_the_same_from_a_table_and_are_counted(
    model, monkeypatch
):
    trials = records(model, [link(("base", "m3"), stiffness=20.0)])
    fit = refit(Plant.of(model), trials)
    found = []
    for numbers in (latent_force.MAX_TABLE, 0):
        monkeypatch.setattr(latent_force, "MAX_TABLE", numbers)
        solver, _, _ = linearise(fit, trials)
        assert bool(solver.tables) == bool(numbers)
        with metered() as meter:
            told = [solver.iterate(s, rounds=2).likelihood for s in solver.linear.sources()]
        assert meter.spent > 0
        found.append((told, meter.spent))
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-9)
    assert found[0][1] == found[1][1]

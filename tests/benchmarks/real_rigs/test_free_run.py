"""Free runs of the other tools, by closed form and another integrator."""

import json
import re

import numpy as np
import pytest
import scipy.integrate

from benchmarks.real_rigs.peers import known_law
from benchmarks.real_rigs.peers.free_run import FreeRuns
from benchmarks.real_rigs.peers.integrator import accelerate
from benchmarks.real_rigs.peers.laws import LIBRARIES, NAMES, PeerLaw, States, terms_at
from benchmarks.real_rigs.peers.task import folds, head_of, read_rig, read_task
from benchmarks.real_rigs.pieces import Piece, Pieces
from benchmarks.real_rigs.sets import MODELS, SETS

RATE = 50.0
DISC = read_rig(MODELS / "torsion_disc.yaml")
SLIP = np.array([0.02])


def law(**coefficients):
    values = np.zeros((1, len(NAMES), 1))
    for name, value in coefficients.items():
        values[0, NAMES.index({"friction": "sign(v{0})", "cubic": "e{0}^3"}[name]), 0] = value
    return PeerLaw(values, 1.0, SLIP)


def piece_of(angle):
    return Piece(RATE, {"angle": angle})


def told(friction=0.0, cubic=0.0, start=(3.0, 0.0), seconds=6.0):
    def rates(_, y):
        slip = friction * np.tanh(y[1] / SLIP[0])
        return [y[1], -20.0 * y[0] - 0.1 * y[1] - cubic * y[0] ** 3 - slip]

    times = np.arange(int(seconds * RATE)) / RATE
    solved = scipy.integrate.solve_ivp(
        rates, (0, seconds), start, "LSODA", times, rtol=1e-9, atol=1e-10
    )
    return solved.y[0]


@pytest.mark.parametrize(
    "unknown",
    [
        pytest.param({"cubic": 0.5}, marks=pytest.mark.long),
        {"friction": 1.0},
        pytest.param({}, marks=pytest.mark.long),
    ],
)
def test_laws_run_as_another_integrator_runs_them_from_a_state_that_is_found(unknown):
    angle = told(**unknown)
    runs = FreeRuns(DISC, piece_of(angle), np.zeros((len(angle), 1)), angle[:, None])
    found, other = runs.from_best_states(
        [law(**unknown), law(friction=4.0)], np.array([[2.6, 1.0], [2.6, 1.0]])
    )
    assert np.abs(found[:, 0] - angle).max() < 0.02 * np.abs(angle).max()
    assert np.abs(other[:, 0] - angle).max() > 0.2


def test_an_input_drives_a_run():
    rig = read_rig(MODELS / "torsion_disc_input.yaml")
    times = np.arange(400) / RATE
    torque = 3.0 * np.sin(2.0 * times)

    def rates(t, y):
        return [y[1], -20.0 * y[0] - 0.1 * y[1] + 3.0 * np.sin(2.0 * t)]

    solved = scipy.integrate.solve_ivp(rates, (0, 8), [0.0, 0.0], "LSODA", times, rtol=1e-9)
    angle = solved.y[0][:, None]
    piece = Piece(RATE, {"angle": angle[:, 0], "torque": torque})
    runs = FreeRuns(rig, piece, torque[:, None] @ rig.push.T, angle)
    (found,) = runs.from_best_states([law()], np.zeros((1, 2)))
    np.testing.assert_allclose(found, angle, atol=2e-3 * np.abs(angle).max())


def test_rigs_have_the_natural_frequencies_of_the_model():
    frame = read_rig(MODELS / "three_storey.yaml")
    hertz = np.sort(np.abs(np.linalg.eigvals(frame.rates())))[::2] / (2 * np.pi)
    # Of three equal storeys: 2 sqrt(k/m) sin((2j - 1) pi / 14).
    known = np.sqrt(52500 / 5.201) / np.pi * np.sin(np.array([1, 3, 5]) * np.pi / 14)
    np.testing.assert_allclose(hertz, known, rtol=1e-3)


def test_a_shaken_rig_measures_the_motion_of_its_base():
    rig = read_rig(MODELS / "mount.yaml")
    state, feed = rig.output_rows()
    np.testing.assert_allclose(state, [[-165000 / 80, -70 / 80]])
    # Relative acceleration -rail, and the rail on top: nothing passes at once.
    np.testing.assert_allclose(feed, [[0.0]])


def test_the_compiled_acceleration_is_that_of_the_terms_of_the_regression():
    """Two elements, every term: the same force, added up in two ways."""
    rng = np.random.default_rng(1)
    rig = read_rig(MODELS / "three_storey.yaml")
    slip = np.array([0.1, 0.2, 0.3])
    shape = (len(rig.to), len(NAMES), rig.size)
    mixed = PeerLaw(rng.standard_normal(shape), 0.7, slip, 1.3)
    x, v, force = rng.standard_normal((3, rig.size))
    found = np.empty(rig.size)
    numbers = (mixed.coefficients, mixed.nominal, mixed.gain, mixed.slip)
    accelerate(numbers, (rig.to, rig.stiffness, rig.damping, rig.masses), force, x, v, found)
    taken = mixed.force(States(x[None], v[None], v[None]), rig)[0]
    np.testing.assert_allclose(found, (1.3 * force - taken) / rig.masses, rtol=1e-10)


def test_a_run_that_diverges_ends_and_is_no_number():
    angle = told()
    runs = FreeRuns(DISC, piece_of(angle), np.zeros((len(angle), 1)), angle[:, None])
    run = runs.run_laws([law(cubic=-50.0)], np.array([[3.0, 0.0]]), len(angle))[0, :, 0]
    assert run[0] == 3.0
    assert np.isnan(run[-1])


def test_terms_are_what_their_names_say():
    e, v = np.array([2.0]), np.array([-3.0])
    values = dict(zip(NAMES, terms_at(e, v, SLIP)[0], strict=True))
    assert values["|v{0}|v{0}"] == -9.0
    assert values["e{0}^2*v{0}"] == -12.0
    assert values["sign(v{0})"] == -1.0
    assert values["sin(e{0})"] == np.sin(2.0)
    assert all(terms <= set(NAMES) for terms in LIBRARIES.values())


def arguments(folder, pieces, model="torsion_disc.yaml", law=()):
    """Write a set, and return what a tool is given."""
    pieces.write(folder)
    (folder / "model.yaml").write_text((MODELS / model).read_text())
    (folder / "facts.json").write_text(json.dumps({"imposed": False, "law": law}))
    learn = [str(folder / f"learn_{i + 1}.npz") for i in range(len(pieces.learn))]
    judge = ["--holdout", str(folder / "judge_1.npz"), "--out", str(folder / "out")]
    return [str(folder / "model.yaml"), *learn, *judge]


def test_settings_are_chosen_on_what_was_left_out(tmp_path):
    for sizes in ((2.0,), (2.0, 3.0)):
        pieces = tuple(piece_of(told(start=(size, 0.0))) for size in sizes)
        task = read_task(arguments(tmp_path, Pieces(pieces, pieces[:1])))
        split = folds(task, 100)
        assert len(split) == len(sizes)
        for taught, judged in split:
            assert max(len(piece) for piece in judged) <= 100
            assert not {id(piece) for piece in taught} & {id(piece) for piece in judged}
    assert head_of(1000) == 200
    assert head_of(50) == 50


def test_the_known_law_is_fitted_to_its_true_numbers(tmp_path):
    rng = np.random.default_rng(1)
    truth = {"friction": 1.5, "cubic": 0.4}
    learn = tuple(
        piece_of(told(**truth, start=(size, 0.0)) + 0.01 * rng.standard_normal(300))
        for size in (2.5, 3.5)
    )
    held = piece_of(told(**truth, start=(3.0, 1.0)))
    law = ("e{0}", "v{0}", "e{0}^3", "sign(v{0})", "offset")
    known_law.main(arguments(tmp_path, Pieces(learn, (held,)), law=law))
    answer = json.loads((tmp_path / "out/answer.json").read_text())["readable"]
    numbers = [float(n) for n in re.findall(r"[-+]\d[\d.e-]*(?= )", answer + " ")]
    np.testing.assert_allclose(numbers, [20.0, 0.1, 0.4, 1.5, 0.0], rtol=0.05, atol=0.02)
    with np.load(tmp_path / "out/holdout.npz") as runs:
        left = np.std(runs["augmented"] - runs["measured"]) / np.std(runs["measured"])
    assert left < 0.02


def test_a_term_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match=r"There is no term v\. Give some of 1, e\{0\}"):
        known_law.shape_of(("v",))


@pytest.mark.parametrize("one", SETS, ids=lambda one: one.name)
def test_known_laws_are_of_one_element_and_of_terms_that_exist(one):
    if one.law:
        assert known_law.shape_of(one.law).terms
        assert read_rig(one.model).size == 1

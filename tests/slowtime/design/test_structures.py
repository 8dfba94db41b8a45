"""Responses beside other roads, and dampers beside closed forms."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.linalg
from scipy.signal import cont2discrete, lfilter, ss2tf

from slowtime.design import (
    AddedStructure,
    Addition,
    DesignProblem,
    HarmonicLoad,
    NoiseLoad,
    RecordedLoad,
    Response,
    Responses,
    Variable,
    optimise,
    optimise_emulated,
)
from slowtime.design.stationary import state_matrices, stationary_covariance
from slowtime.dynamics.description import Description, Node, Spring, assemble
from slowtime.dynamics.random_vibration import kanai_tajimi
from slowtime.dynamics.simulation import simulate_structure
from slowtime.dynamics.transfer import frequency_response
from slowtime.reliability import Problem, marginal, unknowns
from tests.slowtime.dynamics.random_vibration import response_covariance

FIRST, SECOND = (
    Spring(id="s1", between=("base", "floor1"), stiffness_n_per_m=1.2e6, damping_n_s_per_m=2e3),
    Spring(id="s2", between=("floor1", "floor2"), stiffness_n_per_m=9e5, damping_n_s_per_m=1e3),
)
FRAME = Description(
    name="frame",
    nodes=tuple(Node(id=f"floor{k}", mass_kg=m) for k, m in ((1, 900.0), (2, 800.0))),
    elements=(FIRST, SECOND),
)
NOTHING = np.zeros((1, 0))


def respond(load, *wanted, description=FRAME, chances=NOTHING):
    rows = Responses(AddedStructure(description, ()), load, wanted)
    return rows(NOTHING, NOTHING, np.ones(1), chances)[0]


@pytest.mark.parametrize("seed", range(8))
def test_covariances_are_those_of_lyapunov(seed):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 6))
    root = rng.standard_normal((size, size))
    stiffness = (root @ root.T + np.eye(size)) * 10.0 ** rng.uniform(0, 6)
    mass = np.diag(10.0 ** rng.uniform(0, 3, size))
    damping = 10.0 ** rng.uniform(-4, 0) * stiffness + 0.01 * mass
    if seed == 0:  # critically damped: the state matrix has no full set of eigenvectors
        mass, stiffness, damping = np.eye(1), np.eye(1), 2.0 * np.eye(1)
    a = state_matrices(mass[None], damping[None], stiffness[None])
    drive = rng.standard_normal((a.shape[1], 1))
    noise = drive @ drive.T
    found = stationary_covariance(a, noise[None])[0]
    exact = scipy.linalg.solve_continuous_lyapunov(a[0], -noise)
    np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-9 * np.abs(exact).max())


def test_a_motion_without_damping_is_refused():
    frame = dataclasses.replace(
        FRAME,
        elements=tuple(dataclasses.replace(e, damping_n_s_per_m=0.0) for e in (FIRST, SECOND)),
    )
    with pytest.raises(ValueError, match="Give every mode damping"):
        respond(NoiseLoad(psd=1.0), Response(quantity="displacement"), description=frame)


def test_noise_of_the_ground_is_as_the_structure_and_its_filter_say():
    ground = kanai_tajimi(2.5, 0.6)
    structure = assemble(FRAME)
    mass = structure.mass.sum(axis=0)
    reference = response_covariance(structure, 0.3 * np.outer(mass, mass), shaping=ground)
    drift = Response(quantity="displacement", between=("floor1", "floor2"))
    found = respond(NoiseLoad(psd=0.3, shaping=ground), drift)[0]
    way = np.array([-1.0, 1.0])
    assert found == pytest.approx(math.sqrt(way @ reference.displacement @ way), rel=1e-6)


def test_the_peak_of_noise_is_near_that_of_simulations_and_on_the_safe_side():
    """Crossings of a lightly damped response come in clumps, which makes peaks smaller."""
    shaping = kanai_tajimi(2.5, 0.6)
    duration, rate, count = 30.0, 100.0, 150
    rng = np.random.default_rng(2)
    system = cont2discrete(
        (shaping.state_matrix, shaping.input_vector[:, None],
         shaping.output_vector[None], np.zeros((1, 1))), 1 / rate,
    )  # fmt: skip
    above, below = ss2tf(*system[:4])
    structure = assemble(FRAME)
    settled = round(20 * rate)
    white = rng.standard_normal((count, settled + round(duration * rate)))
    ground = lfilter(above[0], below, white * math.sqrt(0.3 * rate / 2), axis=1)
    peaks = []
    for one in ground:
        moved, _, _ = simulate_structure(structure, structure.base_force(one), rate)
        peaks.append(np.abs(moved[settled:, 0]).max())
    floor = Response(quantity="displacement", between=("base", "floor1"), statistic="peak",
                     duration_s=duration)  # fmt: skip
    mean = dataclasses.replace(floor, statistic="mean_peak")
    load = NoiseLoad(psd=0.3, shaping=shaping)
    for chance in (0.5, 0.9):
        told = respond(load, floor, chances=np.array([[chance]]))[0]
        assert 0.97 < told / np.quantile(peaks, chance) < 1.25
    assert 0.97 < respond(load, mean)[0] / np.mean(peaks) < 1.25


def test_a_steady_vibration_has_the_amplitude_of_the_transfer_function():
    hz = 4.0
    accelerated = Response(quantity="acceleration", between=("base", "floor2"))
    moved = Response(quantity="displacement", between=("base", "floor2"), statistic="peak")
    load = HarmonicLoad(amplitude=50.0, frequency_hz=hz, node="floor1")
    found = respond(load, accelerated, moved)
    omega = np.array([2 * np.pi * hz])
    response = frequency_response(assemble(FRAME), omega, "displacement")[0, 1, 0]
    assert found[1] == pytest.approx(50.0 * abs(response), rel=1e-9)
    assert found[0] == pytest.approx(
        50.0 * omega[0] ** 2 * abs(response) / math.sqrt(2), rel=1e-9
    )


def test_a_recorded_load_moves_it_as_the_simulation_does():
    rng = np.random.default_rng(3)
    samples = np.cumsum(rng.standard_normal(2000)) * 0.02
    structure = assemble(FRAME)
    force = np.zeros((2000, 2))
    force[:, 1] = samples
    moved, speed, _ = simulate_structure(structure, force, 200.0, hold="first")
    found = respond(
        RecordedLoad(samples=samples, rate_hz=200.0, node="floor2"),
        Response(quantity="displacement", between=("base", "floor2"), statistic="peak"),
        Response(quantity="force", element="s1", statistic="peak"),
    )
    assert found[0] == pytest.approx(np.abs(moved[:, 1]).max(), rel=1e-6)
    inner = 1.2e6 * moved[:, 0] + 2e3 * speed[:, 0]
    assert found[1] == pytest.approx(np.abs(inner).max(), rel=1e-6)


def test_a_tuned_mass_damper_is_tuned_as_the_closed_form_says():
    """White force on an undamped mass (Warburton 1982)."""
    mass, ratio, hz = 1000.0, 0.05, 2.0
    stiffness = mass * (2 * np.pi * hz) ** 2
    tower = Description(
        name="tower",
        nodes=(Node(id="top", mass_kg=mass), Node(id="tmd", mass_kg=ratio * mass)),
        elements=(
            Spring(id="k", between=("base", "top"), stiffness_n_per_m=stiffness),
            Spring(id="link", between=("top", "tmd")),
        ),
    )
    added = AddedStructure(
        tower,
        [Addition(part=part, between=("top", "tmd")) for part in ("stiffness", "damping")],
    )
    rows = Responses(
        added, NoiseLoad(psd=1.0, node="top"),
        [Response(quantity="displacement", between=("base", "top"))],
    )  # fmt: skip
    k = ratio * stiffness
    c = 2 * ratio * mass * 2 * np.pi * hz
    found = optimise(
        DesignProblem(
            {"k": Variable(lower=0.3 * k, upper=2 * k), "c": Variable(lower=0.01 * c, upper=c)},
            Problem(unknowns(1), lambda x: x[:, 0]),
            lambda d, x: rows(d, np.zeros((len(d), 0)), np.ones(len(d)),
                              np.zeros((len(d), 0)))[:, 0],
        )
    )  # fmt: skip
    tuned, damper = found.best.variables
    tuning = math.sqrt(1 + ratio / 2) / (1 + ratio)
    damping = math.sqrt(ratio * (1 + 0.75 * ratio) / (4 * (1 + ratio) * (1 + ratio / 2)))
    assert math.sqrt(tuned / k) == pytest.approx(tuning, rel=1e-4)
    assert damper / (2 * math.sqrt(tuned * ratio * mass)) == pytest.approx(damping, rel=1e-3)


def test_a_design_on_surrogates_is_the_design_itself():
    added = AddedStructure(FRAME, [Addition(part="damping", between=("base", "floor1"))],
                           ["s1.stiffness"])  # fmt: skip
    rows = Responses(
        added, HarmonicLoad(amplitude=0.5, frequency_hz=3.6),
        [Response(quantity="displacement", between=("base", "floor1"), statistic="peak")],
    )  # fmt: skip
    inputs = Problem({"s": marginal("lognormal", mean=1.0, sd=0.1)}, lambda x: x[:, 0])

    def responses(d, x):
        return rows(d, x, np.ones(len(d)), np.zeros((len(d), 0)))

    def assemble_problem(run):
        return DesignProblem(
            {"damper": Variable(lower=0.0, upper=2e4)},
            inputs,
            lambda d, x: d[:, 0] / 1e4 + run(d, x)[:, 0] / 0.01,
        )

    direct = optimise(assemble_problem(responses))
    found = optimise_emulated(assemble_problem, responses, 150)
    assert found.calls <= 150
    assert found.best.mean == pytest.approx(direct.best.mean, rel=0.01)


def test_scatter_and_additions_change_the_matrices_they_name():
    added = AddedStructure(
        FRAME, [Addition(part="mass", between=("floor2",))], ["s2.stiffness", "floor1.mass"]
    )
    found = added.matrices(np.array([[50.0]]), np.array([[0.9, 1.1]]))
    built = dataclasses.replace(
        FRAME,
        nodes=(Node(id="floor1", mass_kg=990.0), Node(id="floor2", mass_kg=850.0)),
        elements=(FIRST, dataclasses.replace(SECOND, stiffness_n_per_m=0.81e6)),
    )
    reference = assemble(built)
    np.testing.assert_allclose(found["mass"][0], reference.mass)
    np.testing.assert_allclose(found["stiffness"][0], reference.stiffness)
    assert added.described(np.array([50.0])).nodes[1].mass_kg == 850.0


@pytest.mark.parametrize(
    ("work", "text"),
    [
        (lambda: AddedStructure(FRAME, [Addition(part="mass", between=("roof",))]), "one node"),
        (lambda: AddedStructure(FRAME, (), ["s9.stiffness"]), "no such part"),
        (lambda: respond(NoiseLoad(psd=1.0),
                         Response(quantity="force", element="s7")), "Springs: s1, s2"),
        (lambda: respond(NoiseLoad(psd=1.0, node="floor1"),
                         Response(quantity="acceleration", between=("base", "floor1"))),
         "has no end"),
        (lambda: respond(NoiseLoad(psd=1.0), Response(quantity="displacement",
                                                      statistic="peak")), "duration_s"),
    ],
)  # fmt: skip
def test_what_the_model_does_not_have_is_named(work, text):
    with pytest.raises(ValueError, match=text):
        work()

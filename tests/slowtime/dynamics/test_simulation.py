import numpy as np
import pytest
import scipy.signal as sps
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from slowtime.dynamics import simulation
from slowtime.dynamics.builders import beam, chain
from slowtime.dynamics.closed_form_motion import free_motion, step_motion
from slowtime.dynamics.description import assemble
from slowtime.dynamics.simulation import (
    ambient_structure,
    force_density,
    simulate_structure,
)
from slowtime.dynamics.structure import Structure, state_matrix
from slowtime.dynamics.transfer import frequency_response

RATE = 40.0


def forces(structure, count=60):
    return np.random.default_rng(8).standard_normal((count, structure.dofs))


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize(
    "name", ["example 3.5", "random dampers", "partly overdamped", "critical"]
)
def test_stepping_is_the_integral_of_the_equation_of_motion(family, name, hold):
    structure = family[name]()
    force, dofs = forces(structure, 25), structure.dofs
    a, inverse = state_matrix(structure), np.linalg.inv(structure.mass)

    def motion(t, x, k):
        u = (t * RATE - k) if hold == "first" else 0.0
        f = force[k] * (1 - u) + (force[k + 1] * u if u else 0.0)
        return a @ x + np.concatenate([np.zeros(dofs), inverse @ f])

    state = np.linspace(-0.1, 0.2, 2 * dofs)
    truth = [state]
    for k in range(len(force) - 1):
        span = (k / RATE, (k + 1) / RATE)
        state = solve_ivp(
            motion, span, state, args=(k,), rtol=1e-11, atol=1e-13, method="DOP853"
        ).y[:, -1]
        truth.append(state)
    q, v, acceleration = simulate_structure(
        structure, force, RATE, truth[0][:dofs], truth[0][dofs:], hold=hold
    )
    np.testing.assert_allclose(np.c_[q, v], truth, atol=1e-8)
    balance = acceleration @ structure.mass + v @ structure.damping + q @ structure.stiffness
    np.testing.assert_allclose(balance, force, atol=1e-9)


def test_without_force_it_is_free_motion(any_structure):
    q0, v0 = np.random.default_rng(9).standard_normal((2, any_structure.dofs))
    q, v, _ = simulate_structure(any_structure, 0 * forces(any_structure), RATE, q0, v0)
    truth = free_motion(any_structure, np.arange(60) / RATE, q0, v0)
    np.testing.assert_allclose(q, truth[0], atol=1e-9 * np.abs(truth[0]).max())
    np.testing.assert_allclose(v, truth[1], atol=1e-9 * np.abs(truth[1]).max())


def test_under_a_constant_force_it_is_the_step_response(family):
    structure = family["beam"]()
    force = np.tile(np.linspace(-1, 1, structure.dofs), (60, 1))
    for hold in ("zero", "first"):
        q, _, _ = simulate_structure(structure, force, RATE, hold=hold)
        truth, _ = step_motion(structure, np.arange(60) / RATE, force[0])
        np.testing.assert_allclose(q, truth, atol=1e-11)


@pytest.mark.parametrize("name", ["random dampers", "drift, odd dampers"])
@given(cut=st.integers(1, 58), chunk=st.integers(1, 70))
@settings(max_examples=15, deadline=None)
def test_a_run_can_be_cut_anywhere_and_continued(family, name, cut, chunk):
    structure = family[name]()
    force = forces(structure)
    with pytest.MonkeyPatch.context() as patch:
        whole = simulate_structure(structure, force, RATE, hold="first")
        patch.setattr(simulation, "CHUNK", chunk)
        first = simulate_structure(structure, force[: cut + 1], RATE, hold="first")
        second = simulate_structure(
            structure, force[cut:], RATE, first[0][-1], first[1][-1], hold="first"
        )
    for part, other, all_of_it in zip(first, second, whole, strict=True):
        np.testing.assert_allclose(
            np.concatenate([part[:-1], other]), all_of_it, atol=1e-10 * np.abs(all_of_it).max()
        )


def test_a_long_run_of_light_damping_keeps_its_digits():
    structure = assemble(chain([1.0] * 3, [1e4] * 4, rayleigh=(0.0, 1e-6)))
    q0 = np.array([1.0, -0.5, 0.2])
    q, _, _ = simulate_structure(structure, np.zeros((200_000, 3)), 1000.0, q0, 0 * q0)
    truth, _ = free_motion(structure, np.array([199.999]), q0, 0 * q0)
    np.testing.assert_allclose(q[-1], truth[0], atol=1e-9)


def test_no_force_no_samples(family):
    structure = family["example 3.5"]()
    assert all(len(part) == 0 for part in simulate_structure(structure, np.zeros((0, 3)), 5.0))


@pytest.mark.parametrize("supports", ["cantilever", "simply supported"])
def test_a_base_that_moves_is_a_structure_that_is_carried(supports):
    """Motion relative to the base against a base of very great mass that is really pushed."""
    rate, push = 200.0, np.random.default_rng(1).standard_normal(80)
    light = assemble(beam(1.0, 10.0, 1.0, elements=3, supports=supports, damping_s=1e-3))
    q, _, _ = simulate_structure(light, light.base_force(push), rate)
    # The same beam from its own full matrices, free in space, with the base as one more mass.
    free = assemble(beam(1.0, 10.0, 1.0, elements=3, supports="free", damping_s=1e-3))
    held = [name for name in free.names if name not in light.names]
    if supports == "cantilever":
        held = ["n0", "n0.rotation"]
    heavy = 1e7
    to = np.zeros((free.dofs, light.dofs + 1))
    for row, name in enumerate(free.names):
        if name in light.names:
            to[row, light.names.index(name)] = 1.0
        elif not name.endswith("rotation"):
            to[row, -1] = 1.0
    assert held
    mass = to.T @ free.mass @ to
    mass[-1, -1] += heavy
    dofs = light.dofs + 1
    whole = Structure(
        mass=mass, damping=to.T @ free.damping @ to, stiffness=to.T @ free.stiffness @ to
    )
    force = np.zeros((80, dofs))
    force[:, -1] = heavy * push
    absolute, _, _ = simulate_structure(whole, force, rate)
    translations = np.array([not name.endswith("rotation") for name in light.names])
    relative = absolute[:, :-1] - absolute[:, -1:] * translations
    np.testing.assert_allclose(q, relative, atol=2e-6 * np.abs(q).max())


def test_the_ambient_record_has_the_density_the_theory_says(family):
    structure, rate = family["random dampers"](), 60.0
    psd = np.array([1.0, 0.0, 2.0, 0.5, 0.0, 1.0])
    rng = np.random.default_rng(4)
    records = np.array(
        [
            ambient_structure(structure, 1024, rate, rng, force_psd=psd, channels=["m6", "m2"])
            for _ in range(60)
        ]
    )
    f, density = sps.csd(
        records[:, :, [0, 0, 1]].swapaxes(1, 2).reshape(60, 3, -1),
        records[:, :, [0, 1, 1]].swapaxes(1, 2).reshape(60, 3, -1),
        rate,
        nperseg=1024,
        window="hann",
        detrend=False,
    )
    h = frequency_response(structure, 2 * np.pi * f, "acceleration")[:, [5, 1]]
    truth = h @ np.diag(psd) @ h.conj().swapaxes(1, 2)
    for low, high in ((1.0, 5.0), (5.0, 9.0), (9.0, 29.0)):
        inside = (f >= low) & (f < high)
        found = density.mean(axis=0)[:, inside].sum(axis=1)
        expected = truth[inside].sum(axis=0)
        level = np.sqrt(expected[0, 0].real * expected[1, 1].real)
        np.testing.assert_allclose(found[0], expected[0, 0], rtol=0.08)
        np.testing.assert_allclose(found[2], expected[1, 1], rtol=0.08)
        # scipy conjugates the first channel, H S H^H the second.
        assert abs(found[1].conj() - expected[0, 1]) < 0.08 * level


@pytest.mark.long
def test_the_line_at_half_the_sampling_rate_has_half_the_power_of_its_neighbours():
    """Seen where the record is so short, and the density so steep, that it is most of all."""
    one = np.ones((1, 1))
    structure = Structure(mass=one, damping=56.0 * one, stiffness=1600.0 * one)
    rng = np.random.default_rng(1)
    power = np.mean([ambient_structure(structure, 15, 1.0, rng) ** 2 for _ in range(3000)])
    f = np.arange(1, 9) / 16
    density = np.abs(frequency_response(structure, 2 * np.pi * f, "acceleration")[:, 0, 0]) ** 2
    weight = np.where(f == 0.5, 0.5, 1.0) / 16
    assert power == pytest.approx(density @ weight, rel=0.05)


def test_forces_that_go_together_move_only_what_they_push(family):
    structure = family["two alike"]()
    together = np.ones((2, 2))
    record = ambient_structure(
        structure, 500, 20.0, np.random.default_rng(0), force_psd=together
    )
    np.testing.assert_allclose(record[:, 0], record[:, 1], atol=1e-10)
    alone = ambient_structure(
        structure, 500, 20.0, np.random.default_rng(0), force_psd=np.array([1.0, 0.0])
    )
    assert np.abs(alone[:, 1]).max() < 1e-12 < np.abs(alone[:, 0]).max()


def test_the_same_seed_makes_the_same_record_and_a_channel_does_not_depend_on_the_others(
    family,
):
    structure = family["random dampers"]()
    whole, part = (
        ambient_structure(structure, 200, 50.0, np.random.default_rng(2), channels=channels)
        for channels in (None, ["m4"])
    )
    np.testing.assert_array_equal(whole[:, 3:4], part)


def test_moments_on_a_beam_are_not_part_of_ambient_forces():
    structure = assemble(beam(1.0, 10.0, 1.0, elements=3, damping_s=1e-3))
    np.testing.assert_array_equal(np.diag(force_density(structure, 2.0)), [2, 0, 2, 0, 2, 0])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda s, r: simulate_structure(s, np.zeros((9, 3)), 5.0, hold="cubic"),
            "zero.*first",
        ),
        (
            lambda s, r: simulate_structure(s, np.zeros((9, 3)), 0.0),
            "not a valid sampling rate",
        ),
        (lambda s, r: simulate_structure(s, np.zeros((9, 2)), 5.0), "one column for each"),
        (lambda s, r: ambient_structure(s, 0, 5.0, r), "not a valid number of samples"),
        (lambda s, r: ambient_structure(s, 9, 5.0, r, channels=["m9"]), "m1, m2, m3"),
        (lambda s, r: ambient_structure(s, 9, 5.0, r, force_psd=np.ones(2)), "does not fit"),
        (lambda s, r: ambient_structure(s, 9, 5.0, r, force_psd=-1.0), "no density"),
    ],
)
def test_what_cannot_be_simulated_is_refused(family, call, words):
    with pytest.raises(ValueError, match=words):
        call(family["example 3.5"](), np.random.default_rng())


def test_an_undamped_structure_is_never_stationary(family):
    with pytest.raises(ValueError, match="never becomes stationary"):
        ambient_structure(family["undamped"](), 9, 5.0, np.random.default_rng())

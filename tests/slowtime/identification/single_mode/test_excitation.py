import numpy as np
import pytest

from slowtime.identification.single_mode.excitation import excitation
from tests.slowtime.identification.oscillators import record

RATE = 50.0


def steady(rng, seconds=120.0, z=0.005):
    return record(rng, f=2.0, z=z, rate=RATE, seconds=seconds, noise=0.02)


@pytest.mark.parametrize("z", [0.001, 0.005, 0.05])
def test_a_mode_under_a_steady_random_force_is_neither(z):
    rng = np.random.default_rng(1)
    for _ in range(5):
        assert excitation(steady(rng, z=z), RATE).flags == ()


def test_an_event_that_came_and_went_is_transient():
    made = steady(np.random.default_rng(2))
    times = np.arange(len(made))[:, None] / RATE
    found = excitation(made * np.exp(-(((times - 40) / 6) ** 2)), RATE)
    assert found.flags == ("transient_force",)
    assert found.event_s is not None
    assert 5 < found.event_s < 25


def test_a_force_that_sets_in_after_the_record_began_is_transient():
    made = steady(np.random.default_rng(3), z=0.05)
    made[:120] *= 1e-3
    assert excitation(made, RATE).flags == ("transient_force",)


def test_a_multisine_repeats_itself_and_its_response_does():
    rng = np.random.default_rng(4)
    times = np.arange(6000) / RATE
    lines = [np.cos(2 * np.pi * k * times / 8.0 + rng.uniform(0, 7)) for k in range(1, 80)]
    wave = np.sum(lines, axis=0)[:, None] + rng.standard_normal((6000, 1))
    found = excitation(wave, RATE)
    assert found.flags == ("periodic_force",)
    assert found.period_s == pytest.approx(8.0, abs=0.05)


def test_few_lines_of_a_machine_are_no_periodic_excitation():
    made = steady(np.random.default_rng(5))
    times = np.arange(len(made))[:, None] / RATE
    turn = sum(np.sin(2 * np.pi * 0.5 * k * times) for k in (1, 2, 3))
    assert excitation(made + 5 * turn, RATE).flags == ()

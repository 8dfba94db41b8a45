"""What no diagnosis could tell apart has no nats between it, and what it could has many."""

from types import SimpleNamespace

import numpy as np
import pytest

from .rigs import Link, Structure
from .rivals import least_nats

ONE = Structure((2.0,), (Link("s1", (-1, 0), 1500.0, 2.0),))
TWO = Structure((3.0, 2.0), (Link("s1", (-1, 0), 4000.0, 4.0), Link("s2", (0, 1), 3000.0, 3.0)))


def nats(structure, change, value):
    """Nats of a change that a model which is right otherwise lacks, under a random load."""
    record = {"t": np.arange(2000) / 100.0, "u": np.random.default_rng(1).normal(size=2000)}
    model = {
        "elements": [
            {"stiffness_n_per_m": one.stiffness, "damping_n_s_per_m": one.damping}
            for one in structure.links
        ],
        "tolerance": {"stiffness": 0.03, "damping": 0.2},
        "sensors": [{"noise_sd": 0.005}] * len(structure.masses),
    }
    return least_nats(structure, model, [SimpleNamespace(linear=change, value=value)], record)


@pytest.mark.parametrize(
    ("structure", "change", "value", "alike"),
    [
        (ONE, ("sensor delay", (0,)), 0.01, True),  # that of the input
        (ONE, ("sensor gain", (0,)), 1.25, True),  # that of the input
        (TWO, ("sensor gain", (0,)), 1.25, False),
        (TWO, ("spring", (-1, 1)), 600.0, False),
        (TWO, ("mass", (1,)), 0.4, False),
    ],
)
def test_the_best_rival_is_near_where_two_changes_do_the_same(structure, change, value, alike):
    found = nats(structure, change, value)
    assert found < 0.1 if alike else found > 100.0


def test_what_is_not_one_linear_change_has_no_number():
    record = {"t": np.arange(4.0), "u": np.zeros(4)}
    assert least_nats(ONE, {}, [SimpleNamespace(linear=None)], record) is None

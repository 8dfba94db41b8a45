"""Derivatives of readings of linear plants of many coordinates, against exact ones."""

import dataclasses

import numpy as np
import pytest

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Matrix, Sensor
from slowtime.dynamics.plant import Plant, plant
from slowtime.dynamics.plant.spectral_slopes import LEAST_COORDINATES
from slowtime.dynamics.units import Quantity

RATE_HZ = 50.0


def driven_chain(kind):
    size = LEAST_COORDINATES
    given = chain([2.0] * size, [9e3] * size, dampings_n_s_per_m=[20.0] * size)
    names = {e.id: f"k{i + 1}" for i, e in enumerate(given.elements)}
    elements = tuple(dataclasses.replace(e, id=names[e.id]) for e in given.elements)
    first, last = given.nodes[4].id, given.nodes[-1].id
    elements += (Matrix(id="reduced", coordinates=(first, last), exact=True),)
    entry = (
        Input(channel="u", kind="force", unit="N", node=first)
        if kind == "force"
        else Input(channel="u", kind="base_acceleration", unit="m/s^2")
    )
    read: tuple[tuple[Quantity, str], ...] = (
        ("displacement", "m"), ("velocity", "m/s"), ("acceleration", "m/s^2"),
    )  # fmt: skip
    sensors = tuple(
        Sensor(channel=what, quantity=what, node=last, unit=unit) for what, unit in read
    )
    return dataclasses.replace(
        given, elements=elements, inputs=(entry,), sensors=sensors
    ), first


@pytest.mark.parametrize("kind", ["force", "base"])
def test_they_are_those_of_the_motion_computed(kind, monkeypatch):
    described, heavy = driven_chain(kind)
    of = Plant.of(described)
    free = (("stiffness", "k3"), ("damping", "k7"), ("mass", heavy))
    rng = np.random.default_rng(0)
    lines = np.zeros(501, dtype=complex)
    lines[5:60] = rng.standard_normal(55) + 1j * rng.standard_normal(55)
    inputs = np.fft.irfft(lines, 1000)[:, None]
    # The series is periodic, so that a record may begin where one ended.
    begun = of.run(of.values, np.tile(inputs, (4, 1)), RATE_HZ).states[-1]
    told, fast = of.sensitivities(of.values, inputs, RATE_HZ, free, state0=begun)
    monkeypatch.setattr(plant, "has_spectral_slopes", lambda *_: False)
    exact, slow = of.sensitivities(of.values, inputs, RATE_HZ, free, state0=begun)
    np.testing.assert_allclose(told, exact)
    off = np.linalg.norm(fast - slow, axis=0) / np.linalg.norm(slow, axis=0)
    assert off[:, len(free) :].max() < 1e-9
    assert off[:, : len(free)].max() < 0.02


def test_models_that_were_not_reduced_keep_exact_derivatives(monkeypatch):
    described, heavy = driven_chain("force")
    whole = dataclasses.replace(described, elements=described.elements[:-1])
    monkeypatch.setattr(plant, "spectral_slopes", lambda *_: pytest.fail("were approximated"))
    of = Plant.of(whole)
    of.sensitivities(of.values, np.ones((20, 1)), RATE_HZ, (("mass", heavy),))

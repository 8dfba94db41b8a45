"""Laws are told from their equivalents at several levels of motion."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.ambient.equivalents import ElementMotion, Equivalents
from slowtime.discrepancy.ambient.law_selection import fit_laws
from slowtime.dynamics.effects import Motion, Place, catalogue

HZ, RATE_HZ, COUNT = 8.0, 200.0, 2**12
SIZES_M = (2e-4, 4e-4, 7e-4)
LAWS = [
    ("bouc_wen", {"kh_n_per_m": 1757.0, "zy_m": 4.6e-4, "n": 1.5}),
    ("bouc_wen", {"kh_n_per_m": 900.0, "zy_m": 2e-4, "n": 2.0}),
    ("cubic_softening", {"k3_n_per_m3": -5e8}),
    ("saturating_stiffness", {"ks_n_per_m": 4000.0, "es_m": 3e-4}),
    ("coulomb", {"friction_n": 0.2}),
    ("quadratic_damping", {"c2_n_s2_per_m2": 400.0}),
]


def motions(seed):
    rng = np.random.default_rng(seed)
    hz = np.fft.rfftfreq(COUNT, 1 / RATE_HZ)
    drawn = rng.standard_normal((2, len(hz)))
    lines = np.exp(-(((hz - HZ) / 2.0) ** 2)) * (drawn[0] + 1j * drawn[1])
    s = 2j * np.pi * hz
    e, v, a = (np.fft.irfft(lines * s**n, COUNT) for n in range(3))
    unit = Motion(e=e, v=v, a=a, times=np.arange(COUNT) / RATE_HZ)
    for size in SIZES_M:
        scale = size / e.std()
        grown = {name: getattr(unit, name) * scale for name in ("e", "v", "a")}
        yield ElementMotion(dataclasses.replace(unit, **grown), 0.0)


def equivalents(kind, parameters, seed=0):
    place, empty = Place("element", "j"), np.zeros(0)
    levels = tuple(motions(seed))
    exact = Equivalents(place, empty, np.zeros((0, 0)), levels).of_law(kind, parameters)
    sds = np.repeat([80.0, 1.0], len(SIZES_M))
    noise = np.random.default_rng(seed).standard_normal(len(exact))
    return Equivalents(place, exact + sds * noise, np.diag(sds**2), levels)


@pytest.mark.parametrize(("name", "parameters"), LAWS)
def test_a_law_is_fitted_to_its_own_equivalents(name, parameters):
    kind = catalogue()[name]
    found = equivalents(kind, parameters)
    (law,) = fit_laws(found, 0.0, [kind])
    leading = kind.strength or next(p.name for p in kind.parameters if p.fitted)
    error = abs(law.effect.parameters[leading] - parameters[leading])
    assert error <= 3 * law.sds[leading]
    assert law.sds[leading] < abs(parameters[leading])


@pytest.mark.parametrize("most_n", [1.0, 1.3, 20.0])
def test_a_shape_whose_force_is_not_finite_does_not_lose_the_law(most_n):
    """As an explicit step does beyond some sharpness: the fit steps back from it."""
    kind = catalogue()["bouc_wen"]
    found = equivalents(kind, LAWS[0][1])

    class Breaking(Equivalents):
        def of_law(self, kind, parameters):
            told = super().of_law(kind, parameters)
            return np.full_like(told, np.nan) if parameters["n"] > most_n else told

    parts = {f.name: getattr(found, f.name) for f in dataclasses.fields(found)}
    (law,) = fit_laws(Breaking(**parts), 0.0, [kind])
    assert law.effect.parameters["n"] <= most_n
    assert np.isfinite(law.chi2)

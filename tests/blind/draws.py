"""Numbers for an effect that make sense for the motion at its place, up to one strength."""

import dataclasses

import numpy as np

from .drafts import Draft, Drawer, Parameters, Surroundings, draw_sign, scaled
from .outside.draws import OUTSIDE_DRAWERS


def draft(name: str, rng: np.random.Generator, here: Surroundings) -> Draft:
    """Draw an effect's parameters."""
    sketch = DRAWERS[name](rng, here)
    return dataclasses.replace(
        sketch, at=lambda s: {key: float(value) for key, value in sketch.at(s).items()}
    )


def _cubic(sign: float) -> Drawer:
    def drawer(rng: np.random.Generator, here: Surroundings) -> Draft:
        size = sign * 0.05 * here.stiffness / here.elongation**2
        return Draft(lambda s: {"k3_n_per_m3": s * size})

    return drawer


def _quadratic(rng: np.random.Generator, here: Surroundings) -> Draft:
    size = draw_sign(rng) * 0.15 * here.stiffness / here.elongation
    return Draft(lambda s: {"k2_n_per_m2": s * size})


def _saturating(rng: np.random.Generator, here: Surroundings) -> Draft:
    es = rng.uniform(0.4, 1.5) * here.elongation
    return Draft(lambda s: {"ks_n_per_m": 0.5 * s * here.stiffness, "es_m": es}, 0.05, 1.9)


def _gap(rng: np.random.Generator, here: Surroundings) -> Draft:
    gap = rng.uniform(0.5, 1.8) * here.elongation
    return Draft(lambda s: {"kg_n_per_m": s * here.stiffness, "gap_m": gap}, 0.03, 8.0)


def _one_sided(rng: np.random.Generator, here: Surroundings) -> Draft:
    gap = 0.0 if rng.random() < 0.3 else rng.uniform(0.2, 1.4) * here.elongation
    side = draw_sign(rng)
    return Draft(
        lambda s: {"kg_n_per_m": 0.5 * s * here.stiffness, "gap_m": gap, "side": side},
        0.03,
        16.0,
    )


def _coulomb(rng: np.random.Generator, here: Surroundings) -> Draft:
    size = 0.1 * here.stiffness * here.elongation
    return Draft(lambda s: {"friction_n": s * size}, 0.01, 10.0)


def _stribeck(rng: np.random.Generator, here: Surroundings) -> Draft:
    size = 0.1 * here.stiffness * here.elongation
    more, vs = rng.uniform(1.4, 2.5), rng.uniform(0.1, 0.6) * here.speed
    return Draft(
        lambda s: {"friction_n": s * size, "static_n": more * s * size, "vs_m_per_s": vs},
        0.01,
        8.0,
    )


def _drag(rng: np.random.Generator, here: Surroundings) -> Draft:
    return Draft(lambda s: {"c2_n_s2_per_m2": s * here.damping / here.speed}, 0.02, 100.0)


def _viscous(rng: np.random.Generator, here: Surroundings) -> Draft:
    least = max(0.5, 5 * here.tolerance[1]) + max(-here.off[1], 0.0)
    return Draft(lambda s: {"dc_n_s_per_m": s * here.damping}, least, 15.0)


def _van_der_pol(rng: np.random.Generator, here: Surroundings) -> Draft:
    e0 = rng.uniform(0.6, 1.5) * here.elongation
    return Draft(lambda s: {"cn_n_s_per_m": s * here.damping, "e0_m": e0}, 0.1, 8.0)


def _bouc_wen(rng: np.random.Generator, here: Surroundings) -> Draft:
    zy, n = rng.uniform(0.3, 1.2) * here.elongation, float(rng.choice([1.0, 1.5, 2.0, 3.0]))
    return Draft(
        lambda s: {"kh_n_per_m": 0.5 * s * here.stiffness, "zy_m": zy, "n": n}, 0.04, 1.9
    )


def _loss(rng: np.random.Generator, here: Surroundings) -> Draft:
    return Draft(lambda s: {"dk_n_per_m": s * here.stiffness}, _beyond(here), 0.7)


def _beyond(here: Surroundings) -> float:
    """Least share of a stiffness to lose, for it to end beyond what is claimed of it.

    Whatever it is above the claim is lost first, and nobody could tell.
    """
    return max(0.08, 4 * here.tolerance[0]) + max(here.off[0], 0.0)


def _jump(rng: np.random.Generator, here: Surroundings) -> Draft:
    first, last = here.inside_s[int(rng.integers(len(here.inside_s)))]
    at, sign = (
        rng.uniform(first + 0.2 * (last - first), last - 0.2 * (last - first)),
        draw_sign(rng, 0.2),
    )
    return Draft(
        lambda s: {"dk_n_per_m": sign * s * here.stiffness, "t_jump_s": at}, 0.003, 0.6
    )


def _drift(rng: np.random.Generator, here: Surroundings) -> Draft:
    sign = draw_sign(rng, 0.2)
    return Draft(
        lambda s: {"dk_n_per_m": sign * s * here.stiffness, "campaign_s": here.campaign_s},
        0.003, 0.6,
    )  # fmt: skip


def _parametric(rng: np.random.Generator, here: Surroundings) -> Draft:
    frequency = rng.uniform(0.2, 1.8) * here.frequencies_hz[0]
    phase = rng.uniform(-np.pi, np.pi)
    return Draft(
        lambda s: {
            "dk_n_per_m": s * here.stiffness, "frequency_hz": frequency, "phase_rad": phase
        },
        0.003, 0.6,
    )  # fmt: skip


def _pendulum(rng: np.random.Generator, here: Surroundings) -> Draft:
    return Draft(lambda s: {"k": here.stiffness}, 1.0, 1.0)


def _added_mass(rng: np.random.Generator, here: Surroundings) -> Draft:
    least = 0.04 if here.weighs else _beyond(here)
    return Draft(lambda s: {"dm_kg": s * here.mass}, least, 0.6)


def _extra(rng: np.random.Generator, here: Surroundings) -> Draft:
    frequency = rng.uniform(0.6, 1.5) * rng.choice(here.frequencies_hz)
    zeta = rng.uniform(0.005, 0.05)

    def at(s: float) -> Parameters:
        mass = s * here.mass
        damping = 2 * zeta * mass * 2 * np.pi * frequency
        return {"mass_kg": mass, "frequency_hz": frequency, "damping_n_s_per_m": damping}

    return Draft(at, 0.01, 0.4)


def _tone(rng: np.random.Generator, here: Surroundings) -> Draft:
    frequency = rng.uniform(0.5, 1.3) * rng.choice(here.frequencies_hz)
    phase = rng.uniform(-np.pi, np.pi)
    return Draft(
        lambda s: {
            "amplitude_n": 0.2 * s * here.force,
            "frequency_hz": frequency,
            "phase_rad": phase,
        }
    )


def _shaken(rng: np.random.Generator, here: Surroundings) -> Draft:
    return Draft(lambda s: {"rms_m_per_s2": 0.2 * s * here.force / here.mass})


def _gain(rng: np.random.Generator, here: Surroundings) -> Draft:
    sign = draw_sign(rng)
    return Draft(lambda s: {"gain": 1 + 0.15 * sign * s}, 0.2, 4.0)


def _delay(rng: np.random.Generator, here: Surroundings) -> Draft:
    return Draft(lambda s: {"delay_s": s / here.rate_hz}, 0.05, 8.0)


def _sensor_gain(rng: np.random.Generator, here: Surroundings) -> Draft:
    if rng.random() < 0.1:
        return Draft(lambda s: {"gain": -1.0}, 1.0, 1.0)
    return _gain(rng, here)


def _of_signal(name: str) -> Drawer:
    def drawer(rng: np.random.Generator, here: Surroundings) -> Draft:
        sign = draw_sign(rng)
        return Draft(lambda s: {name: 0.5 * sign * s * here.signal}, 0.01, 20.0)

    return drawer


def _clip(rng: np.random.Generator, here: Surroundings) -> Draft:
    size = rng.uniform(1.2, 3.0) * here.signal
    return Draft(lambda s: {"clip": size}, 1.0, 1.0)


def _dropout(rng: np.random.Generator, here: Surroundings) -> Draft:
    return Draft(lambda s: {}, 1.0, 1.0)


def _clock(rng: np.random.Generator, here: Surroundings) -> Draft:
    sign = draw_sign(rng)
    return Draft(lambda s: {"skew": sign * 3e-4 * s}, 0.05, 20.0)


def _maxwell(rng: np.random.Generator, here: Surroundings) -> Draft:
    tau = rng.uniform(0.3, 3.0) / (2 * np.pi * here.frequencies_hz[0])
    return Draft(lambda s: {"km_n_per_m": s * here.stiffness, "relaxation_s": tau}, 0.02, 1.5)


def _power_law(rng: np.random.Generator, here: Surroundings) -> Draft:
    power = float(rng.choice([0.5, 0.65, 1.5, 3.0]))
    v0 = float(rng.uniform(0.8, 2.5)) * here.speed
    size = here.damping * v0
    return Draft(lambda s: {"force_n": s * size, "v0_m_per_s": v0, "power": power}, 0.02, 60.0)


def _impact(rng: np.random.Generator, here: Surroundings) -> Draft:
    gap, side = max(rng.uniform(-0.3, 0.8), 0.0) * here.elongation, draw_sign(rng)
    loss = float(rng.choice([0.0, 0.2])) / here.speed
    size = 0.5 * here.stiffness / here.elongation**0.5
    return Draft(
        lambda s: {
            "kc_n_per_m15": s * size, "gap_m": gap, "side": side, "damping_s_per_m": loss
        },
        0.02, 10.0,
    )  # fmt: skip


def _quintic(rng: np.random.Generator, here: Surroundings) -> Draft:
    e0 = float(rng.uniform(2.0, 4.0)) * here.elongation
    share = float(rng.uniform(-0.5, 0.5))
    size = 0.1 * here.stiffness * e0
    return Draft(lambda s: {"k3_n": share * s * size, "k5_n": s * size, "e0_m": e0}, 0.02, 30.0)


DRAWERS: dict[str, Drawer] = {
    "cubic_hardening": _cubic(1.0),
    "cubic_softening": _cubic(-1.0),
    "quadratic_stiffness": _quadratic,
    "saturating_stiffness": _saturating,
    "gap_symmetric": _gap,
    "gap_one_sided": _one_sided,
    "coulomb": _coulomb,
    "stribeck": _stribeck,
    "quadratic_damping": _drag,
    "viscous_damping": _viscous,
    "van_der_pol": _van_der_pol,
    "bouc_wen": _bouc_wen,
    "stiffness_loss": _loss,
    "stiffness_jump": _jump,
    "stiffness_drift": _drift,
    "parametric": _parametric,
    "pendulum_sine": _pendulum,
    "added_mass": _added_mass,
    "extra_dof": _extra,
    "harmonic_force": _tone,
    "base_motion": _shaken,
    "input_gain": _gain,
    "input_delay": _delay,
    "sensor_bias": _of_signal("bias"),
    "sensor_drift": _of_signal("drift_total"),
    "sensor_gain": _sensor_gain,
    "sensor_saturation": _clip,
    "sensor_dropout": _dropout,
    "sensor_clock": _clock,
    "maxwell": _maxwell,
    "power_law_damping": _power_law,
    "impact": _impact,
    "positional_damping": scaled("c2_n_s_per_m3", lambda h: h.damping / h.elongation**2),
    "quintic_stiffness": _quintic,
    **OUTSIDE_DRAWERS,
}

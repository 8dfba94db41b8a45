"""Numbers for the laws that are in no list, of natural size for the motion at their place."""

from collections.abc import Iterable

import numpy as np

from tests.blind.drafts import Draft, Drawer, Surroundings, draw_sign, scaled

from .laws import PLAYS, YIELDS


def _named(name: str, values: Iterable[float]) -> dict[str, float]:
    return {name.format(i): float(value) for i, value in enumerate(values)}


def _prandtl(rng: np.random.Generator, here: Surroundings) -> Draft:
    spread = np.linspace(0.3, 1.0, YIELDS) ** rng.uniform(1.0, 2.0)
    yields = _named("y{}_m", rng.uniform(1.5, 3.5) * here.elongation * spread)
    return Draft(lambda s: {"kh_n_per_m": 0.5 * s * here.stiffness} | yields, 0.04, 1.9)


def _preisach(rng: np.random.Generator, here: Surroundings) -> Draft:
    plays = _named("y{}_m", here.elongation * np.sort(rng.uniform(0.1, 1.6, PLAYS)))
    levels = _named("s{}_m", here.elongation * rng.uniform(0.4, 2.0, PLAYS))
    size = 0.4 * here.stiffness * here.elongation
    return Draft(lambda s: {"force_n": s * size} | plays | levels, 0.02, 4.0)


def _asymmetric_hysteresis(rng: np.random.Generator, here: Surroundings) -> Draft:
    one, other = rng.permutation([rng.uniform(0.3, 0.8), rng.uniform(1.5, 3.0)])
    ends = {"zp_m": float(one) * here.elongation, "zm_m": float(other) * here.elongation}
    return Draft(lambda s: {"kh_n_per_m": 0.5 * s * here.stiffness} | ends, 0.04, 1.9)


def _softening_by_peak(rng: np.random.Generator, here: Surroundings) -> Draft:
    peak = float(rng.uniform(1.0, 3.0)) * here.elongation
    return Draft(lambda s: {"dk_n_per_m": 0.3 * s * here.stiffness, "peak_m": peak}, 0.03, 2.0)


def _self_centring(rng: np.random.Generator, here: Surroundings) -> Draft:
    knee = float(rng.uniform(0.6, 1.4)) * here.elongation
    yields, share = float(rng.uniform(0.2, 0.5)) * knee, float(rng.uniform(0.3, 0.7))
    size = 0.5 * here.stiffness
    return Draft(
        lambda s: {
            "ks_n_per_m": s * size, "knee_m": knee, "kd_n_per_m": share * s * size,
            "y_m": yields,
        },
        0.04, 1.1,
    )  # fmt: skip


def _combined(rng: np.random.Generator, here: Surroundings) -> Draft:
    k, size, speed = here.stiffness, here.elongation, here.speed
    es, y = float(rng.uniform(0.5, 1.0)) * size, float(rng.uniform(0.3, 1.0)) * size
    return Draft(
        lambda s: {
            "dk_n_per_m": 0.3 * s * k, "es_m": es, "k5_n_per_m5": 0.004 * s * k / size**4,
            "kh_n_per_m": 0.3 * s * k, "y_m": y,
            "c2_n_s2_per_m2": 0.5 * s * here.damping / speed,
        },
        0.02, 2.5,
    )  # fmt: skip


def _heating(rng: np.random.Generator, here: Surroundings) -> Draft:
    scales = {"v0_m_per_s": 2.0 * here.speed, "tau_s": float(rng.uniform(2.0, 8.0))}
    return Draft(lambda s: {"dk_n_per_m": 0.3 * s * here.stiffness} | scales, 0.01, 2.5)


def _maxwell_with_drag(rng: np.random.Generator, here: Surroundings) -> Draft:
    scales = {
        "v0_m_per_s": float(rng.uniform(0.3, 1.0)) * here.speed,
        "h_m": float(rng.uniform(0.3, 1.0)) * here.elongation,
    }
    return Draft(lambda s: {"ka_n_per_m": 0.5 * s * here.stiffness} | scales, 0.02, 4.0)


def _friction(here: Surroundings) -> float:
    return 0.1 * here.stiffness * here.elongation


def _asymmetric_friction(rng: np.random.Generator, here: Surroundings) -> Draft:
    share = draw_sign(rng) * float(rng.uniform(0.4, 0.9))
    return Draft(
        lambda s: {"friction_n": s * _friction(here), "share": share}, 0.02, 10.0
    )  # fmt: skip


def _asymmetric_stribeck(rng: np.random.Generator, here: Surroundings) -> Draft:
    speeds = here.speed * rng.permutation([rng.uniform(0.05, 0.2), rng.uniform(0.4, 1.2)])
    more, share = float(rng.uniform(1.5, 2.5)), draw_sign(rng) * float(rng.uniform(0.3, 0.6))
    return Draft(
        lambda s: {
            "friction_n": s * _friction(here), "static_n": more * s * _friction(here),
            "vp_m_per_s": speeds[0], "vm_m_per_s": speeds[1], "share": share,
        },
        0.02, 8.0,
    )  # fmt: skip


def _by_place_and_speed(rng: np.random.Generator, here: Surroundings) -> Draft:
    shape = {
        "share": float(rng.uniform(0.5, 0.9)),
        "length_m": float(rng.uniform(0.3, 0.8)) * here.elongation,
        "v0_m_per_s": float(rng.uniform(0.5, 2.0)) * here.speed,
    }  # fmt: skip
    return Draft(lambda s: {"friction_n": s * _friction(here)} | shape, 0.02, 10.0)


def _lift_off(rng: np.random.Generator, here: Surroundings) -> Draft:
    lift = draw_sign(rng) * float(rng.uniform(0.5, 1.5)) * here.elongation
    return Draft(lambda s: {"friction_n": s * _friction(here), "lift_m": lift}, 0.02, 10.0)


def _rate_and_state(rng: np.random.Generator, here: Surroundings) -> Draft:
    a = float(rng.uniform(0.03, 0.06))
    shape = {
        "mu": 0.6, "a": a, "b": a * float(rng.uniform(1.2, 2.0)),
        "v0_m_per_s": 0.1 * here.speed,
        "path_m": float(rng.uniform(0.05, 0.3)) * here.elongation,
    }  # fmt: skip
    return Draft(lambda s: {"normal_n": 2.0 * s * _friction(here)} | shape, 0.02, 6.0)


def _late_friction(rng: np.random.Generator, here: Surroundings) -> Draft:
    lag = float(rng.uniform(0.05, 0.2)) / here.frequencies_hz[0]
    shape = {"v0_m_per_s": 0.1 * here.speed, "lag_s": lag}
    return Draft(lambda s: {"friction_n": s * _friction(here)} | shape, 0.02, 10.0)


def _one_sided_damping(rng: np.random.Generator, here: Surroundings) -> Draft:
    es = draw_sign(rng) * float(rng.uniform(0.2, 0.6)) * here.elongation
    return Draft(lambda s: {"ca": 2.0 * s * here.damping, "es_m": es}, 0.05, 40.0)


def _direction_damping(rng: np.random.Generator, here: Surroundings) -> Draft:
    sign = draw_sign(rng)
    return Draft(lambda s: {"ca": sign * s * here.damping}, 0.05, 60.0)


def _squeeze_film(rng: np.random.Generator, here: Surroundings) -> Draft:
    film = draw_sign(rng) * float(rng.uniform(1.5, 3.0)) * here.elongation
    return Draft(lambda s: {"ca": s * here.damping, "film_m": film}, 0.02, 20.0)


def _beyond_speed(name: str, size: float, least: float, most: float) -> Drawer:
    def drawer(rng: np.random.Generator, here: Surroundings) -> Draft:
        v0 = float(rng.uniform(least, most)) * here.speed
        unit = size * here.damping * (v0 if name == "force_n" else 1.0)
        return Draft(lambda s: {name: s * unit, "v0": v0}, 0.05, 60.0)

    return drawer


def _viscous_stop(rng: np.random.Generator, here: Surroundings) -> Draft:
    gap = float(rng.uniform(0.5, 1.5)) * here.elongation
    return Draft(
        lambda s: {"kg": 0.2 * s * here.stiffness, "cg": 5.0 * s * here.damping, "gap_m": gap},
        0.03, 20.0,
    )  # fmt: skip


def _exponential(rng: np.random.Generator, here: Surroundings) -> Draft:
    e0 = draw_sign(rng) * float(rng.uniform(1.5, 3.0)) * here.elongation
    size = 0.2 * here.stiffness * abs(e0)
    return Draft(lambda s: {"force_n": s * size * float(np.sign(e0)), "e0_m": e0}, 0.02, 5.0)


def _cusp(rng: np.random.Generator, here: Surroundings) -> Draft:
    size = 0.2 * here.stiffness * here.elongation
    return Draft(lambda s: {"force_n": s * size, "e0_m": here.elongation}, 0.02, 4.0)


def _periodic(least: float, most: float) -> Drawer:
    def drawer(rng: np.random.Generator, here: Surroundings) -> Draft:
        length = float(rng.uniform(least, most)) * here.elongation
        size = draw_sign(rng) * 0.1 * here.stiffness * here.elongation
        return Draft(lambda s: {"force_n": s * size, "length_m": length}, 0.02, 4.0)

    return drawer


def _magnet(rng: np.random.Generator, here: Surroundings) -> Draft:
    h, sign = float(rng.uniform(0.8, 2.0)) * here.elongation, draw_sign(rng)
    high = 0.8 if sign > 0 else 4.0
    return Draft(lambda s: {"km": sign * s * here.stiffness, "h_m": h}, 0.02, high)


def _truss(rng: np.random.Generator, here: Surroundings) -> Draft:
    height = float(rng.uniform(0.8, 2.5)) * here.elongation
    rest = float(rng.uniform(0.9, 1.1)) * height
    return Draft(
        lambda s: {"kt": s * here.stiffness, "height_m": height, "rest_m": rest}, 0.02, 4.0
    )


def _slack(rng: np.random.Generator, here: Surroundings) -> Draft:
    slack = float(rng.uniform(0.2, 1.2)) * here.elongation
    return Draft(lambda s: {"ks": 0.5 * s * here.stiffness, "slack_m": slack}, 0.03, 1.8)


def _relaxation(rng: np.random.Generator, here: Surroundings) -> Draft:
    tau = float(rng.uniform(0.1, 0.4)) * here.campaign_s
    return Draft(lambda s: {"dk": 0.3 * s * here.stiffness, "tau_s": tau}, 0.01, 2.0)


def _body(rng: np.random.Generator, here: Surroundings, name: str) -> Draft:
    omega = 2 * np.pi * float(rng.uniform(0.7, 1.4) * rng.choice(here.frequencies_hz))
    zeta, size = float(rng.uniform(0.02, 0.08)), 2.0 * here.elongation

    def at(s: float) -> dict[str, float]:
        mass = 0.1 * s * here.mass
        body = {"mass_kg": mass, "c": 2 * zeta * mass * omega}
        if name == "k3":
            return body | {"k3": mass * (omega / size) ** 2}
        return body | {"k": 1.5 * mass * omega**2, "track_m": size}

    return Draft(at, 0.05, 4.0)


OUTSIDE_DRAWERS: dict[str, Drawer] = {
    "prandtl_ishlinskii": _prandtl,
    "preisach": _preisach,
    "asymmetric_hysteresis": _asymmetric_hysteresis,
    "softening_by_peak": _softening_by_peak,
    "self_centring": _self_centring,
    "hardening_hysteresis": _combined,
    "heating_softening": _heating,
    "maxwell_with_drag": _maxwell_with_drag,
    "wedge_friction": scaled("mu", lambda h: 0.1 * h.stiffness),
    "asymmetric_friction": _asymmetric_friction,
    "asymmetric_stribeck": _asymmetric_stribeck,
    "friction_by_place_and_speed": _by_place_and_speed,
    "friction_with_lift_off": _lift_off,
    "rate_and_state_friction": _rate_and_state,
    "late_friction": _late_friction,
    "amplitude_damping": scaled("ca", lambda h: h.damping / h.elongation),
    "one_sided_damping": _one_sided_damping,
    "direction_damping": _direction_damping,
    "squeeze_film": _squeeze_film,
    "eddy_brake": _beyond_speed("force_n", 2.0, 0.3, 1.0),
    "shear_thinning": _beyond_speed("ca", 4.0, 0.1, 0.5),
    "relief_damper": _beyond_speed("ca", 4.0, 0.2, 0.6),
    "viscous_stop": _viscous_stop,
    "power_stiffness": scaled("kp", lambda h: 0.1 * h.stiffness / h.elongation**0.5),
    "exponential_spring": _exponential,
    "cusp": _cusp,
    "sine_squared": _periodic(3.0, 8.0),
    "cogging": _periodic(1.5, 4.0),
    "magnet": _magnet,
    "shallow_truss": _truss,
    "slack_cable": _slack,
    "stiffness_relaxation": _relaxation,
    "missing_link": scaled("k", lambda h: 0.1 * h.stiffness),
    "nonlinear_absorber": lambda rng, here: _body(rng, here, "k3"),
    "rolling_body": lambda rng, here: _body(rng, here, "k"),
}

"""A law that contains a simpler one gives its force, with the constants of the limit."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from slowtime.dynamics.effects import Law, Motion, catalogue, force_along, general_kinds

RATE = 4000.0
T = np.arange(8000) / RATE
KINDS = catalogue()
SHORT_M, CARRIED_M = 5e-5, 3e-4
"""Lengths below those of the motion, that samples still resolve."""
TINY_M, TINY_V, TINY_S, HIGH_HZ = 1e-10, 1e-6, 1e-9, 1e9
"""Lengths, speeds and times far below those of the motion, and frequencies far above."""
FEW = 600
"""Samples over which the implicit solver is run."""
TOLERANCE = 1e-6
"""[share of the largest force]"""


def motion(rng):
    """Tones of random amplitudes and phases, in millimetres."""
    found = np.zeros((3, len(T)))
    for turn in (7.0, 19.0, 31.0):
        size, phase = 1e-3 * rng.uniform(0.5, 2.0), rng.uniform(0, 2 * np.pi)
        found += size * np.stack([
            np.sin(turn * T + phase),
            turn * np.cos(turn * T + phase),
            -(turn**2) * np.sin(turn * T + phase),
        ])  # fmt: skip
    return Motion(e=found[0], v=found[1], a=found[2], times=T)


def sliding(seen):
    """Samples that a path of many presliding lengths separates from the last reversal."""
    turns = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(seen.v))) + 1])
    last = turns[np.searchsorted(turns, np.arange(len(T)), "right") - 1]
    return np.abs(seen.e - seen.e[last]) > 24 * SHORT_M


def stiff(name, constants, seen):
    """Force of a law with memory by an implicit solver: limits are too fast for samples."""
    action, p = KINDS[name].action, KINDS[name].values(constants)
    assert isinstance(action, Law)
    e, v = CubicSpline(T, seen.e), CubicSpline(T, seen.v)

    def rates(t, z):
        return [float(rate(float(e(t)), float(v(t)), t, z, p)) for rate in action.rates]

    inner = solve_ivp(
        rates, (0.0, float(T[FEW - 1])),
        np.zeros(len(action.rates)), method="Radau", t_eval=T[:FEW],
        rtol=1e-9, atol=1e-10 if name == "lugre" else 1e-22, max_step=2e-4,
    ).y  # fmt: skip
    points = zip(seen.e[:FEW], seen.v[:FEW], T[:FEW], inner.T, strict=True)
    return np.array(
        [float(action.force(float(x), float(s), float(t), z, p)) for x, s, t, z in points]
    )


def friction(p):
    return {"friction_n": p["friction_n"]}


LIMITS = {
    ("power_law_damping", "viscous_damping"): lambda p: {
        "force_n": p["dc_n_s_per_m"] * 0.03, "v0_m_per_s": 0.03, "power": 1.0,
    },
    ("power_law_damping", "quadratic_damping"): lambda p: {
        "force_n": p["c2_n_s2_per_m2"] * 0.03**2, "v0_m_per_s": 0.03, "power": 2.0,
    },
    ("power_law_damping", "cubic_damping"): lambda p: {
        "force_n": p["c3_n_s3_per_m3"] * 0.03**3, "v0_m_per_s": 0.03, "power": 3.0,
    },
    ("rayleigh_damping", "cubic_damping"): lambda p: {
        "cn_n_s_per_m": p["c3_n_s3_per_m3"] * TINY_V**2, "v0_m_per_s": TINY_V,
    },
    ("friction_with_drag", "coulomb"): lambda p: {**friction(p), "c2_n_s2_per_m2": 0.0},
    ("friction_with_drag", "quadratic_damping"): lambda p: {**p, "friction_n": 0.0},
    ("friction_with_creep", "coulomb"): lambda p: {
        **friction(p), "vs_m_per_s": 1e-3 * TINY_V,
    },
    ("dahl", "coulomb"): lambda p: {**friction(p), "presliding_m": SHORT_M},
    ("friction_in_series_with_spring", "coulomb"): lambda p: {
        **friction(p), "presliding_m": CARRIED_M,
    },
    ("friction_with_play", "coulomb"): lambda p: {
        **friction(p), "play_m": 0.0, "presliding_m": CARRIED_M,
    },
    ("friction_with_play", "friction_in_series_with_spring"): lambda p: {**p, "play_m": 0.0},
    ("lugre", "coulomb"): lambda p: {
        **friction(p), "static_n": p["friction_n"], "vs_m_per_s": 0.01,
        "presliding_m": SHORT_M, "bristle_damping_n_s_per_m": 0.0,
    },
    ("lugre", "stribeck"): lambda p: {
        **p, "presliding_m": TINY_M, "bristle_damping_n_s_per_m": 0.0,
    },
    ("lugre", "dahl"): lambda p: {
        **p, "static_n": p["friction_n"], "vs_m_per_s": 0.01, "bristle_damping_n_s_per_m": 0.0,
    },
    ("bouc_wen_general", "bouc_wen"): lambda p: {
        "kh_n_per_m": p["kh_n_per_m"], "n": p["n"],
        "beta_per_mn": 0.5 / p["zy_m"] ** p["n"], "gamma_per_mn": 0.5 / p["zy_m"] ** p["n"],
    },
    ("bouc_wen_general", "dahl"): lambda p: {
        "kh_n_per_m": p["friction_n"] / p["presliding_m"], "n": 1.0,
        "beta_per_mn": 1 / p["presliding_m"], "gamma_per_mn": 0.0,
    },
    ("bouc_wen_degrading", "bouc_wen"): lambda p: {**p, "wear": 0.0},
    ("bouc_wen_pinching", "bouc_wen"): lambda p: {**p, "slackness": 0.0, "width": 0.5},
    ("quintic_stiffness", "cubic_hardening"): lambda p: {
        "k3_n": p["k3_n_per_m3"] * 2e-3**3, "k5_n": 0.0, "e0_m": 2e-3,
    },
    ("quintic_stiffness", "cubic_softening"): lambda p: {
        "k3_n": p["k3_n_per_m3"] * 2e-3**3, "k5_n": 0.0, "e0_m": 2e-3,
    },
    ("stiffness_two_knees", "gap_symmetric"): lambda p: {
        **p, "kg2_n_per_m": 0.0, "gap2_m": 1e-3,
    },
    ("maxwell", "viscous_damping"): lambda p: {
        "km_n_per_m": p["dc_n_s_per_m"] / TINY_S, "relaxation_s": TINY_S,
    },
    ("fractional_damping", "viscous_damping"): lambda p: {
        "kf_n_per_m": p["dc_n_s_per_m"] * 2 * np.pi * HIGH_HZ / 5, "order": 1.0,
        "centre_hz": HIGH_HZ,
    },
}  # fmt: skip
"""Constants of the general law, from those of the simple one."""
VALUES = {
    "n": (1.0, 3.0), "presliding_m": (2e-4, 1e-3), "zy_m": (5e-4, 2e-3),
    "gap_m": (5e-4, 2e-3), "vs_m_per_s": (0.005, 0.05),
}  # fmt: skip
"""Ranges of constants that belong to the motion; others are from 1 to 10, in their units."""
OVER_SHORT_PATHS = "dahl", "friction_in_series_with_spring", "friction_with_play", "lugre"
"""Kinds whose friction builds up over a path: they are compared beyond it."""
STIFF = {
    ("lugre", "stribeck"), ("maxwell", "viscous_damping"),
    ("fractional_damping", "viscous_damping"),
}  # fmt: skip
"""Limits in which the memory is much faster than the samples."""
PAIRS = [(kind.name, name) for kind in general_kinds(KINDS) for name in kind.contains]


def drawn(name, rng):
    """Draw constants of a simple law; friction at rest is above that of sliding."""
    kind = KINDS[name]
    found = {
        p.name: float(rng.uniform(*VALUES.get(p.name, (1.0, 10.0))))
        for p in kind.parameters if not p.choices
    }  # fmt: skip
    found = {
        name: -value if kind.parameter(name).high == 0 else value
        for name, value in found.items()
    }
    if "static_n" in found:
        found["static_n"] = 1.5 * found["friction_n"]
    return found


def test_the_limit_of_every_containment_is_written_down():
    assert sorted(PAIRS) == sorted(LIMITS)


@pytest.mark.parametrize(("general", "simple"), PAIRS)
def test_the_general_law_becomes_the_simple_one(general, simple):
    """Beside linear stiffness and damping, which the element has itself."""
    rng = np.random.default_rng(len(general) + 100 * len(simple))
    for _ in range(3):
        seen, constants = motion(rng), drawn(simple, rng)
        limit = LIMITS[general, simple](constants)
        truth = force_along(KINDS[simple], constants, seen)
        use = np.ones(len(T), dtype=bool)
        if general in OVER_SHORT_PATHS and simple == "coulomb":
            use = sliding(seen)
        if (general, simple) in STIFF:
            use = np.arange(len(T)) < FEW
            found = np.zeros(len(T))
            found[use] = stiff(general, limit, seen)
            use[:5] = False  # memory begins at zero
            for turn in np.flatnonzero(np.diff(np.sign(seen.v))):
                use[turn : turn + 3] = False
        else:
            found = force_along(KINDS[general], limit, seen)
        own = np.stack([seen.e, seen.v], axis=1)[use]
        left = (found - truth)[use]
        left = left - own @ np.linalg.lstsq(own, left, rcond=None)[0]
        assert use.sum() > 500
        assert np.abs(left).max() < TOLERANCE * np.abs(truth).max()


@pytest.mark.parametrize(
    ("general", "simple"), [(k.name, s) for k in general_kinds(KINDS) for s in k.similar]
)
def test_a_law_that_is_only_similar_has_no_limit_here(general, simple):
    assert (general, simple) not in LIMITS

"""The effects that can be hidden in a rig, by name.

Those of the catalogue are written from the contract's table and nowhere else; those that are
in no list are in `outside.laws`.
"""

import dataclasses

from .law import Law
from .outside.laws import OUTSIDE

ELEMENT = (
    Law("cubic_hardening", "hardening", leading="k3_n_per_m3", force="k3_n_per_m3*e*e*e"),
    Law("cubic_softening", "softening", leading="k3_n_per_m3", force="k3_n_per_m3*e*e*e"),
    Law("quadratic_stiffness", "asymmetric stiffness", leading="k2_n_per_m2",
        force="k2_n_per_m2*e*e"),
    Law("saturating_stiffness", "softening", leading="ks_n_per_m",
        force="ks_n_per_m*(es_m*tanh(e/es_m) - e)"),
    Law("gap_symmetric", "hardening", leading="gap_m",
        force="kg_n_per_m*(e - gap_m if e > gap_m else e + gap_m if e < -gap_m else 0.0)"),
    Law("gap_one_sided", "asymmetric stiffness", leading="kg_n_per_m",
        force="kg_n_per_m*(max(e - gap_m, 0.0) if side > 0 else min(e + gap_m, 0.0))"),
    Law("coulomb", "friction", leading="friction_n", grip="friction_n"),
    Law("stribeck", "friction", leading="friction_n",
        grip="friction_n + (static_n - friction_n)*exp(-(w/vs_m_per_s)**2)"),
    Law("quadratic_damping", "drag", leading="c2_n_s2_per_m2", force="c2_n_s2_per_m2*abs(v)*v"),
    Law("viscous_damping", "linear damping", leading="dc_n_s_per_m", force="dc_n_s_per_m*v"),
    Law("van_der_pol", "negative damping", leading="cn_n_s_per_m",
        force="cn_n_s_per_m*((e/e0_m)**2 - 1.0)*v"),
    Law("bouc_wen", "hysteresis", leading="kh_n_per_m", force="kh_n_per_m*(h0 - e)",
        rates=("v*(1.0 - abs(h0/zy_m)**n*(1.0 + copysign(1.0, v*h0))/2.0)",)),
    Law("stiffness_loss", "linear stiffness", leading="dk_n_per_m", force="-dk_n_per_m*e"),
    Law("stiffness_jump", "time-varying", leading="dk_n_per_m",
        force="(-dk_n_per_m*e if T >= t_jump_s else 0.0)"),
    Law("stiffness_drift", "time-varying", leading="dk_n_per_m",
        force="-dk_n_per_m*e*(T/campaign_s)"),
    Law("parametric", "parametric", leading="dk_n_per_m",
        force="dk_n_per_m*cos(6.283185307179586*frequency_hz*T + phase_rad)*e"),
    Law("maxwell", "viscoelasticity", leading="km_n_per_m", force="km_n_per_m*h0",
        rates=("v - h0/relaxation_s",)),
    Law("power_law_damping", "drag", leading="force_n",
        force="force_n*copysign(abs(v/v0_m_per_s)**power, v)"),
    Law("impact", "asymmetric stiffness", leading="kc_n_per_m15",
        force="side*max(kc_n_per_m15*max(side*e - gap_m, 0.0)**1.5"
        "*(1.0 + damping_s_per_m*side*v), 0.0)"),
    Law("positional_damping", "damping by elongation", leading="c2_n_s_per_m3",
        force="c2_n_s_per_m3*e*e*v"),
    Law("quintic_stiffness", "polynomial stiffness", leading="k5_n",
        force="k3_n*(e/e0_m)**3 + k5_n*(e/e0_m)**5"),
    Law("pendulum_sine", "softening", leading="k", force="k*(sin(e) - e)"),
)  # fmt: skip

ELSEWHERE = (
    Law("added_mass", "linear mass", "node", "dm_kg"),
    Law("extra_dof", "extra degree of freedom", "node", "mass_kg"),
    Law("harmonic_force", "tonal input", "node", "amplitude_n"),
    Law("base_motion", "random input", "base", "rms_m_per_s2"),
    Law("input_gain", "input", "input", "gain"),
    Law("input_delay", "input", "input", "delay_s"),
    Law("sensor_bias", "sensor", "sensor", "bias"),
    Law("sensor_drift", "sensor", "sensor", "drift_total"),
    Law("sensor_gain", "sensor", "sensor", "gain"),
    Law("sensor_saturation", "sensor", "sensor", "clip"),
    Law("sensor_dropout", "sensor", "sensor"),
    Law("sensor_clock", "sensor", "sensor", "skew"),
)

LAWS = {
    law.name: dataclasses.replace(law, listed=law not in OUTSIDE)
    for law in (*ELEMENT, *ELSEWHERE, *OUTSIDE)
}
LISTED = tuple(name for name, law in LAWS.items() if law.listed)
UNLISTED = tuple(name for name, law in LAWS.items() if not law.listed)
FAULTS = tuple(name for name, law in LAWS.items() if law.where in ("sensor", "input"))
PHYSICS = tuple(name for name in LISTED if name not in FAULTS)
UNPREDICTABLE = ("base_motion",)
"""Acts on the held-out record in a way that nobody could foretell."""


def family_of(name: str) -> str:
    """Family of an effect by name; one that a report made up is a family of its own."""
    return LAWS[name].family if name in LAWS else name

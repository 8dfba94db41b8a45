"""The effects that can be hidden in a rig, written from the contract's table and nowhere else.

A law is text: an expression in e [m] and v [m/s] (elongation of an element and its rate), T
(time of the campaign [s]) and its parameters. `equations` makes equations of motion of them.
"""

import dataclasses
from typing import Literal

Where = Literal["element", "node", "base", "input", "sensor", "structure"]


@dataclasses.dataclass(frozen=True)
class Law:
    """One effect: what it is called, where it sits, what it adds.

    Parameters
    ----------
    leading
        The parameter whose error is scored; empty where there is none.
    force
        Of an element, added to k e + c v.
    rate
        Of the internal state z, where the force has one.
    grip
        Of dry friction: the most that it holds, an expression in e and w = abs(v).
    listed
        Whether the contract lists it. What is not listed is to be called unknown.
    kin
        Families that would not be a lie, for an effect that is not listed.
    """

    name: str
    family: str
    where: Where = "element"
    leading: str = ""
    force: str = ""
    rate: str = ""
    grip: str = ""
    listed: bool = True
    kin: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()
    """Other names under which a library may know it."""


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
    Law("bouc_wen", "hysteresis", leading="kh_n_per_m", force="kh_n_per_m*(z - e)",
        rate="v*(1.0 - abs(z/zy_m)**n*(1.0 + copysign(1.0, v*z))/2.0)"),
    Law("stiffness_loss", "linear stiffness", leading="dk_n_per_m", force="-dk_n_per_m*e"),
    Law("stiffness_jump", "time-varying", leading="dk_n_per_m",
        force="(-dk_n_per_m*e if T >= t_jump_s else 0.0)"),
    Law("stiffness_drift", "time-varying", leading="dk_n_per_m",
        force="-dk_n_per_m*e*(T/campaign_s)"),
    Law("parametric", "parametric", leading="dk_n_per_m",
        force="dk_n_per_m*cos(6.283185307179586*frequency_hz*T + phase_rad)*e"),
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

OUTSIDE = (
    Law("maxwell_branch", "viscoelastic", force="ka*(e - z)", rate="(e - z)/tau_s",
        kin=("linear damping",), aliases=("maxwell",)),
    Law("power_damping", "power-law damping", force="cp*copysign(abs(v)**p, v)",
        kin=("drag", "friction"), aliases=("power_law_damping",)),
    Law("contact_exponent", "contact", force="kc*max(e - gap_m, 0.0)**1.5",
        kin=("asymmetric stiffness",), aliases=("contact", "hertz_contact", "hertz")),
    Law("amplitude_damping", "amplitude-proportional damping", force="ca*abs(e)*v",
        kin=("drag",)),
    Law("displacement_damping", "position-dependent damping", force="ca*e*e*v", kin=("drag",)),
    Law("quintic_hardening", "higher hardening", force="k5*e**5", kin=("hardening",),
        aliases=("quintic", "quintic_stiffness")),
    Law("power_stiffness", "fractional hardening", force="kp*e*abs(e)**0.5",
        kin=("hardening",)),
    Law("wedge_friction", "position-dependent friction", grip="mu*abs(e)", kin=("friction",)),
    Law("missing_link", "missing element", "structure"),
)  # fmt: skip

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


@dataclasses.dataclass(frozen=True)
class Placed:
    """An effect at its place, with numbers."""

    law: Law
    place: str
    parameters: dict[str, float]

    def where(self) -> dict[str, str]:
        """As a report says it."""
        return {"kind": self.law.where, "id": self.place}


def family_of(name: str) -> str:
    """Family of an effect by name; one that a report made up is a family of its own."""
    return LAWS[name].family if name in LAWS else name

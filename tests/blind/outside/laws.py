"""Laws that no catalogue lists, as text, each with the families that would not be a lie of it.

`kin` are families of the catalogue whose law is of the same physics, or a limit or a leading
term of this one; `families` gives the reasons.
"""

from tests.blind.law import Law

YIELDS, PLAYS = 5, 4
"""Stops of the Prandtl-Ishlinskii law, plays of the Preisach law."""
_RSF = "(mu, a, b, v0_m_per_s, path_m)"

HYSTERESIS = (
    Law(
        "prandtl_ishlinskii", "distributed hysteresis",
        force="kh_n_per_m*(("
        + " + ".join(f"clip(h{i}, y{i}_m)" for i in range(YIELDS)) + f")/{YIELDS}.0 - e)",
        rates=tuple(f"stop_rate(v, h{i}, y{i}_m)" for i in range(YIELDS)),
        kin=("hysteresis", "friction"),
    ),
    Law(
        "preisach", "distributed hysteresis",
        force="-force_n*(" + " + ".join(f"tanh(h{i}/s{i}_m)" for i in range(PLAYS))
        + f")/{PLAYS}.0",
        rates=tuple(f"play_rate(e, v, h{i}, y{i}_m)" for i in range(PLAYS)),
        kin=("hysteresis", "friction"),
    ),
    Law("asymmetric_hysteresis", "asymmetric hysteresis", force="kh_n_per_m*(h0 - e)",
        rates=("v*(1.0 - abs(h0)/(zp_m if h0 > 0.0 else zm_m)"
        "*(1.0 + copysign(1.0, v*h0))/2.0)",),
        kin=("hysteresis", "friction", "asymmetric stiffness")),
    Law("softening_by_peak", "damage", force="-dk_n_per_m*e*(1.0 - exp(-h0/peak_m))",
        rates=("peak_rate(e, v, h0, peak_m)",),
        kin=("hysteresis", "softening", "time-varying", "linear stiffness")),
    Law("self_centring", "self-centring hysteresis",
        force="ks_n_per_m*(clip(e, knee_m) - e) + kd_n_per_m*(h0 - e)",
        rates=("stop_rate(v, h0, y_m)",), kin=("hysteresis", "softening", "friction")),
    Law("hardening_hysteresis", "combined", force="-dk_n_per_m*es_m*tanh(e/es_m)"
        " + k5_n_per_m5*e**5 + kh_n_per_m*(h0 - e) + c2_n_s2_per_m2*abs(v)*v",
        rates=("stop_rate(v, h0, y_m)",),
        kin=("hysteresis", "friction", "softening", "hardening", "polynomial stiffness",
             "drag")),
    Law("heating_softening", "thermal softening", force="-dk_n_per_m*e*tanh(h0)",
        rates=("(v/v0_m_per_s)**2/tau_s - h0/tau_s",),
        kin=("softening", "time-varying", "linear stiffness")),
    Law("maxwell_with_drag", "viscoelastic", force="ka_n_per_m*h0",
        rates=("v - copysign(v0_m_per_s*(abs(h0)/h_m)**0.5, h0)",),
        kin=("viscoelasticity", "hysteresis", "linear damping", "drag", "friction")),
)  # fmt: skip

FRICTION = (
    Law("wedge_friction", "position-dependent friction", grip="mu*abs(e)", kin=("friction",)),
    Law("asymmetric_friction", "friction by direction", grip="friction_n*(1.0 + share*d)",
        kin=("friction",)),
    Law("asymmetric_stribeck", "friction by direction",
        grip="(friction_n + (static_n - friction_n)"
        "*exp(-w/(vp_m_per_s if d > 0 else vm_m_per_s)))*(1.0 + share*d)", kin=("friction",)),
    Law("friction_by_place_and_speed", "position-dependent friction",
        grip="friction_n*(1.0 + share*sin(e/length_m))/(1.0 + w/v0_m_per_s)",
        kin=("friction",)),
    Law("friction_with_lift_off", "position-dependent friction",
        grip="friction_n*max(1.0 + e/lift_m, 0.0)", kin=("friction",)),
    Law("rate_and_state_friction", "friction with age",
        force=f"normal_n*rate_and_state(v, h0, {_RSF})",
        rates=(f"renewal_rate(v, h0, {_RSF})",), kin=("friction",)),
    Law("late_friction", "friction with a lag", force="friction_n*h0",
        rates=("(tanh(v/v0_m_per_s) - h0)/lag_s",),
        kin=("friction", "hysteresis", "viscoelasticity", "drag")),
)  # fmt: skip

DAMPING = (
    Law("amplitude_damping", "damping by elongation", force="ca*abs(e)*v",
        kin=("drag", "damping by elongation")),
    Law("one_sided_damping", "asymmetric damping", force="ca*v*(1.0 + tanh(e/es_m))/2.0",
        kin=("damping by elongation", "linear damping")),
    Law("direction_damping", "asymmetric damping", force="ca*abs(v)",
        kin=("drag", "linear damping")),
    Law("squeeze_film", "damping by elongation", force="ca*v/(1.0 - 0.8*tanh(e/film_m))**3",
        kin=("damping by elongation", "linear damping", "drag")),
    Law("eddy_brake", "falling damping", force="force_n*2.0*(v/v0)/(1.0 + (v/v0)**2)",
        kin=("drag", "linear damping", "friction", "negative damping")),
    Law("shear_thinning", "falling damping", force="ca*v/(1.0 + abs(v)/v0)",
        kin=("drag", "linear damping", "friction")),
    Law("relief_damper", "bilinear damping", force="ca*(v if abs(v) < v0 else copysign(v0, v)"
        " + 0.1*(v - copysign(v0, v)))", kin=("drag", "linear damping", "friction")),
    Law("viscous_stop", "stop with damping",
        force="(kg*(e - copysign(gap_m, e)) + cg*v if abs(e) > gap_m else 0.0)",
        kin=("hardening", "damping by elongation", "polynomial stiffness")),
)  # fmt: skip

STIFFNESS = (
    Law("power_stiffness", "fractional hardening", force="kp*e*abs(e)**0.5",
        kin=("hardening", "polynomial stiffness")),
    Law("exponential_spring", "exponential stiffness",
        force="force_n*(exp(e/e0_m) - 1.0 - e/e0_m)",
        kin=("asymmetric stiffness", "hardening", "polynomial stiffness")),
    Law("cusp", "cusp", force="force_n*copysign(abs(e/e0_m)**0.5, e)",
        kin=("softening", "polynomial stiffness", "hardening")),
    Law("sine_squared", "periodic force", force="force_n*sin(3.141592653589793*e/length_m)**2",
        kin=("asymmetric stiffness",)),
    Law("cogging", "periodic force", force="force_n*sin(6.283185307179586*e/length_m)",
        kin=("softening", "hardening", "polynomial stiffness")),
    Law("magnet", "magnetic force", force="-km*e/(1.0 + (e/h_m)**2)**2.5",
        kin=("softening", "hardening", "polynomial stiffness")),
    Law("shallow_truss", "geometric stiffness",
        force="kt*e*(1.0 - rest_m/sqrt(e*e + height_m*height_m))",
        kin=("hardening", "polynomial stiffness")),
    Law("slack_cable", "slack", force="-ks*max(e - slack_m, 0.0)",
        kin=("asymmetric stiffness", "softening")),
    Law("stiffness_relaxation", "ageing", force="-dk*e*(1.0 - exp(-T/tau_s))",
        kin=("time-varying", "linear stiffness")),
    Law("missing_link", "missing element", "structure", kin=("linear stiffness",)),
)  # fmt: skip

BODIES = (
    Law("nonlinear_absorber", "hidden nonlinear body", "node", force="k3*e**3 + c*v",
        kin=("extra degree of freedom", "linear mass")),
    Law("rolling_body", "hidden nonlinear body", "node",
        force="k*e/sqrt(1.0 + (e/track_m)**2) + c*v", inertia=0.5,
        kin=("extra degree of freedom", "linear mass")),
)  # fmt: skip

OUTSIDE = (*HYSTERESIS, *FRICTION, *DAMPING, *STIFFNESS, *BODIES)

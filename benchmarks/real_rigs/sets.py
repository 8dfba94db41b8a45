"""Table of the measured rigs: what each is, what is known of it, and what is held out."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

from . import loaders
from .pieces import Pieces

ROOT = Path(__file__).parents[2]
MODELS = Path(__file__).parent / "models"
TUTORIALS = ROOT / "docs/tutorials"

FRICTION = frozenset({"friction"})
SINE = frozenset({"pendulum_sine"})
OFFSETS = frozenset({"input_bias", "sensor_bias"})


@dataclasses.dataclass(frozen=True)
class RealSet:
    """One measured rig, and how its records are used.

    Parameters
    ----------
    name, title
        Short name for the command line, and what was measured.
    source
        Where the records are from, and their licence.
    model
        Model file that describes the rig before anything is learnt.
    load
        Folder of the measurements → pieces.
    split
        What is learnt from and what is held out, in words.
    known
        The known answer, in words.
    needed
        Kinds or families of effects, one group for each thing that is missing; a group is found
        where one of it is named. Empty where nothing is missing.
    allowed
        Kinds or families that may be named besides.
    reference
        What the source says of errors, in words; they are rarely of this hold-out.
    same_as
        Set of the same records, but for a channel of zeros or a known force: the other tools
        are not run again.
    law
        Terms of the known law (`peers.laws.NAMES`, ``gain``, ``offset``), where it is made of
        such terms: it is fitted for comparison.
    reference_nrmse
        Error of the same kind on the same hold-out, where the source gives one [1].
    """

    name: str
    title: str
    source: str
    model: Path
    load: Callable[[Path], Pieces]
    split: str
    known: str
    needed: tuple[frozenset[str], ...]
    allowed: frozenset[str] = OFFSETS
    reference: str = ""
    reference_nrmse: float | None = None
    same_as: str | None = None
    law: tuple[str, ...] = ()

    @property
    def imposed(self) -> bool:
        """Whether motion was imposed and force measured: the force is then judged."""
        return self.model.stem in IMPOSED


IMPOSED = frozenset({"mr_damper", "rub", "rub_beside_spring"})
"""Models whose inertia is negligible: motion is imposed on them."""

EMPS_SOURCE = (
    "A. Janot, M. Gautier, M. Brunot 2019, nonlinearbenchmark.org; licence of the data not "
    "verified"
)
SILVERBOX_SOURCE = (
    "T. Wigren, J. Schoukens 2013, nonlinearbenchmark.org; licence of the data not verified"
)
SILVERBOX_KNOWN = "a cubic spring; k3/b = 3.87 in the model's units"
DISC_SOURCE = (
    "Sven-vandenBergh/M24-25-Lab-OSC-data @ a37e45bb, no licence stated; measured by students"
)
DAMPER_SOURCE = "labcontrol-data/mr-damper @ e42439f0, doi 10.5281/zenodo.4445334, MIT"
DAMPER_NEEDED = (
    frozenset(
        {
            "friction_in_series_with_spring",
            "dahl",
            "friction_with_play",
            "lugre",
            "bouc_wen",
            "bouc_wen_general",
            "bouc_wen_degrading",
            "bouc_wen_pinching",
        }
    ),
)
ARM_SOURCE = "dynamicslab/MultiArm-Pendulum @ e99a7e13, arXiv 2205.06231, MIT"
WHEEL_SOURCE = "moorepants/resonance @ f7f85508, MIT"
ARM_ALLOWED = OFFSETS | {"drag", "viscous_damping"}
EMPS_LAW = ("1", "v{0}", "sign(v{0})", "gain")
CUBIC_LAW = ("e{0}", "v{0}", "e{0}^3", "gain", "offset")
DISC_LAW = ("1", "e{0}", "v{0}", "e{0}^3", "sign(v{0})")
ARM_LAW = ("1", "sin(e{0})", "v{0}", "|v{0}|v{0}", "sign(v{0})")
CASES = "an anonymous record among the project's shared cases; kept out of the repository"

SETS: tuple[RealSet, ...] = (
    RealSet(
        "emps",
        "Linear drive with friction, in closed loop",
        EMPS_SOURCE,
        TUTORIALS / "emps.yaml",
        loaders.emps,
        "learns from the tracking run; the run with pulses of force is held out",
        "dry friction of 20.39 N and an offset of 3.165 N beside M = 95.1 kg, Fv = 203.5 N s/m",
        (FRICTION, frozenset({"input_bias"})),
        reference="the published model leaves 4.3 % of the force (no free run)",
        law=EMPS_LAW,
    ),
    RealSet(
        "silverbox",
        "Silverbox: an electronic oscillator, extrapolating",
        SILVERBOX_SOURCE,
        TUTORIALS / "silverbox.yaml",
        loaders.silverbox,
        "learns from 15.5 s of multisines; the noise of growing amplitude is held out",
        SILVERBOX_KNOWN,
        (frozenset({"cubic_hardening"}),),
        reference="free run of the fitted cubic law: 2.5 mV, 4.7 %; linear: 13.4 mV, 25 %",
        reference_nrmse=2.5e-3 / 0.0529,
        law=CUBIC_LAW,
    ),
    RealSet(
        "silverbox_both",
        "Silverbox, learning from both kinds of excitation",
        SILVERBOX_SOURCE,
        TUTORIALS / "silverbox.yaml",
        loaders.silverbox_both,
        "learns from 10 s of each; louder noise and another multisine are held out",
        SILVERBOX_KNOWN,
        (frozenset({"cubic_hardening"}),),
        law=CUBIC_LAW,
    ),
    RealSet(
        "disc_free",
        "Torsion disc between two springs, free decay",
        DISC_SOURCE,
        MODELS / "torsion_disc.yaml",
        loaders.disc_free,
        "learns from two decays; a third is held out",
        "dry friction of 2.1 1/s² (a decay in a straight line); slight hardening of 0.08–0.10",
        (FRICTION,),
        OFFSETS | {"hardening", "viscous_damping"},
        "fitted to runs 9 and 10 themselves, friction alone leaves 5 %, with hardening 2–3 %, "
        "viscous damping alone 10–11 %",
        law=DISC_LAW,
    ),
    RealSet(
        "disc_free_zeros",
        "The same, with a torque of zero declared as input",
        DISC_SOURCE,
        MODELS / "torsion_disc_input.yaml",
        loaders.disc_free_zeros,
        "learns from two decays; a third is held out",
        "as above",
        (FRICTION,),
        OFFSETS | {"hardening", "viscous_damping"},
        "as above",
        same_as="disc_free",
    ),
    RealSet(
        "disc_magnet",
        "Torsion disc with a magnet beside it, free decay",
        DISC_SOURCE,
        MODELS / "torsion_disc.yaml",
        loaders.disc_magnet,
        "learns from two decays; a third is held out",
        "dry friction of 1.4 1/s² and viscous damping of 0.17 1/s together",
        (FRICTION,),
        OFFSETS | {"hardening", "viscous_damping"},
        law=DISC_LAW,
    ),
    RealSet(
        "disc_driven",
        "Torsion disc driven through one of its springs",
        DISC_SOURCE,
        MODELS / "torsion_disc_input.yaml",
        loaders.disc_driven,
        "learns from three speeds of the motor; two others are held out; means taken off",
        "dry friction of 1.1–1.8 1/s²; the gain on the driver's angle is half of ω0², 8.9–10.0",
        (FRICTION,),
        OFFSETS | {"hardening", "viscous_damping", "input_gain"},
        "fits of the force reach R² of 0.992–0.9995",
        law=(*DISC_LAW, "gain"),
    ),
    RealSet(
        "damper_off",
        "Magneto-rheological damper without current",
        DAMPER_SOURCE,
        MODELS / "mr_damper.yaml",
        loaders.damper_off,
        "learns from the first 7.5 s; the other half is held out",
        "hysteretic friction (Dahl): Kx = 0.802 N s/mm, Kw = 50.2 N, reached within 1/42.7 cm",
        DAMPER_NEEDED,
        reference="best fitted Dahl law R² 0.969, so 17.6 % of the force",
        reference_nrmse=0.176,
    ),
    RealSet(
        "damper_slow",
        "Magneto-rheological damper at 0.88 V, slow and wide",
        DAMPER_SOURCE,
        MODELS / "mr_damper.yaml",
        loaders.damper_slow,
        "learns from the first 7.5 s; the other half is held out",
        "hysteretic friction (Dahl): Kx = 1.314 N s/mm, Kw = 209.7 N, reached within 1/20.4 cm",
        DAMPER_NEEDED,
        reference="best fitted Dahl law R² 0.982, so 13.4 % of the force",
        reference_nrmse=0.134,
    ),
    RealSet(
        "damper_on",
        "Magneto-rheological damper at 0.88 V",
        DAMPER_SOURCE,
        MODELS / "mr_damper.yaml",
        loaders.damper_on,
        "learns from the first 7.5 s; the other half is held out",
        "hysteretic friction (Dahl): Kx = 1.314 N s/mm, Kw = 209.7 N, reached within 1/20.4 cm",
        DAMPER_NEEDED,
        reference="best fitted Dahl law R² 0.987, so 11.4 % of the force",
        reference_nrmse=0.114,
    ),
    RealSet(
        "pendulum",
        "Rigid arm on a bearing, free swing from 93°",
        ARM_SOURCE,
        MODELS / "pendulum_arm.yaml",
        loaders.pendulum,
        "learns from 0–12 s and 40–52 s; 20–32 s are held out",
        "the sine of the angle, and dry friction of 0.205 1/s² that the published model lacks",
        (SINE, FRICTION),
        ARM_ALLOWED,
        "over parts that they were fitted to, sine, friction and quadratic drag leave "
        "0.12–0.31 %, sine and viscous 0.33–1.4 %",
        law=ARM_LAW,
    ),
    RealSet(
        "pendulum_zeros",
        "The same, with a torque of zero declared as input",
        ARM_SOURCE,
        MODELS / "pendulum_arm_input.yaml",
        loaders.pendulum_zeros,
        "learns from 0–12 s and 40–52 s; 20–32 s are held out",
        "as above",
        (SINE, FRICTION),
        ARM_ALLOWED,
        "as above",
        same_as="pendulum",
    ),
    RealSet(
        "pendulum_end",
        "The same, until the arm sticks",
        ARM_SOURCE,
        MODELS / "pendulum_arm.yaml",
        loaders.pendulum_end,
        "learns as above; the last 4° of another swing, and the standstill, are held out",
        "the sine of the angle, and dry friction in which the arm sticks",
        (SINE, FRICTION),
        ARM_ALLOWED,
        law=ARM_LAW,
    ),
    RealSet(
        "ship",
        "Roll decay of a tanker model in a basin",
        "martinlarsalbert/Prediction-of-roll-motion… @ cce8abde, Mendeley Data "
        "10.17632/2stvkyngj9.1, MIT",
        MODELS / "ship_roll.yaml",
        loaders.ship,
        "learns from the first and the last third; the middle one is held out",
        "damping that grows with amplitude above a linear floor (linear and quadratic)",
        (frozenset({"drag", "damping by elongation"}),),
        OFFSETS | {"viscous_damping"},
        law=("e{0}", "v{0}", "|v{0}|v{0}"),
    ),
    RealSet(
        "wheel_radial",
        "Bicycle wheel on a torsion rod",
        WHEEL_SOURCE,
        MODELS / "wheel_radial.yaml",
        loaders.wheel_radial,
        "learns from the first 1.2 s; the last 0.8 s are held out",
        "nothing is missing; inertia 0.0526 kg m²",
        (),
        reference="a linear fit of the whole record leaves 0.5 %",
        law=("e{0}", "v{0}"),
    ),
    RealSet(
        "wheel_axial",
        "Bicycle wheel swinging on a pivot",
        WHEEL_SOURCE,
        MODELS / "wheel_axial.yaml",
        loaders.wheel_axial,
        "learns from the first 3 s; the last 1.6 s are held out",
        "nothing of the wheel is missing; the gyro is off by −0.031 rad/s",
        (),
        reference="a linear fit of the whole record leaves 1.8 %",
        law=("e{0}", "v{0}", "offset"),
    ),
    RealSet(
        "frame",
        "Three-storey aluminium frame, from its drawing",
        "Digital-Twin-Operational-Platform/Cristallo @ b2a75a57, BSD-3-Clause",
        MODELS / "three_storey.yaml",
        loaders.frame,
        "learns from pulses on floors 1 and 3; a pulse on floor 2 is held out. Pulse responses "
        "are inverse FFTs of the published frequency responses, 1–64 Hz",
        "nothing is missing; storeys of 34, 38, 43 kN/m are softer than the drawing's 52.5",
        (),
    ),
    RealSet(
        "tower",
        "Five-storey steel tower with a mass damper, full size",
        "eunchurn/system-identification-unison-tower-matlab @ a0655e63, no licence stated",
        MODELS / "unison_tower.yaml",
        loaders.tower,
        "learns from two minutes of one record; two of the other are held out, at 25 Hz",
        "nothing known is missing; 0.52, 1.76, 2.9, 4.2, 5.4 Hz; coherence of only 0.5–0.9",
        (),
    ),
    RealSet(
        "loop",
        "Benchmark of hysteresis",
        CASES,
        MODELS / "loop.yaml",
        loaders.loop,
        "learns from 8 s; another excitation is held out",
        "hysteresis (Bouc–Wen, n = 1) with β = 800, γ = −1100 1/m, kh = 5e4 N/m",
        (frozenset({"hysteresis"}),),
        reference="a Bouc–Wen law with both signs leaves 0.03 %",
    ),
    RealSet(
        "rub",
        "Displacement imposed on a band that rubs",
        CASES,
        MODELS / "rub.yaml",
        loaders.rub,
        "learns from the first 19 s; the last 9 s are held out",
        "dry friction with play, plateau of 2 N",
        (frozenset({"friction_with_play"}),),
    ),
    RealSet(
        "rub_beside_spring",
        "The same beside a spring of 3 N/m",
        CASES,
        MODELS / "rub_beside_spring.yaml",
        loaders.rub_beside_spring,
        "learns from the first 19 s; the last 9 s are held out",
        "dry friction with play, plateau of 2 N",
        (frozenset({"friction_with_play"}),),
        same_as="rub",
    ),
    RealSet(
        "mount",
        "A store on a shaken rail",
        CASES,
        MODELS / "mount.yaml",
        loaders.mount,
        "learns from two levels; a level between them is held out",
        "clearance with friction, or unknown",
        (frozenset({"gap_symmetric", "gap_one_sided", "friction", "unknown"}),),
        OFFSETS | {"hardening", "softening", "friction", "asymmetric stiffness"},
    ),
    RealSet(
        "swing",
        "Slow pendulum, free swing from 56°",
        CASES,
        MODELS / "swing.yaml",
        loaders.swing,
        "learns from the first 20 s; the last 10 s are held out",
        "the sine of the angle; viscous against quadratic drag is undecided",
        (SINE,),
        ARM_ALLOWED,
        law=("1", "sin(e{0})", "v{0}", "|v{0}|v{0}"),
    ),
    RealSet(
        "swing_zeros",
        "The same, with a torque of zero declared as input",
        CASES,
        MODELS / "swing_input.yaml",
        loaders.swing_zeros,
        "learns from the first 20 s; the last 10 s are held out",
        "as above",
        (SINE,),
        ARM_ALLOWED,
        same_as="swing",
    ),
)
"""Every set, in the order of the page."""


def chosen(names: tuple[str, ...]) -> tuple[RealSet, ...]:
    """Return the sets of these names, or all.

    Raises
    ------
    ValueError
        Where a name is not that of a set.
    """
    known = {one.name: one for one in SETS}
    wrong = sorted(set(names) - set(known))
    if wrong:
        raise ValueError(f"There is no set {', '.join(wrong)}. Sets: {', '.join(known)}.")
    return tuple(one for one in SETS if not names or one.name in names)

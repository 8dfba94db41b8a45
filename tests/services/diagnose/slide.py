"""A slide with a spring that grows stiffer, and what is believed of it."""

import dataclasses
from typing import Any

import numpy as np

from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Gap,
    GapStep,
    NamedEffect,
    Number,
    Rival,
    Spectra,
    Surface,
    Suspect,
    Traces,
    When,
)
from slowtime.discrepancy.quoting import sentence_of
from slowtime.discrepancy.report.notes import HURRIED, NOT_HELD_OUT
from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring, Tolerance
from slowtime.dynamics.effects import Effect, Place
from slowtime.dynamics.effects.effect_catalogue import catalogue
from slowtime_services.diagnose import Source
from slowtime_services.files import Record
from slowtime_services.models import run_model

RATE_HZ, SAMPLES = 50.0, 600
CUBIC: dict[str, Any] = {"effect": "cubic_hardening", "element": "j", "k3_n_per_m3": 2e5}
SLIDE = Description(
    name="slide",
    nodes=(Node(id="m", mass_kg=2.0),),
    elements=(
        Spring(
            id="j",
            between=("base", "m"),
            stiffness_n_per_m=800.0,
            damping_n_s_per_m=1.6,
        ),
    ),
    inputs=(Input(channel="u", kind="force", node="m", unit="N"),),
    sensors=(
        Sensor(
            channel="x",
            quantity="displacement",
            node="m",
            frame="relative_to_base",
            unit="m",
        ),
        Sensor(channel="a", quantity="acceleration", node="m", unit="m/s^2"),
    ),
    tolerance=Tolerance(stiffness=0.02, damping=0.15),
)


def arrays_of(slide: Description, seed: int, effects=(CUBIC,)) -> dict[str, np.ndarray]:
    """Channels of a record of the slide as it is."""
    rng = np.random.default_rng(seed)
    lines = np.fft.rfftfreq(SAMPLES, 1 / RATE_HZ)
    inside = (lines > 0.5) & (lines < 8.0)
    push = np.fft.irfft(inside * np.exp(2j * np.pi * rng.random(len(lines))))
    push *= 10.0 / push.std()
    truth = dataclasses.replace(slide, effects=effects)
    heard = run_model(truth, {"u": push}, RATE_HZ, hold="band_limited")
    noise = {"x": 3e-5, "a": 0.02}
    told = {c: s + noise[c] * rng.standard_normal(SAMPLES) for c, s in heard.items()}
    return {"u": push} | told


def source_of(arrays: dict[str, np.ndarray], name: str = "r.npz", **more) -> Source:
    """A record of some channels, under a name."""
    settings: dict[str, Any] = {"rate_hz": RATE_HZ, "units": ("",) * len(arrays)} | more
    samples = np.stack(list(arrays.values()), axis=1)
    return Source(name, Record(samples=samples, channels=tuple(arrays), **settings))


def told() -> Diagnosis:
    """A diagnosis of the slide as one would come out."""
    named = {"k3_n_per_m3": Number(1.99e5, 300.0, "N/m^3")}
    effect = Effect("cubic_hardening", Place("element", "j"), {"k3_n_per_m3": 1.99e5})
    sentence = sentence_of(catalogue()[effect.kind], effect.place, named)
    augmented = dataclasses.replace(SLIDE, effects=(effect.entry(),))
    measured = np.sin(np.arange(2.0 * SAMPLES))[:, None] * [1e-2, 1.0]
    traces = Traces(
        times_s=30.0 + np.arange(2 * SAMPLES) / RATE_HZ,
        measured=measured,
        nominal=0.5 * measured,
        refitted=0.8 * measured,
        augmented=0.99 * measured,
    )
    lines = np.linspace(0.0, RATE_HZ / 2, 40)
    flat = np.ones((40, 2))
    return Diagnosis(
        verdict="missing_effect",
        sentence=sentence,
        effects=(
            NamedEffect(
                effect=effect,
                family="hardening",
                numbers=named,
                probability=0.98,
                rivals=(Rival("gap_symmetric", Place("element", "j"), 0.02),),
                sentence=sentence,
            ),
        ),
        undecided=(),
        experiment=None,
        nothing_probability=0.0,
        moved={"stiffness j": Number(850.0, 1.0, "N/m")},
        where=(Suspect(Place("element", "j"), 400.0, 0.0, 0.97),),
        when=When(
            ((1.0, 2.0),),
            ((0.5, 4.0),),
            "The force acts at an elongation of 0.01 m rms, 0.02 m at most.",
            linear=False,
            steady=True,
        ),
        findings=(Finding(fault="stuck", channel="a", spans_s=((1.0, 2.0),), share=0.1),),
        gap=Gap(
            nominal=0.5,
            refitted_nominal=0.2,
            steps=(GapStep("cubic_hardening", Place("element", "j"), 0.01),),
            augmented=0.01,
            noise_floor=0.009,
            on="holdout",
            worst=0.011,
        ),
        chi2_per_datum=1.02,
        residual_white=True,
        white_p_value=0.3,
        nominal=SLIDE,
        refitted=SLIDE,
        augmented=augmented,
        traces=(traces,),
        spectra=Spectra(lines, flat, 0.1 * flat, 0.01 * flat, 0.01 * flat),
        surface=Surface(
            place=Place("element", "j"),
            e=measured[:, 0],
            v=measured[:, 1],
            force=measured[:, 0] ** 3,
            law=measured[:, 0] ** 3,
        ),
        notes=(HURRIED, NOT_HELD_OUT),
        seconds=2.5,
    )

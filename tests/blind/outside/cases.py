"""A battery of laws that are in no list, one a case, on rigs of one to three masses."""

import dataclasses

import numpy as np

from tests.blind import cases as hidden
from tests.blind.cases import Case
from tests.blind.design import Design, draw_design
from tests.blind.laws import UNLISTED
from tests.blind.running import Drawn
from tests.blind.world import World

LEAST_DB = 10.0
"""[dB] Effect-to-noise that every case has at least: the law is there to be seen."""
NUDGE = 1e-5
"""[share of all stiffnesses] By which two runs differ that tell whether a motion is chaotic."""


def draw(count: int, seed: int) -> list[Drawn]:
    """Give name, design and seed of each case; more cases begin with the same ones."""
    order, drawn = np.random.default_rng([seed, 41]), []
    deck: list[str] = []
    for number in range(count):
        if not deck:
            deck = order.permutation(UNLISTED).tolist()
        rng = np.random.default_rng([seed, 42, number])
        design = redraw("outside", (deck.pop(),), rng)
        drawn.append((f"{rng.integers(2**32):08x}", design, int(rng.integers(2**62))))
    return drawn


def redraw(group: str, kinds: tuple[str, ...], rng: np.random.Generator) -> Design:
    """Draw a design of up to three masses, its effect well above the noise."""
    size = 6
    while size > 3:
        design = draw_design(group, kinds, rng)
        size = design.size
    snr = int(rng.choice([30, 40]))
    target = float(rng.uniform(14.0, {30: 24.0, 40: 32.0}[snr]))
    return dataclasses.replace(design, snr_db=snr, target_db=target, least_db=LEAST_DB)


def build(name: str, design: Design, seed: int) -> Case:
    """Build a case, and find out whether its held-out record can be foretold at all."""
    case = hidden.build(name, design, seed, redraw)
    truth = case.truth | {"predictable": not _is_chaotic(case)}
    return dataclasses.replace(case, truth=truth)


def _is_chaotic(case: Case) -> bool:
    """Whether a nudge of the stiffnesses moves the held-out record by more than its noise."""
    world: World = case.world
    count = len(world.rig.elements)
    rig = world.rig.scaled([1.0 + NUDGE] * count, [1.0] * count)
    nudged = dataclasses.replace(world, rig=rig).take(case.plans[case.held], noiseless=True)
    kept = case.taken[case.held]
    moved = np.sqrt(np.mean((nudged.clean - kept.clean) ** 2, axis=0)) / kept.seen.noise
    return bool(moved.max() > 1.0)

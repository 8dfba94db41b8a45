"""Stable poles of pLSCF models of many orders: starting values of the modes."""

import dataclasses

import numpy as np

from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.stabilisation import StablePole, find_stable_poles

BIAS = 0.05
"""[decay rates of the pole] Allowance for the bias of equation errors, which differs from order
to order; measured on simulated structures it stays below half of this from twice the true
order on."""


def stable_poles(poles: Poles, *, low_hz: float, high_hz: float) -> list[StablePole]:
    """Poles that stay over the orders, apart from noise and bias."""
    size = BIAS * np.abs(poles.pole.real) * np.sqrt(len(poles.draws) + 2)
    draws = np.concatenate([poles.draws, size[None], 1j * size[None]])
    wider = dataclasses.replace(poles, draws=draws)
    return find_stable_poles(wider, low_hz=low_hz, high_hz=high_hz)

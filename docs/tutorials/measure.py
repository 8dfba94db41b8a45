"""Measure on a mount that has what the model lacks: `learn.npz` and `judge.npz`."""

from typing import Any

import numpy as np

from slowtime_services.models import read_description, run_model
from slowtime_services.plugins.effect_kinds import known

RATE_HZ, SAMPLES = 100.0, 2000

kinds = known(["maxwell_branch.py"])
truth = read_description("truth.yaml", kinds)
rng = np.random.default_rng(1)
for name in ("learn", "judge"):
    lines = np.fft.rfftfreq(SAMPLES, 1 / RATE_HZ)
    inside = (lines > 0.5) & (lines < 25.0)
    push = np.fft.irfft(inside * np.exp(2j * np.pi * rng.random(len(lines))))
    push *= 100.0 / push.std()
    heard = run_model(truth, {"force": push}, RATE_HZ, hold="band_limited", kinds=kinds)
    for sensor in truth.sensors:
        noise = (sensor.noise_sd or 0.0) * rng.standard_normal(SAMPLES)
        heard[sensor.channel] = heard[sensor.channel] + noise
    arrays: Any = {"rate_hz": RATE_HZ, "force": push, **heard}
    np.savez(f"{name}.npz", **arrays)

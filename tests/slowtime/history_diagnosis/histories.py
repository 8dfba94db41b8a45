"""Hidden histories: one truth each, made without any code of what is to find it.

Wandering comes from the Cholesky factor of a dense covariance matrix, thermal lag from small
Euler steps, sawteeth from a loop: nothing is shared with the package.
"""

import dataclasses

import numpy as np

LATER_SHARE = 0.25
KINDS = (
    "temperature_linear",
    "temperature_bilinear",
    "load_linear",
    "step",
    "drift_linear",
    "drift_exponential",
    "drift_power",
    "sawtooth",
    "periodic",
    "amplitude_dependence",
)
SENSORS = ("sensor_noise", "mode_swap")
PAIRS = (
    ("temperature_linear", "step"),
    ("temperature_bilinear", "drift_linear"),
    ("load_linear", "sawtooth"),
    ("amplitude_dependence", "step"),
    ("temperature_linear", "load_linear"),
)


@dataclasses.dataclass(frozen=True)
class Case:
    """Readings with a truth; those from `split` on were not there yet when it was asked for."""

    truth: tuple[str, ...]
    facts: dict[str, float]
    time: np.ndarray
    value: np.ndarray
    sd: np.ndarray
    covariates: dict[str, tuple[str, np.ndarray]]
    split: int


def hidden(truth: tuple[str, ...], rng: np.random.Generator, epochs: int | None = None) -> Case:
    """One case: a truth, dressed in wandering, noise, outliers, gaps and misstated errors."""
    count = epochs or int(rng.integers(160, 700))
    pace = rng.choice([0.25, 1.0, 1.0, 2.0])
    time = 40.0 + pace * np.cumsum(rng.uniform(0.3, 1.7, count))
    for _ in range(rng.integers(0, 3)):
        first = rng.integers(10, count - 10)
        time[first:] += rng.uniform(0.02, 0.10) * (time[-1] - time[0])
    split = int(count * (1.0 - LATER_SHARE))
    past = time <= time[split - 1]
    covariates = _covariates(truth, time, past, rng)
    base = 10.0 ** rng.uniform(-4.0, -2.0)
    stated = base * np.exp(rng.normal(0.0, 0.25, count))
    noise = rng.uniform(1 / 1.5, 1.5) * stated
    value = _noise(noise, rng)
    if rng.uniform() < 0.75:
        wander_sd = rng.uniform(0.3, 1.2) * np.median(noise)
        value = value + wander_sd * _wander(time, rng)
    facts: dict[str, float] = {"noise": float(np.median(noise))}
    for name in truth:
        size = rng.uniform(2.0, 7.0) * np.median(noise)
        value = _add(name, value, size, time, past, covariates, noise, facts, rng)
    value = value + rng.normal(0.0, 5.0) * base
    if rng.uniform() < 0.6:
        wild = rng.choice(count, max(1, int(rng.uniform(0.0, 0.03) * count)), replace=False)
        value[wild] += (
            rng.choice([-1.0, 1.0], len(wild)) * rng.uniform(6, 20, len(wild)) * noise[wild]
        )
    for _, series in covariates.values():
        if rng.uniform() < 0.4:
            first = rng.integers(0, count - count // 15)
            series[first : first + count // 20] = np.nan
    return Case(truth, facts, time, value, stated, covariates, split)


def _covariates(truth, time, past, rng):
    count = len(time)
    found = {}
    if rng.uniform() < 0.8 or any("temperature" in name for name in truth):
        season = rng.uniform(6, 12) * np.cos(2 * np.pi * (time - rng.uniform(0, 365)) / 365.25)
        day = rng.uniform(0, 4) * np.cos(2 * np.pi * time)
        weather = rng.uniform(2.5, 5.0) * _fading(time, rng.uniform(1.5, 6.0), rng)
        temperature = season + day + weather
        found["air temperature"] = (
            "°C",
            temperature - np.quantile(temperature[past], rng.uniform(0.25, 0.6)),
        )
    if rng.uniform() < 0.5 or any("load" in name for name in truth):
        found["load"] = (
            "t",
            np.abs(rng.uniform(5, 40) + 8 * _fading(time, 2.0, rng) + rng.normal(0, 4, count)),
        )
    if rng.uniform() < 0.5 or any("amplitude" in name for name in truth):
        found["vibration level"] = (
            "mm/s",
            np.exp(rng.normal(0.0, rng.uniform(0.3, 0.55), count)),
        )
    return found


def _add(name, value, size, time, past, covariates, noise, facts, rng):
    unit = (time - time[past][0]) / (time[past][-1] - time[past][0])
    sign = rng.choice([-1.0, 1.0])
    if name in ("temperature_linear", "temperature_bilinear"):
        temperature = covariates["air temperature"][1]
        if rng.uniform() < 0.3:
            facts["lag"] = float(rng.uniform(2.0, 6.0) * np.median(np.diff(time)))
            temperature = _inertia(time, temperature, facts["lag"])
        shape = temperature
        if name == "temperature_bilinear":
            low, high = np.quantile(temperature[past], [0.3, 0.7])
            inside = low < 0.0 < high
            facts["kink"] = (
                0.0 if inside and rng.uniform() < 0.7 else float(rng.uniform(low, high))
            )
            ratio = rng.choice([0.0, 0.2, 3.0, 5.0, -1.0])
            above = np.maximum(temperature - facts["kink"], 0.0)
            shape = np.minimum(temperature - facts["kink"], 0.0) + ratio * above
    elif name == "load_linear":
        shape = covariates["load"][1]
    elif name == "amplitude_dependence":
        facts["exponent"] = float(rng.choice([1.0, 2.0]))
        shape = covariates["vibration level"][1] ** facts["exponent"]
    elif name == "step":
        facts["time"] = float(
            time[past][0] + rng.uniform(0.12, 0.88) * (time[past][-1] - time[past][0])
        )
        return value + sign * rng.uniform(1.0, 1.6) * size * (time >= facts["time"])
    elif name == "drift_linear":
        shape = unit
    elif name == "drift_exponential":
        facts["rate"] = float(rng.choice([-1, 1]) * rng.uniform(2.5, 5.0))
        shape = (np.exp(np.minimum(facts["rate"] * unit, 12.0)) - 1) / (
            np.exp(facts["rate"]) - 1
        )
    elif name == "drift_power":
        facts["exponent"] = float(rng.choice([0.4, 0.5, 2.0, 3.0]))
        shape = unit ** facts["exponent"]
    elif name == "sawtooth":
        shape, facts["period"] = _teeth(time, past, rng)
    elif name == "periodic":
        least = 2.5 * np.median(np.diff(time))
        span = time[past][-1] - time[past][0]
        facts["period"] = float(np.exp(rng.uniform(np.log(least), np.log(span / 2.5))))
        shape = np.cos(2 * np.pi * time / facts["period"] + rng.uniform(0, 2 * np.pi))
    elif name == "sensor_noise":
        facts["time"] = float(np.quantile(time[past], rng.uniform(0.25, 0.75)))
        louder = rng.uniform(2.0, 4.0)
        return value + (time >= facts["time"]) * np.sqrt(
            louder**2 - 1
        ) * noise * rng.standard_normal(len(time))
    elif name == "mode_swap":
        swapped = rng.uniform(size=len(time)) < rng.uniform(0.04, 0.10)
        swapped |= np.roll(swapped, 1) & (rng.uniform(size=len(time)) < 0.5)
        return value + sign * rng.uniform(25, 60) * np.median(noise) * swapped
    facts["slope"] = float(sign * size / np.std(shape[past]))
    return value + facts["slope"] * shape


def _teeth(time, past, rng):
    span = time[past][-1] - time[past][0]
    period = span / rng.uniform(2.2, 9.0)
    level, last, out = 0.0, time[0] - rng.uniform(0, period), []
    for now in time:
        while now - last >= period:
            last += period
        level = (now - last) / period
        out.append(level)
    return np.array(out), float(period)


def _noise(sd, rng):
    if rng.uniform() < 0.5:
        return sd * rng.standard_normal(len(sd))
    return sd * rng.standard_t(6, len(sd)) / np.sqrt(1.5)


def _fading(time, memory, rng):
    out = np.empty(len(time))
    out[0] = rng.standard_normal()
    for i in range(1, len(time)):
        kept = np.exp(-(time[i] - time[i - 1]) / memory)
        out[i] = kept * out[i - 1] + np.sqrt(1 - kept**2) * rng.standard_normal()
    return out


def _wander(time, rng):
    length = np.exp(rng.uniform(np.log(0.02), np.log(0.3))) * (time[-1] - time[0])
    apart = np.abs(np.subtract.outer(time, time)) / length
    rough = rng.choice(3)
    s = apart * np.sqrt([1.0, 3.0, 5.0][rough])
    correlation = [1.0, 1.0 + s, 1.0 + s + s * s / 3.0][rough] * np.exp(-s)
    factor = np.linalg.cholesky(correlation + 1e-8 * np.eye(len(time)))
    return factor @ rng.standard_normal(len(time))


def _inertia(time, values, lag):
    out, state = np.empty(len(time)), values[0]
    out[0] = state
    for i in range(1, len(time)):
        steps = 200
        fine = np.linspace(time[i - 1], time[i], steps + 1)
        driving = np.interp(
            0.5 * (fine[1:] + fine[:-1]), time[i - 1 : i + 1], values[i - 1 : i + 1]
        )
        for x in driving:
            state += (fine[1] - fine[0]) / lag * (x - state)
        out[i] = state
    return out

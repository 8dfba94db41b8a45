r"""Two models that the records cannot tell apart, in; the measurement that would, out.

Both are run under each of a menu of experiments. What the second could still mimic by moving
its constants and parameters within what the records allow does not count:

.. math:: \Delta = \tfrac12 \min_\delta \; |(y_1 - y_2 - S \delta) / \sigma|^2
          + \delta^T \Sigma^{-1} \delta ,

with the slopes :math:`S` and the covariance :math:`\Sigma` of the second's refit.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import scipy.linalg
import scipy.signal as sps
from jaxtyping import Float

from slowtime.dynamics.description import Description, Sensor, assemble
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.plant import Plant

from .diagnosis import Experiment
from .naming import Named
from .records import Trial
from .values import with_values

SECONDS = 12.0
"""Length of the records that are tried out."""
LEVELS = (0.25, 0.5, 2.0, 4.0)
HEAVIER = 0.2
"""Known mass to be added, over that of the node."""
CHEAP = 0.8
"""An experiment without new hardware is preferred where it parts rivals so nearly as well."""
MOST = 1e6
"""Separation beyond which models have parted for good."""


def propose(
    one: Named, other: Named, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> Experiment | None:
    """Choose what would part two rivals most; None where nothing on the menu would.

    Parameters
    ----------
    one, other
        Refitted to the same trials.
    """
    trial = max(trials, key=lambda t: float(np.sum(t.inputs.var(axis=0))))
    later = max(t.start_s + t.duration_s for t in trials)
    found = [
        dataclasses.replace(
            option,
            separation=separation(one, other, option, acted(option, trial), later, kinds),
        )
        for option in menu(one.description)
    ]
    best = max(found, key=lambda option: option.separation)
    plain = [o for o in found if not o.add_sensors and o.add_mass is None]
    easy = max(plain, key=lambda option: option.separation)
    chosen = easy if easy.separation > CHEAP * best.separation else best
    return chosen if chosen.separation > 1.0 else None


def menu(description: Description) -> list[Experiment]:
    """List experiments that the rig allows."""
    options = [
        Experiment(f"Repeat the record at {level:g} times the level.", level=level)
        for level in LEVELS
    ]
    if not description.inputs:
        return options
    frequencies = undamped_modes(assemble(description)).frequency_hz
    low, high = float(frequencies[0]), float(frequencies[-1])
    options += [
        Experiment(
            f"Shake between {0.2 * low:.3g} and {0.7 * low:.3g} Hz, below the modes.",
            band_hz=(0.2 * low, 0.7 * low), excitation="multisine",
        ),
        Experiment(
            f"Shake between {0.3 * low:.3g} and {1.6 * high:.3g} Hz.",
            band_hz=(0.3 * low, 1.6 * high), excitation="multisine",
        ),
        Experiment(
            f"Hold a sine at {low:.3g} Hz.", band_hz=(low, low), excitation="sine"
        ),
        Experiment("Strike it once and let it ring.", excitation="free_decay"),
    ]  # fmt: skip
    heard = {s.node for s in description.sensors if s.quantity == "acceleration"}
    for node in description.nodes:
        if node.id not in heard:
            options.append(
                Experiment(
                    f"Measure the acceleration of {node.id} too.", add_sensors=(node.id,)
                )
            )
        if node.mass_kg:
            mass = float(f"{HEAVIER * node.mass_kg:.2g}")
            options.append(
                Experiment(
                    f"Attach a known mass of {mass:g} kg to {node.id}.",
                    add_mass=(node.id, mass),
                )
            )
    return options


def separation(
    one: Named,
    other: Named,
    option: Experiment,
    trial: Trial,
    start_s: float,
    kinds: Mapping[str, Kind],
) -> float:
    """Give the expected gain of log evidence of either over the other, were it true.

    Parameters
    ----------
    trial
        Whose inputs act; its outputs are not looked at.
    start_s
        Campaign time of the experiment [s].
    """
    first, second = _set_up(one, option, kinds), _set_up(other, option, kinds)
    names, rate_hz = other.fit.prior.names, trial.rate_hz
    with np.errstate(all="ignore"):
        seen = first.simulate(first.values, trial.inputs, rate_hz, start_s=start_s)
        told, slopes = second.sensitivities(
            second.values, trial.inputs, rate_hz, names, start_s=start_s
        )
    if not np.isfinite(seen).all() or not np.isfinite(slopes).all():
        return 0.0
    noise = other.fit.noise.sd(0, rate_hz)
    extra = seen.shape[1] - len(noise)
    # A sensor that is not there yet is taken to be as good as the worst of its neighbours.
    relative = float(np.max(noise / np.maximum(told[:, : len(noise)].std(axis=0), 1e-300)))
    more = min(relative, 0.1) * told[:, len(noise) :].std(axis=0) if extra else np.zeros(0)
    scale = np.concatenate([noise, more])
    apart = ((seen - told) / scale).ravel()
    turned = (slopes[:, :, : len(names)] / scale[:, None]).reshape(len(apart), -1)
    known = scipy.linalg.pinvh(other.fit.covariance)
    matrix, right = turned.T @ turned + known, turned.T @ apart
    size = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    inner = matrix * np.outer(size, size) + 1e-10 * np.eye(len(matrix))
    mimic = float(right @ (size * scipy.linalg.solve(inner, size * right, assume_a="pos")))
    return float(np.clip((apart @ apart - mimic) / 2, 0.0, MOST))


def _set_up(named: Named, option: Experiment, kinds: Mapping[str, Kind]) -> Plant:
    """Model of a rival on the rig as the experiment changes it."""
    values = dict(zip(named.fit.plant.parameters, named.fit.values.tolist(), strict=True))
    if option.add_mass is not None:
        node, mass = option.add_mass
        values["mass", node] += mass
    added = tuple(
        Sensor(
            channel=f"added {node}", quantity="acceleration", node=node,
            frame="absolute", unit=_unit(named.description),
        )
        for node in option.add_sensors
    )  # fmt: skip
    description = with_values(named.description, values)
    description = dataclasses.replace(description, sensors=(*description.sensors, *added))
    return Plant.of(description, kinds=kinds)


def _unit(description: Description) -> str:
    return "rad/s^2" if description.unit_of_coordinate == "rad" else "m/s^2"


def acted(option: Experiment, trial: Trial) -> Trial:
    """Give the inputs of an experiment, of the size of those that were measured."""
    count = min(len(trial.inputs), int(SECONDS * trial.rate_hz))
    inputs = trial.inputs[:count] * option.level
    if option.excitation is not None:
        times = np.arange(count) / trial.rate_hz
        inputs = np.outer(_form(option, times), trial.inputs.std(axis=0))
    return Trial(
        inputs=inputs, outputs=np.zeros_like(trial.outputs[:count]), rate_hz=trial.rate_hz
    )


def _form(option: Experiment, times: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """Shape of an excitation, of unit size."""
    if option.excitation == "free_decay":
        length = max(len(times) // 200, 3)
        pulse = np.zeros(len(times))
        pulse[:length] = 20.0 * sps.get_window("hann", length, fftbins=False)
        return pulse
    assert option.band_hz is not None
    low, high = option.band_hz
    if option.excitation == "sine":
        return np.asarray(np.sqrt(2.0) * np.sin(2 * np.pi * low * times))
    lines = np.array(list(_lines(low, high, float(times[-1]))))
    # Schroeder's phases: no crest stands out, and nothing is left to chance.
    phases = -np.pi * np.arange(len(lines)) ** 2 / len(lines)
    waves = np.cos(2 * np.pi * np.multiply.outer(times, lines) + phases)
    return np.asarray(waves.sum(axis=1) * np.sqrt(2.0 / len(lines)))


def _lines(low: float, high: float, seconds: float) -> Iterable[float]:
    first = max(int(np.ceil(low * seconds)), 1)
    last = max(int(np.floor(high * seconds)), first)
    return (k / seconds for k in range(first, last + 1))

r"""A structure under forces that nobody measures, as a linear model driven by white noise.

In modal coordinates :math:`\ddot q + \Phi^T C \Phi\, \dot q + \Omega^2 q = \sum_l b_l p_l`
with two latent forces of each mode: a slow one, :math:`\dot p = -c p + \sqrt{2 c}\, w` with its
corner at the lower edge of the band, and a fast one, white noise after a Butterworth filter of
third order with the corner at 0.3 of the sampling rate. Their covariances are fitted. Motion
of the base, and forces that a channel measures, are latent forces too. Outputs pass a high-pass
of second order, whose states belong to the model, so that their error is that of the band that
is told.

References
----------
.. [1] E. Lourens et al., "An augmented Kalman filter for force identification in structural
   dynamics", Mech. Syst. Signal Process. 27 (2012) 446-460.
.. [2] R. Nayek, S. Chakraborty, S. Narasimhan, "A Gaussian process latent force model for joint
   input-state estimation in linear structural systems", Mech. Syst. Signal Process. 128 (2019)
   497-530.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.dynamics.description import BASE, Description, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.units import unit_factor

from .outputs import Output
from .settings import VirtualSettings

USABLE = 0.9
"""Share of half the sampling rate up to which modes are kept [1]."""
FAST = 0.3
"""Corner of the fast latent force, as a share of the sampling rate [1]. It is of third order:
what is above half the sampling rate would be folded onto low frequencies, where sensors with an
anti-aliasing filter have nothing, and where displacements hang on little acceleration."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Latent:
    """Continuous model of one structure; states are scaled to the size of accelerations.

    Parameters
    ----------
    drift
        A of the states: modal displacements times their angular frequency squared, modal
        velocities times it, latent forces with the filters of the fast ones, and two of the
        high-pass of each output.
    driving
        Column of unit noise of each latent force.
    sensing
        Rows of the channels, in SI.
    telling
        Rows of the outputs after their high-pass, in their units.
    frequency_hz
        Of the modes that are kept.
    names
        Of the latent forces.
    """

    drift: Float[np.ndarray, "state state"]
    driving: Float[np.ndarray, "state both"]
    sensing: Float[np.ndarray, "channel state"]
    telling: Float[np.ndarray, "output state"]
    frequency_hz: Float[np.ndarray, " mode"]
    names: tuple[str, ...]
    unseen: tuple[int, ...]

    def response(
        self, frequency_hz: Float[np.ndarray, " f"]
    ) -> Complex[np.ndarray, "f channel both"]:
        """Frequency response from the driving noise of each latent force to the channels.

        Parameters
        ----------
        frequency_hz
            Frequencies [Hz].

        Returns
        -------
        Responses, in SI units.
        """
        # Not by eigenvectors, which are ill-conditioned where poles come close together.
        size = len(self.drift)
        out = np.empty((len(frequency_hz), len(self.sensing), self.driving.shape[1]), complex)
        for first in range(0, len(out), AT_ONCE):
            part = slice(first, first + AT_ONCE)
            angular = 2j * np.pi * frequency_hz[part, None, None]
            out[part] = self.sensing @ np.linalg.solve(
                angular * np.eye(size) - self.drift, self.driving.astype(complex)
            )
        return out

    def discrete(
        self, rate_hz: float, covariances: Float[np.ndarray, "2 force force"]
    ) -> tuple[Float[np.ndarray, "state state"], Float[np.ndarray, "state state"]]:
        """Transition over one sample, and the noise that it adds (Van Loan).

        Parameters
        ----------
        covariances
            Of the slow and of the fast latent forces.

        Returns
        -------
        Transition, and covariance of the process noise.
        """
        size, step = len(self.drift), 1.0 / rate_hz
        noise = sum(
            self.driving[:, k::2] @ covariance @ self.driving[:, k::2].T
            for k, covariance in enumerate(covariances)
        )
        both = np.zeros((2 * size, 2 * size))
        both[:size, :size] = -self.drift * step
        both[:size, size:] = noise * step
        both[size:, size:] = self.drift.T * step
        whole = scipy.linalg.expm(both)
        transition = whole[size:, size:].T
        added = transition @ whole[:size, size:]
        return transition, (added + added.T) / 2


def latent_model(
    description: Description,
    channels: Sequence[str],
    outputs: Sequence[Output],
    rate_hz: float,
    settings: VirtualSettings,
    *,
    lowest_hz: float,
    modes: int,
    moving_base: bool,
) -> Latent:
    """Build the model of one description.

    Parameters
    ----------
    description
        Structure.
    channels
        Sensors and inputs of the description that are listened to, in order.
    outputs
        Quantities to estimate.
    settings
        Settings of the virtual sensor.
    lowest_hz
        Lower edge of the band [Hz].
    modes
        How many are kept, the lowest.
    moving_base
        Whether the base moves; absolute accelerations hold its motion.

    Raises
    ------
    ValueError
        Where a channel is unknown or measures no acceleration, a mode has no damping, or an
        output is none of this model's.
    """
    structure = assemble(description)
    real = undamped_modes(structure)
    omega, shapes = real.angular_frequency[:modes], real.shapes[:, :modes]
    damping = shapes.T @ structure.damping @ shapes
    _check_modes(omega, damping)
    heard = [e for e in description.inputs if e.channel in channels]
    measured = [e for e in heard if e.kind in ("force", "base_acceleration")]
    base = structure.base_force(np.ones(1))[0]
    patterns = [np.eye(modes)[j] for j in range(modes)]
    names = [f"mode {j + 1}" for j in range(modes)]
    base_rows: dict[str, list[int]] = {}
    if moving_base or any(entry.kind == "base_acceleration" for entry in measured):
        patterns.append(shapes.T @ base)
        names.append(BASE)
    for entry in measured:
        if entry.kind == "force" and entry.node in structure.names:
            patterns.append(shapes[structure.dof(str(entry.node))])
            names.append(entry.channel)
    base_rows = {name: [2 * i, 2 * i + 1] for i, name in enumerate(names)}
    count = len(patterns)
    size = 2 * modes + 4 * count + 2 * len(outputs)
    drift, driving = np.zeros((size, size)), np.zeros((size, 2 * count))
    q, v = np.arange(modes), modes + np.arange(modes)
    p = 2 * modes + np.arange(2 * count)
    slow, fast = p[0::2], p[1::2]
    rate, bend = (2 * modes + (2 + k) * count + np.arange(count) for k in range(2))
    drift[q, v] = omega
    drift[v, q] = -omega
    drift[np.ix_(v, v)] = -omega[:, None] * damping / omega
    push = np.repeat(np.array(patterns).T, 2, axis=1)
    drift[np.ix_(v, p)] = omega[:, None] * push
    low, high = 2 * np.pi * lowest_hz, 2 * np.pi * FAST * rate_hz
    drift[slow, slow] = -low
    drift[fast, rate], drift[rate, bend] = high, high
    drift[bend, fast], drift[bend, rate], drift[bend, bend] = -high, -2 * high, -2 * high
    driving[slow, np.arange(0, 2 * count, 2)] = np.sqrt(2 * low)
    driving[bend, np.arange(1, 2 * count, 2)] = np.sqrt(3 * high)
    accelerations = np.zeros((modes, size))
    accelerations[:, q] = -np.eye(modes)
    accelerations[:, v] = -damping / omega
    accelerations[:, p] = push
    sensing = np.zeros((len(channels), size))
    sensors = {sensor.channel: sensor for sensor in description.sensors}
    inputs = {entry.channel: entry for entry in measured}
    for i, channel in enumerate(channels):
        if channel in inputs:
            what = BASE if inputs[channel].kind == "base_acceleration" else channel
            sensing[i, [p[k] for k in base_rows[what]]] = 1.0
            continue
        if channel not in sensors:
            raise ValueError(
                f"The model has no sensor on channel {channel!r}. Allowed: "
                f"{', '.join([*sensors, *inputs])}."
            )
        sensor = sensors[channel]
        if sensor.quantity != "acceleration":
            raise ValueError(
                f"Channel {channel!r} measures a {sensor.quantity}; a virtual sensor takes "
                "accelerations. Leave it out."
            )
        if sensor.node in structure.names:
            sensing[i] += shapes[structure.dof(sensor.node)] @ accelerations
        if sensor.frame == "absolute" and BASE in base_rows:
            sensing[i, [p[k] for k in base_rows[BASE]]] += 1.0
    telling = np.zeros((len(outputs), size))
    edge = 2 * np.pi * lowest_hz
    for i, output in enumerate(outputs):
        row = output.factor * (output.row(description) @ shapes) / omega**2
        scale = float(np.abs(row).max()) or 1.0
        h1, h2 = size - 2 * len(outputs) + 2 * i + np.arange(2)
        drift[h1, h2] = edge
        drift[h2, h1], drift[h2, h2] = -edge, -np.sqrt(2) * edge
        drift[h2, q] = edge * row / scale
        telling[i, q] = row
        telling[i, [h1, h2]] = -scale, -np.sqrt(2) * scale
    seen = np.abs(sensing[:, q]).max(axis=0) if len(channels) else np.zeros(modes)
    largest = np.abs(shapes).max(axis=0)
    return Latent(
        drift=drift,
        driving=driving,
        sensing=sensing,
        telling=telling,
        frequency_hz=omega / (2 * np.pi),
        names=tuple(f"{name} {kind}" for name in names for kind in ("slow", "fast")),
        unseen=tuple(int(j) for j in np.flatnonzero(seen < BLIND * largest)),
    )


AT_ONCE = 256
"""Frequencies whose equations are solved together: some megabytes."""
BLIND = 0.02
"""Share of the largest component of a shape that a sensor must have to see the mode [1]."""


def modes_kept(description: Description, rate_hz: float, settings: VirtualSettings) -> int:
    """Count the modes below the highest usable frequency.

    Parameters
    ----------
    description
        Structure.
    settings
        Settings, with the largest number of modes.

    Returns
    -------
    Number of modes, at least 1.

    Raises
    ------
    ValueError
        Where the lowest natural frequency is above the usable band.
    """
    frequency = undamped_modes(assemble(description)).angular_frequency / (2 * np.pi)
    kept = int((frequency < USABLE * rate_hz / 2).sum())
    if not kept:
        raise ValueError(
            f"The lowest natural frequency of the model, {frequency[0]:.4g} Hz, is above "
            f"{USABLE * rate_hz / 2:g} Hz. Sample faster, or check the units of the model."
        )
    return min(kept, settings.most_modes)


def noise_of(
    description: Description, channels: Sequence[str]
) -> Float[np.ndarray, " channel"]:
    """Look up noise of the channels (standard deviation, SI); NaN where nothing is said."""
    known = {}
    for sensor in description.sensors:
        if sensor.noise_sd is not None:
            factor = unit_factor(sensor.unit, sensor.quantity, description.unit_of_coordinate)
            known[sensor.channel] = factor * sensor.noise_sd
    return np.array([known.get(channel, np.nan) for channel in channels])


def _check_modes(
    omega: Float[np.ndarray, " mode"], damping: Float[np.ndarray, "mode mode"]
) -> None:
    for j, (angular, rate) in enumerate(zip(omega, np.diag(damping), strict=True)):
        if not (angular > 0 and rate > 0):
            raise ValueError(
                f"Mode {j + 1} of the model, at {angular / (2 * np.pi):.4g} Hz, has "
                f"{'no damping' if angular > 0 else 'no stiffness'}: its motion never dies "
                "away. Give every element stiffness and damping."
            )

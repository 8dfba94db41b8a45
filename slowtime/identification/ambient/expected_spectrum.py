"""Expected periodogram of an oscillator under white force, leakage included."""

import numpy as np
from jaxtyping import Complex, Float


def expected_resonance(
    frequency_hz: Float[np.ndarray, " frequency"],
    *,
    natural_hz: float,
    damping_ratio: float,
    rate_hz: float,
    count: int,
    derivatives: int = 2,
) -> Float[np.ndarray, " frequency"]:
    r"""Predict the periodogram of an oscillator under white force, peak density about 1.

    The d-th derivative of the displacement (d = 0, 1, 2) has the density

    .. math:: S(f) = \frac{4 \zeta^2 W^{2d}}{(1 - W^2)^2 + 4 \zeta^2 W^2},
              \qquad W = f / f_n

    up to half the sampling rate, where the force or an anti-alias filter ends it. The
    periodogram of N samples scatters about its convolution with Fejér's kernel instead. With
    the autocovariance :math:`R(\tau) \propto \mathrm{Re}\, A (-s^2 / \omega_n^2)^d e^{s \tau}`,
    pole :math:`s = -\zeta \omega_n + i \omega_d`,
    :math:`A = 1 - i \zeta / \sqrt{1 - \zeta^2}`, the triangle that a record of N samples puts
    on it sums in closed form,

    .. math:: \sum_{n<N} \bigl(1 - \tfrac{n}{N}\bigr) z^n = \frac{1}{1 - z}
              - \frac{z \, (1 - z^N)}{N (1 - z)^2}, \qquad
              z = e^{(s - 2 \pi i f) \Delta t} ,

    and its second term is the leakage, added here to S. Fitting with it takes away the bias
    that leakage puts on damping (the debiased Whittle likelihood [1]_).

    Parameters
    ----------
    frequency_hz
        Where to evaluate [Hz]: multiples of rate_hz / count, or means of a few of them.
    natural_hz, damping_ratio
        :math:`f_n` [Hz] and :math:`\zeta` [1], in (0, 1).
    rate_hz, count
        Samples per second [Hz] and number of samples N.
    derivatives
        2 for acceleration, 1 for velocity, 0 for displacement.

    References
    ----------
    .. [1] A. M. Sykulski et al., "The debiased Whittle likelihood", Biometrika 106 (2019).
    """
    found = expected_resonances(
        frequency_hz,
        natural_hz=np.array([natural_hz]),
        damping_ratio=np.array([damping_ratio]),
        rate_hz=rate_hz,
        count=count,
        derivatives=derivatives,
    )
    return np.asarray(found[0])


def expected_resonances(
    frequency_hz: Float[np.ndarray, " frequency"],
    *,
    natural_hz: Float[np.ndarray, " case"],
    damping_ratio: Float[np.ndarray, " case"],
    rate_hz: float,
    count: int,
    derivatives: int = 2,
) -> Float[np.ndarray, "case frequency"]:
    """Predict the periodograms of several oscillators; see `expected_resonance`.

    One row for each case of natural frequency [Hz] and damping ratio [1].
    """
    omega = 2 * np.pi * natural_hz[:, None]
    damping = damping_ratio[:, None]
    root = np.sqrt(1 - damping**2)
    pole = omega * (-damping + 1j * root)
    residue = (1 - 1j * damping / root) * (-(pole**2) / omega**2) ** derivatives
    turn = np.exp(-2j * np.pi * frequency_hz / rate_hz)
    leaked = residue * _leakage(pole / rate_hz, turn, count)
    leaked += np.conj(residue) * _leakage(np.conj(pole) / rate_hz, turn, count)
    square = (frequency_hz / natural_hz[:, None]) ** 2
    density = 4 * damping**2 * square**derivatives
    density /= (1 - square) ** 2 + 4 * damping**2 * square
    return np.asarray(density + damping * omega / rate_hz * leaked.real)


class PredictedPeriodogram:
    """Periodogram of an oscillator as `expected_resonance` has it, with slopes in closed form.

    What does not depend on the oscillator is worked out once.
    """

    def __init__(
        self,
        frequency_hz: Float[np.ndarray, " frequency"],
        rate_hz: float,
        count: int,
        derivatives: int,
    ) -> None:
        self.square = (2 * np.pi * frequency_hz) ** 2
        self.turn = np.exp(-2j * np.pi * frequency_hz / rate_hz)
        self.rate_hz, self.count, self.derivatives = rate_hz, count, derivatives

    def at(
        self, natural_hz: float, damping_ratio: float
    ) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "2 frequency"]]:
        r"""Give each ordinate, and its derivatives by :math:`\ln f_n` and :math:`\ln \zeta`."""
        omega, zeta, order = 2 * np.pi * natural_hz, damping_ratio, self.derivatives
        root = np.sqrt(1 - zeta**2)
        # In units of omega; both poles of the pair.
        pole = np.array([-zeta + 1j * root, -zeta - 1j * root])
        pole_by_zeta = zeta * np.array([-1 - 1j * zeta / root, -1 + 1j * zeta / root])
        amplitude = 1 + zeta / root * np.array([-1j, 1j])
        residue = amplitude * (-(pole**2)) ** order
        residue_by_zeta = residue * (
            zeta / root**3 * np.array([-1j, 1j]) / amplitude + 2 * order * pole_by_zeta / pole
        )
        step = omega / self.rate_hz
        kept = np.exp(pole * step * self.count)
        ratio = np.exp(pole * step)[:, None] * self.turn
        inverse = 1 / (1 - ratio)
        tail = ratio * inverse * inverse
        weight = residue * (kept - 1) / self.count
        # Both the sum's term and what is left of the pole after the record depend on the pole.
        bent = tail * (1 + ratio) * inverse
        bend, decay = weight * pole * step, residue * kept * pole * step
        by_zeta = pole_by_zeta / pole
        sums = np.stack([
            weight, decay, weight * residue_by_zeta / residue + decay * by_zeta,
        ]) @ tail + np.stack([np.zeros(2), bend, bend * by_zeta]) @ bent  # fmt: skip
        leaked, leaked_by_frequency, leaked_by_zeta = zeta * step * sums.real
        ratio_square = self.square / omega**2
        bottom = (1 - ratio_square) ** 2 + 4 * zeta**2 * ratio_square
        density = 4 * zeta**2 * ratio_square**order / bottom
        share = 4 * ratio_square / bottom
        slopes = np.stack([
            density * (share * (2 * zeta**2 - 1 + ratio_square) - 2 * order)
            + leaked + leaked_by_frequency,
            density * (2 - 2 * zeta**2 * share) + leaked + leaked_by_zeta,
        ])  # fmt: skip
        return density + leaked, slopes


def _leakage(
    exponent: Complex[np.ndarray, "case 1"],
    turn: Complex[np.ndarray, " frequency"],
    count: int,
) -> Complex[np.ndarray, "case frequency"]:
    r"""Second term of the triangle's sum for :math:`z = e^{exponent}\, turn`, turn^N = 1."""
    ratio = np.exp(exponent) * turn
    return np.asarray(-ratio / (1 - ratio) ** 2 * ((1 - np.exp(exponent * count)) / count))

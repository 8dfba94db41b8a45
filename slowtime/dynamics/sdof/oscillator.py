"""The single-degree-of-freedom oscillator and its characteristic numbers."""

import cmath
import dataclasses
import math


@dataclasses.dataclass(frozen=True, slots=True)
class Oscillator:
    r"""One degree of freedom.

    .. math:: m \ddot q + c \dot q + k q = f(t)

    Parameters
    ----------
    mass_kg, damping_n_s_per_m, stiffness_n_per_m
        :math:`m > 0` [kg], :math:`c \ge 0` [N s/m], :math:`k > 0` [N/m].

    Examples
    --------
    >>> beam = Oscillator.from_modal(5.0, 0.02, mass_kg=2.0)
    >>> round(beam.stiffness_n_per_m, 3), round(beam.frequency_hz, 12)
    (1973.921, 5.0)
    """

    mass_kg: float
    damping_n_s_per_m: float
    stiffness_n_per_m: float

    def __post_init__(self) -> None:
        """Refuse constants with which nothing could move."""
        m, c, k = self.mass_kg, self.damping_n_s_per_m, self.stiffness_n_per_m
        if not (0 < m < math.inf and 0 <= c < math.inf and 0 < k < math.inf):
            raise ValueError(
                f"Oscillator(mass_kg={m}, damping_n_s_per_m={c}, stiffness_n_per_m={k}) is no "
                "oscillator. Give a positive mass and stiffness, and a damping of zero or more."
            )

    @classmethod
    def from_modal(
        cls, frequency_hz: float, damping_ratio: float, mass_kg: float = 1.0
    ) -> "Oscillator":
        """Oscillator with given modal parameters."""
        omega = 2 * math.pi * frequency_hz
        return cls(mass_kg, 2 * damping_ratio * omega * mass_kg, omega**2 * mass_kg)

    @property
    def natural_frequency(self) -> float:
        r""":math:`\omega_n = \sqrt{k / m}` [rad/s] (eq. 3.4)."""
        return math.sqrt(self.stiffness_n_per_m / self.mass_kg)

    @property
    def frequency_hz(self) -> float:
        r"""Undamped natural frequency :math:`\omega_n / 2 \pi` [Hz]."""
        return self.natural_frequency / (2 * math.pi)

    @property
    def critical_damping(self) -> float:
        r"""Critical damping coefficient :math:`2 \sqrt{k m}` [N s/m] (eq. 3.26)."""
        return 2 * math.sqrt(self.stiffness_n_per_m * self.mass_kg)

    @property
    def damping_ratio(self) -> float:
        r""":math:`\zeta = c / (2 \sqrt{k m})` [1] (eq. 3.25)."""
        return self.damping_n_s_per_m / self.critical_damping

    @property
    def decay_rate(self) -> float:
        r""":math:`\zeta \omega_n = c / 2m` [1/s]."""
        return self.damping_n_s_per_m / (2 * self.mass_kg)

    @property
    def damped_frequency(self) -> float:
        r""":math:`\omega_d = \omega_n \sqrt{1 - \zeta^2}` [rad/s]; 0 where it does not ring."""
        return math.sqrt(max(self._discriminant, 0.0))

    @property
    def period(self) -> float:
        r""":math:`T = 2 \pi / \omega_n` [s]."""
        return 2 * math.pi / self.natural_frequency

    @property
    def poles(self) -> tuple[complex, complex]:
        r"""Roots of :math:`m s^2 + c s + k` [1/s], the upper or slower one first (eq. 3.27)."""
        root = cmath.sqrt(-self._discriminant)
        return -self.decay_rate + root, -self.decay_rate - root

    @property
    def _discriminant(self) -> float:
        return self.stiffness_n_per_m / self.mass_kg - self.decay_rate**2


def logarithmic_decrement(damping_ratio: float) -> float:
    r"""Logarithm of the ratio of successive peaks, :math:`2 \pi \zeta / \sqrt{1 - \zeta^2}`."""
    if not 0 <= damping_ratio < 1:
        raise ValueError(
            f"{damping_ratio=} is outside [0, 1), where an oscillator has successive peaks. "
            "Give a ratio such as 0.02, not a percentage such as 2."
        )
    return 2 * math.pi * damping_ratio / math.sqrt(1 - damping_ratio**2)


def resonance(damping_ratio: float, quantity: str = "displacement") -> float:
    r"""Peak of the frequency response, over :math:`\omega_n` (eq. 3.51).

    Displacement peaks at :math:`\sqrt{1 - 2 \zeta^2}`, velocity at 1 and acceleration at
    :math:`1 / \sqrt{1 - 2 \zeta^2}`; none of them at the damped frequency.

    Raises `ValueError` if there is no such peak, as of displacement beyond :math:`\zeta = 1 /
    \sqrt 2`.
    """
    if quantity == "velocity":
        return 1.0
    if quantity not in ("displacement", "acceleration"):
        raise ValueError(
            f"{quantity=} has no resonance known here. Allowed: displacement, velocity, "
            "acceleration."
        )
    inside = 1 - 2 * damping_ratio**2
    if inside <= 0:
        raise ValueError(
            f"{damping_ratio=} is not below 1/sqrt(2), so the {quantity} has no resonance peak."
        )
    return math.sqrt(inside) if quantity == "displacement" else 1 / math.sqrt(inside)

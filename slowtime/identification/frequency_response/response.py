"""A measured matrix of frequency response functions, with its noise."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

Kind = Literal["displacement", "velocity", "acceleration", "transmissibility"]
"""What a response is per input: of a force, or (transmissibility) an absolute motion per motion
of the base of the same kind."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrequencyResponse:
    r"""Frequency response functions of all pairs of output and input.

    Parameters
    ----------
    frequency_hz
        Lines, ascending, without 0 [Hz].
    response
        Unit of the output per unit of the input.
    sd
        Standard deviation of the complex random error, :math:`\sqrt{E |\delta H|^2}`; of the
        modulus and (over the modulus) of the phase it is this over :math:`\sqrt 2`. Not a
        number where nothing tells it.
    coherence
        Multiple coherence of each output with all inputs [1].
    averages
        Independent blocks that were averaged [1].
    kind
        What the responses are.
    decay_rate
        Of the exponential window that inputs and outputs were multiplied by [1/s]: the lines
        are then at :math:`s = j \omega + \sigma`.
    end
        Factor of the transform of what blocks do not end with, in `response`; None where
        blocks begin and end at rest, or the bias of this is accepted.
    line_correlation
        Of the noise of a line and of lines after it, from lag 0 on [1].
    """

    frequency_hz: Float[np.ndarray, " line"]
    response: Complex[np.ndarray, "line output input"]
    sd: Float[np.ndarray, "line output input"]
    coherence: Float[np.ndarray, "line output"]
    averages: int
    kind: Kind
    decay_rate: float = 0.0
    end: Complex[np.ndarray, " line"] | None = None
    line_correlation: Complex[np.ndarray, " lag"] = dataclasses.field(
        default_factory=lambda: np.ones(1, dtype=complex)
    )

    @property
    def s(self) -> Complex[np.ndarray, " line"]:
        """Laplace variable of each line [rad/s]."""
        return np.asarray(2j * np.pi * self.frequency_hz + self.decay_rate)

    def within(self, low_hz: float, high_hz: float) -> "FrequencyResponse":
        """Give the lines of a band.

        Raises `ValueError` where the band holds fewer than four lines.
        """
        kept = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        if np.count_nonzero(kept) < 4:
            raise ValueError(
                f"The band from {low_hz:g} to {high_hz:g} Hz holds {np.count_nonzero(kept)} of "
                f"the lines from {self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz. "
                "Give a wider band, or longer blocks."
            )
        return dataclasses.replace(
            self,
            frequency_hz=self.frequency_hz[kept],
            response=self.response[kept],
            sd=self.sd[kept],
            coherence=self.coherence[kept],
            end=None if self.end is None else self.end[kept],
        )

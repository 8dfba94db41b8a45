"""The result of a multichannel identification: modes, stabilisation diagram, spectra."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.identification.checks import is_inside
from slowtime.identification.modes import Mode
from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.stabilisation import Stabilisation

SPECTRUM_POINTS = 2000
"""Points of the singular value spectra."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalResult:
    """All that identification says of a record.

    Parameters
    ----------
    modes
        Ascending in frequency, lines of machines among them.
    stabilisation
        Poles of all bands and orders, for a diagram.
    spectrum_hz, singular_values
        Singular values of the averaged spectral matrices of channels of unit variance.
    notes
        What a person chose, and other remarks on the modes.
    """

    modes: tuple[Mode, ...]
    stabilisation: Stabilisation
    spectrum_hz: Float[np.ndarray, " frequency"]
    singular_values: Float[np.ndarray, "frequency value"]
    notes: tuple[str, ...] = ()

    @property
    def structural(self) -> tuple[Mode, ...]:
        """Modes that are no machine's."""
        return tuple(mode for mode in self.modes if mode.kind == "structural")

    def within(self, band_hz: tuple[float, float] | None) -> "ModalResult":
        """Return the result without what lies outside a band.

        The spectra stay those of the whole record.
        """
        if band_hz is None:
            return self
        kept = [k for k, m in enumerate(self.modes) if is_inside(m.frequency_hz.value, band_hz)]
        return dataclasses.replace(
            self,
            modes=tuple(self.modes[k] for k in kept),
            stabilisation=self.stabilisation.of_modes(kept).within(band_hz),
        )


def join_stabilisation(
    poles: list[Poles], members: list[np.ndarray], places: list[int]
) -> Stabilisation:
    """Join the stabilisation diagrams of all bands."""
    sd = [p.standard_deviations() for p in poles]
    count = sum(len(p.order) for p in poles)
    mode = np.full(count, -1)
    for which, place in zip(members, places, strict=True):
        mode[which] = place
    empty = np.zeros(0)
    return Stabilisation(
        order=np.concatenate([np.zeros(0, dtype=int), *(p.order for p in poles)]),
        frequency_hz=np.concatenate([empty, *(p.frequency_hz for p in poles)]),
        frequency_sd_hz=np.concatenate([empty, *(s[0] for s in sd)]),
        damping_ratio=np.concatenate([empty, *(p.damping_ratio for p in poles)]),
        damping_sd=np.concatenate([empty, *(s[1] for s in sd)]),
        mode=mode,
    )


def singular_values(
    transform: np.ndarray, count: int, rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of spectral matrices averaged over neighbouring ordinates."""
    group = max(transform.shape[1], len(transform) // SPECTRUM_POINTS)
    groups = (len(transform) - 1) // group
    parts = transform[1 : 1 + groups * group].reshape(groups, group, -1)
    density = parts.transpose(0, 2, 1) @ parts.conj() / group * (2.0 / (rate_hz * count))
    frequency = (np.arange(groups) * group + (group + 1) / 2) * rate_hz / count
    return frequency, np.linalg.eigvalsh(density)[:, ::-1]

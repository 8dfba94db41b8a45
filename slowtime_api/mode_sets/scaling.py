"""Modal masses and scaled shapes from tests with known added masses."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.mode_shapes.mass_scaling import MassScaling, scale_by_masses
from slowtime.identification.modes import Mode
from slowtime_api.modal_estimates import Modes
from slowtime_api.results import Result
from slowtime_services.argument_checks import Positive, checked

from .merging import modes_file, modes_in

LOWEST = 0.5
"""Frequency with masses over that without [1], below which a mode is taken for another one: so
much needs added masses of three times the modal mass."""

LEAST_MAC = 0.6
"""MAC [1] below which two shapes are not of one mode; from here to 0.9 the result is flagged
`shape_changed`."""

Given = Modes | str | Path


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ScaledModes(Result):
    """Modal masses, and mass-normalised shapes.

    Parameters
    ----------
    channels
        Channels of the shapes.
    modes
        Modes without added masses that could be scaled.
    scalings
        Modal mass of the shape of unit norm [kg], factor and mass-normalised shape
        [kg^(-1/2)], and flags, of each of `modes`.
    notes
        Modes that could not be scaled, and why.
    """

    channels: tuple[str, ...]
    modes: tuple[Mode, ...]
    scalings: tuple[MassScaling, ...]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.modes)

    @property
    def heading(self) -> str:
        """What was scaled, in a line."""
        return f"Modal masses of {len(self)} modes, of shapes of norm 1"

    def rows(self) -> list[dict[str, Any]]:
        """Return each scaled mode.

        Returns
        -------
        One dictionary per mode: ``frequency_hz`` [Hz], ``modal_mass_kg`` and
        ``modal_mass_sd_kg`` [kg], and ``flags``.
        """
        return [
            {
                "frequency_hz": mode.frequency_hz.value,
                "modal_mass_kg": one.modal_mass.value,
                "modal_mass_sd_kg": one.modal_mass.sd,
                "flags": ",".join(one.flags),
            }
            for mode, one in zip(self.modes, self.scalings, strict=True)
        ]


@checked
def scale(
    modes: Modes | str | Path,
    added: Sequence[tuple[Given, Mapping[str, Positive]]],
) -> ScaledModes:
    """Scale operational mode shapes by tests with known added masses.

    Parameters
    ----------
    modes
        Modes of the structure alone with shapes, or the path of a modes file.
    added
        One pair for each test: modes of the structure with masses, and the masses [kg] by
        channel.

    Returns
    -------
    Modal masses and mass-normalised shapes, with standard deviations.

    Raises
    ------
    ValueError
        If channels differ between the tests, or a mass is on no channel.

    References
    ----------
    .. [1] M. Lopez-Aenlle, P. Fernandez, R. Brincker and A. Fernandez-Canteli, "Scaling-factor
       estimation using an optimized mass-change strategy", Mechanical Systems and Signal
       Processing 24 (2010) 1260-1273.
    """
    channels, bare = _read(modes)
    heavier = []
    for place, masses in added:
        others, found = _read(place)
        if others != channels:
            raise ValueError(
                f"A test with masses has the channels {', '.join(others)}, and that without "
                f"{', '.join(channels)}. Identify both with the same sensors in the same order."
            )
        heavier.append((found, _masses(masses, channels)))
    notes: list[str] = []
    scaled = [
        (mode, one)
        for mode in bare
        if mode.kind == "structural" and (one := _scaled(mode, heavier, notes)) is not None
    ]
    return ScaledModes(
        channels=channels, modes=tuple(mode for mode, _ in scaled),
        scalings=tuple(one for _, one in scaled), notes=tuple(notes),
    )  # fmt: skip


def _read(given: Given) -> tuple[tuple[str, ...], list[Mode]]:
    found = given.file() if isinstance(given, Modes) else modes_file(given)
    return tuple(found.channels), modes_in(found)


def _masses(
    masses: Mapping[str, float], channels: tuple[str, ...]
) -> Float[np.ndarray, " channel"]:
    """Return masses at all channels."""
    found = np.zeros(len(channels))
    for name, mass in masses.items():
        if name not in channels:
            raise ValueError(f"A mass on {name!r} was given. Allowed: {', '.join(channels)}.")
        found[channels.index(name)] = mass
    return found


def _scaled(
    mode: Mode,
    heavier: Sequence[tuple[list[Mode], Float[np.ndarray, " channel"]]],
    notes: list[str],
) -> MassScaling | None:
    """Scale one mode by those tests that show it; None where none does, which is noted."""
    hz = mode.frequency_hz.value
    after, masses, why = [], [], "no file with masses shows it"
    for found, kg in heavier:
        near = [
            other
            for other in found
            if other.kind == "structural" and LOWEST < other.frequency_hz.value / hz <= 1.01
        ]
        best = max(near, key=lambda other: mac(mode.shape, other.shape), default=None)
        if best is not None and mac(mode.shape, best.shape) >= LEAST_MAC:
            after.append(best)
            masses.append(kg)
    if after:
        try:
            return scale_by_masses(mode, after, masses)
        except ValueError as error:
            why = str(error)
    notes.append(f"{hz:.4g} Hz is not scaled: {why}")
    return None

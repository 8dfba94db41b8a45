"""How a virtual sensor works: its band, its windows and the size of its models."""

import dataclasses


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class VirtualSettings:
    """Limits of one virtual sensor.

    Parameters
    ----------
    lowest_hz
        Lower edge of the band of the outputs [Hz]: below it accelerations say nothing of
        displacements, and the quasi-static part is not told. None for a quarter of the lowest
        natural frequency.
    window_s
        Samples of so many seconds are taken together to estimate how large forces are [s];
        None for 40 periods of the lowest mode, and at least 10 s.
    most_modes
        Modes that are kept at most; those above 0.9 times half the sampling rate are left out.
    members
        Models within the tolerance that are run side by side: 1 or a power of 2.
    iterations
        Of the fit of force levels; each never lowers the likelihood.
    """

    lowest_hz: float | None = None
    window_s: float | None = None
    most_modes: int = 12
    members: int = 16
    iterations: int = 40

    def __post_init__(self) -> None:
        for name in ("lowest_hz", "window_s"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name}={value} is not allowed. Give a positive number.")
        if self.members < 1 or self.members & (self.members - 1):
            raise ValueError(
                f"members={self.members} is not a power of 2. Give 1, 2, 4, 8, 16 or 32."
            )

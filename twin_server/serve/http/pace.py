"""Whether bytes keep coming as fast as they must."""

import dataclasses


@dataclasses.dataclass(slots=True)
class Pace:
    """A sender that may fall behind a rate for a while, and make up for it.

    Each second costs a second of patience, and each byte gives back the time that it takes at
    the slowest rate, up to all of the patience: a fast beginning buys no slow end.

    Parameters
    ----------
    slowest_bytes_per_s
        Rate that must be kept.
    patience_s
        How long nothing may come.

    Examples
    --------
    >>> pace = Pace(slowest_bytes_per_s=1000.0, patience_s=30.0)
    >>> pace.take(10_000_000, 1.0), pace.left_s
    (True, 30.0)
    >>> pace.take(1, 29.0), pace.take(1, 2.0)
    (True, False)
    """

    slowest_bytes_per_s: float
    patience_s: float
    left_s: float = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        self.left_s = self.patience_s

    def take(self, received: int, took_s: float) -> bool:
        """Count bytes that took so long to come; False where they came too slowly."""
        left_s = self.left_s - took_s + received / self.slowest_bytes_per_s
        self.left_s = min(left_s, self.patience_s)
        return self.left_s > 0.0

"""When readings of a twin came, and when the next one is due."""

from typing import NamedTuple, Self

MISSED = 4
"""Readings in a row that fail to come before one is said to be overdue: a lost window or a
moment without network loses one or two."""

SHORTEST_S = 60.0
"""Time below which nothing is overdue [s]: edges gather messages, and so do links."""


class Heard(NamedTuple):
    """The last reading of a twin.

    Parameters
    ----------
    at_ns
        When it came, by the server's clock [ns].
    t_ns
        Its sensor time [ns].
    spacing_ns
        Sensor time between it and the one before [ns]; 0 while that is not known. Readings that
        were held back come at once, but their sensor times do not.
    """

    at_ns: int
    t_ns: int
    spacing_ns: int = 0

    @classmethod
    def next(cls, last: Self | None, t_ns: int, now_ns: int) -> Self:
        """Take in a reading."""
        if last is None:
            return cls(now_ns, t_ns)
        spacing_ns = t_ns - last.t_ns
        return cls(now_ns, t_ns, spacing_ns if spacing_ns > 0 else last.spacing_ns)

    def late_s(self, now_ns: int, gathered_s: float = 0.0) -> int:
        """Return how long the next reading is overdue [s]; 0 where it is not.

        Parameters
        ----------
        now_ns
            Time of the server's clock [ns].
        gathered_s
            Longest time that the agent keeps readings before it sends them [s].

        Examples
        --------
        >>> second = Heard.next(Heard.next(None, 0, 0), 600 * 10**9, 600 * 10**9)
        >>> second.late_s(1800 * 10**9), second.late_s(3600 * 10**9)
        (0, 2400)
        >>> second.late_s(4200 * 10**9, gathered_s=900.0), second.late_s(3600 * 10**9, 3600.0)
        (2100, 0)
        """
        age_s, spacing_s = (now_ns - self.at_ns) / 1e9, self.spacing_ns / 1e9
        if not spacing_s or age_s < max(MISSED * spacing_s, SHORTEST_S) + gathered_s:
            return 0
        return round(age_s - spacing_s - gathered_s)

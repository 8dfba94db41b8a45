"""The selection of laws gives the same numbers in every process."""

import numpy as np

from slowtime.history_diagnosis.laws.catalogue import HistoryLaw
from slowtime.history_diagnosis.selection import forward_selection


class Family(str):
    """A word with a chosen place in a set."""

    __slots__ = ("place",)
    place: int

    def __new__(cls, word, place):
        """Make the word."""
        made = super().__new__(cls, word)
        made.place = place
        return made

    def __hash__(self):
        """Return the place."""
        return self.place


def test_the_prior_of_a_law_does_not_depend_on_how_words_are_hashed(monkeypatch):
    def prior(places):
        families = [Family(word, place) for word, place in zip("abc", places, strict=True)]
        weights = dict(zip(families, (0.1, 0.1, 1.0), strict=True))
        monkeypatch.setattr(forward_selection, "_FAMILY_WEIGHTS", weights)
        laws = tuple(
            HistoryLaw(
                name=str(family),
                family=family,
                variant="",
                covariate=None,
                axes=(),
                regressors=lambda *given: np.zeros((0, 1)),
            )
            for family in families
        )
        return forward_selection._log_prior(laws[0], laws)

    assert prior((0, 1, 2)) == prior((2, 1, 0))

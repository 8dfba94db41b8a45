"""Words of a first page in each language, and numbers as its readers write them."""

import functools
from pathlib import Path
from typing import Any

from slowtime_services.documents.document_files import read_json_file

FOLDER = Path(__file__).parent / "messages"
LANGUAGES = ("en", "de")
MOST_SURE = 0.999
"""Probability [1] beyond which only a bound is written. Source: what was not compared at all
has a probability, too."""


class Words:
    """Messages of one language.

    Parameters
    ----------
    language
        One of `LANGUAGES`.

    Raises
    ------
    ValueError
        Where there is no such language.

    Examples
    --------
    >>> Words("de")("facts.rate"), Words("de").number(0.1234, 2)
    ('Abtastrate', '0,12')
    """

    def __init__(self, language: str = "en") -> None:
        if language not in LANGUAGES:
            raise ValueError(
                f"Language {language!r:.20} was given. Allowed: {', '.join(LANGUAGES)}."
            )
        self.language = language
        self._messages = _catalogue(language)

    def __call__(self, key: str, **values: Any) -> str:
        """Return a message with values in the places of their names."""
        return str(self._messages["messages"][key]).format(**values)

    def heading(self, english: str) -> str | None:
        """Return a heading of details in this language; None where it has none."""
        if self.language == "en" or not english:
            return english
        found: str | None = self._messages["headings"].get(english)
        return found

    def number(self, value: float, digits: int = 3) -> str:
        """Write a number with so many significant digits."""
        text = f"{value:.{digits}g}".replace("-", "−")
        return text.replace(".", ",") if self.language == "de" else text

    def probability(self, p: float) -> str:
        """Write a probability in percent; none is 100 %, as no comparison is of everything."""
        return f"> {self.percent(MOST_SURE)}" if p > MOST_SURE else self.percent(p)

    def percent(self, share: float, digits: int = 3) -> str:
        """Write a share in percent."""
        return f"{self.number(100.0 * share, digits)} %"


@functools.cache
def _catalogue(language: str) -> dict[str, Any]:
    found: dict[str, Any] = read_json_file(FOLDER / f"{language}.json")
    return found

"""Words of a first page in each language, and numbers as its readers write them."""

import functools
import math
import re
from pathlib import Path
from typing import Any

from slowtime_services.documents.document_files import read_json_file

from .translation import NUMBER, Translation

FOLDER = Path(__file__).parent / "messages"
LANGUAGES = ("en", "de")
LEAST_POWER = 1e7
"""Numbers from here on are written with a power of ten [1]: eight digits are not read."""

RAISED = str.maketrans("0123456789−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
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
        self._translation = _translation(language)

    def __call__(self, key: str, **values: Any) -> str:
        """Return a message with values in the places of their names."""
        return str(self._messages["messages"][key]).format(**values)

    def known(self, key: str) -> str | None:
        """Return a message without values; None where there is none of that key."""
        found: str | None = self._messages["messages"].get(key)
        return found

    def localised(self, number: str) -> str:
        """Write the decimal marks of a written number as this language has them."""
        return number.replace(".", ",") if self.language == "de" else number

    def heading(self, english: str) -> str | None:
        """Return a heading of details in this language; None where it has none."""
        if self.language == "en" or not english:
            return english
        found: str | None = self._messages["headings"].get(english)
        return found

    def told(self, english: str) -> str | None:
        """Return what the analysis says in this language; None where it has no words for it.

        Examples
        --------
        >>> Words("de").told("Nothing is missing beyond the stated tolerances.")
        'Nichts fehlt über die angegebenen Toleranzen hinaus.'
        """
        return english if self.language == "en" else self._translation(english)

    def reason(self, english: str) -> str:
        """Return what the analysis says in this language; in English where it has no words."""
        return self.told(english) or english

    def phrase(self, english: str) -> str:
        """Return a phrase in this language; of what it has no words for, only the numbers.

        Examples
        --------
        >>> Words("de").phrase("gap before the stop = 1.25 mm, a1 1,234.5 on 2026-01-02")
        'Spalt vor dem Anschlag = 1,25 mm, a1 1.234,5 on 2026-01-02'
        """
        return english if self.language == "en" else self._translation.phrase(english)

    def group(self, name: str) -> dict[str, str]:
        """Return all messages whose keys begin with a name and a dot, without these."""
        start = f"{name}."
        every: dict[str, str] = self._messages["messages"]
        return {k.removeprefix(start): said for k, said in every.items() if k.startswith(start)}

    def number(self, value: float, digits: int = 3) -> str:
        """Write a number with so many significant digits.

        Examples
        --------
        >>> Words().number(3123.4), Words().number(4.2e-5), Words("de").number(0.1234)
        ('3,120', '4.2·10⁻⁵', '0,123')
        """
        if 10.0**digits <= abs(value) < LEAST_POWER:
            return self.whole(value, digits)
        mantissa, _, exponent = f"{value:.{digits}g}".replace("-", "−").partition("e")
        text = self.localised(mantissa)
        if not exponent:
            return text
        power = exponent.lstrip("+").replace("−0", "−").lstrip("0").translate(RAISED)
        return f"{text}·10{power}"

    def digits(self, value: float, digits: int) -> str:
        """Write a number with all of so many significant digits, zeros at its end included.

        Examples
        --------
        >>> Words().digits(3.0, 4), Words("de").digits(8.40312, 4), Words().digits(12345.0, 4)
        ('3.000', '8,403', '12,340')
        """
        if not 1.0 <= abs(value) < 10.0 ** (digits - 1):
            return self.number(value, digits)
        return self.localised(f"{value:#.{digits}g}")

    def measured(self, value: float, sd: float) -> tuple[str, str]:
        """Write a number and its standard deviation, to two digits of the latter.

        Examples
        --------
        >>> Words().measured(0.08213, 0.1712), Words("de").measured(65.93, 22.9)
        (('0.08', '0.17'), ('66', '23'))
        """
        if not (sd > 0 and math.isfinite(sd) and math.isfinite(value)):
            return self.number(value), self.number(sd, 2)
        places = max(1 - math.floor(math.log10(sd)), 0)
        if places > 6 or abs(value) >= 1e6:
            return self.number(value, 6), self.number(sd, 2)
        texts = (f"{number:.{places}f}".replace("-", "−") for number in (value, sd))
        shown, around = map(self.localised, texts)
        return shown, around

    def whole(self, value: float, digits: int = 3) -> str:
        """Write a count with so many significant digits and separated thousands.

        Examples
        --------
        >>> Words("de").whole(123456.0), Words().whole(17.3)
        ('123.000', '17')
        """
        text = f"{float(f'{value:.{digits}g}'):,.0f}".replace("-", "−")
        return text.replace(",", ".") if self.language == "de" else text

    def probability(self, p: float) -> str:
        """Write a probability in percent; none is 0 or 100 %, as nothing compares all."""
        if p < 1.0 - MOST_SURE:
            return f"< {self.percent(1.0 - MOST_SURE)}"
        return f"> {self.percent(MOST_SURE)}" if p > MOST_SURE else self.percent(p)

    def percent(self, share: float, digits: int = 3) -> str:
        """Write a share in percent."""
        return f"{self.number(100.0 * share, digits)} %"


def _german_number(found: re.Match[str]) -> str:
    return found[0].translate({ord(","): ".", ord("."): ","})


@functools.cache
def _translation(language: str) -> Translation:
    catalogue = _catalogue(language)
    return Translation(
        catalogue["sentences"],
        catalogue["joints"],
        lambda text: NUMBER.sub(_german_number, text) if language == "de" else text,
    )


@functools.cache
def _catalogue(language: str) -> dict[str, Any]:
    found: dict[str, Any] = read_json_file(FOLDER / f"{language}.json")
    return found

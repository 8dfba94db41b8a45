"""Sentences that the analysis composes in English → the language of a report.

A catalogue has each English sentence, or phrase within one, with its translation. Values stand
in braces, as in messages.
"""

import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

BETWEEN_SENTENCES = re.compile(r"(?<=[.?!]) (?=[A-Z“])")
PLACE = re.compile(r"\{(\w+)\}")
SENTENCE = r"(?![.?!] [A-Z“])"
VALUE = rf"((?:{SENTENCE}(?!, |; ).)+?)"
"""What a value may be: one thing within a sentence."""

LIST = rf"((?:{SENTENCE}.)+?)"
VALUES = {
    "text": r"(.+)",
    "method": r"(\S+)",
    "n": r"([-+−]?\d[\d.,e+−-]*)",
    "name": rf"((?:{SENTENCE}(?!, |; | or | and | = ).)+?)",
    "list": LIST, "numbers": LIST, "bands": LIST, "spans": LIST, "edits": LIST, "what": LIST,
    "names": LIST, "files": LIST, "value": LIST, "limits": r"([^()]+?)",
}  # fmt: skip
"""What other values may be: sentences, a word, a number, one name, and lists."""

VERBATIM = frozenset({"name", "names", "file", "files", "unit", "error", "method"})
"""Values that stay as somebody has written or named them."""

KNOWN = frozenset({"effect", "place", "quantity", "subject", "why", "what", "text"})
"""Values that are themselves phrases of the catalogue; others may be numbers."""

NUMBER = re.compile(
    r"(?<![\w.:,])(?<!\w-)(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:e[-+]?\d+)?(?![\w:]|-\d|[.,]\d)"
)
"""A number as Python writes it, which is no part of a date or of a name."""

QUANTITY = re.compile(r"(\D+?)( =)? ([-+−]?\d.*)")
"""A meaning and its number, such as "gap before the stop 1.2 ± 0.1 mm"."""

JOINTS = {
    "; ": "list", " together with ": "with", ", or ": "or", " or ": "or", ", and the ": "and",
    ", and ": "and", ", ": "comma", " and the ": "and", " and ": "and",
}  # fmt: skip
"""What joins the values of a list, and its key among the joints of the catalogue."""


OUTSIDE = r"(?![^()]*\))"
"""No bracket closes behind a joint that was opened before it."""


class Pattern(NamedTuple):
    """An English sentence with values, the names of these, and its translation."""

    english: re.Pattern[str]
    names: tuple[str, ...]
    own: str


class Translation:
    """English sentences in another language.

    Parameters
    ----------
    sentences
        Each English sentence or phrase with its translation.
    joints
        Translations of "and", "or" and the like; see `JOINTS`.
    numbers
        Writes the numbers of a text as the language does.
    """

    def __init__(
        self,
        sentences: Mapping[str, str],
        joints: Mapping[str, str],
        numbers: Callable[[str], str],
    ) -> None:
        self._whole = {k: own for k, own in sentences.items() if "{" not in k}
        # The more of a sentence is given, the surer is a match.
        ranked = sorted(
            (item for item in sentences.items() if "{" in item[0]),
            key=lambda item: (-len(PLACE.sub("", item[0])), item[0]),
        )
        self._patterns = [_compiled(*item) for item in ranked]
        self._joints, self._numbers = joints, numbers

    def __call__(self, text: str) -> str | None:
        """Translate a text sentence by sentence, else as a whole; None where one is unknown."""
        found = self._whole.get(text)
        if found is not None:
            return found
        each = [self._sentence(part) for part in BETWEEN_SENTENCES.split(text)]
        known = [one for one in each if one is not None]
        return " ".join(known) if len(known) == len(each) else self._sentence(text)

    def phrase(self, text: str) -> str:
        """Translate what is known of a list or a quantity; of the rest only the numbers."""
        return self._value("list", text) or text

    def _sentence(self, text: str) -> str | None:
        found = self._found(text)
        return _capital(found) if found and text[0].isupper() else found

    def _found(self, text: str) -> str | None:
        if text in self._whole:
            return self._whole[text]
        lower = text[:1].lower() + text[1:]
        if lower in self._whole:
            return _capital(self._whole[lower])
        for english, names, own in self._patterns:
            match = english.fullmatch(text)
            if match is None:
                continue
            values = {n: self._value(n, match[i]) for i, n in enumerate(names, start=1)}
            if None not in values.values():
                return own.format(**values)
        return None

    def _value(self, name: str, text: str) -> str | None:
        """Translate a value; None where it has to be known and is not."""
        if name in VERBATIM:
            return text
        own = self(text) if name == "text" else self._found(text)
        if own is not None:
            return own
        for joint, key in JOINTS.items():
            parts = re.split(f"{re.escape(joint)}{OUTSIDE}", text)
            if len(parts) > 1:
                each = [self._value(name, part) for part in parts]
                known = [one for one in each if one is not None]
                if len(known) == len(each):
                    return self._joints[key].join(known)
        quantity = QUANTITY.fullmatch(text)
        meaning = None if quantity is None else self._found(quantity[1])
        if quantity is not None and meaning is not None:
            return f"{meaning}{quantity[2] or ''} {self._numbers(quantity[3])}"
        return None if name in KNOWN else self._numbers(text)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _compiled(english: str, own: str) -> Pattern:
    parts = PLACE.split(english)
    pattern = "".join(
        VALUES.get(part, VALUE) if i % 2 else re.escape(part) for i, part in enumerate(parts)
    )
    return Pattern(re.compile(pattern, re.DOTALL), tuple(parts[1::2]), own)

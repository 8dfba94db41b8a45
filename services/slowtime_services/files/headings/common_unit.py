"""The unit of all samples, as a heading states it."""

import re
from collections.abc import Sequence

from slowtime_services.files.record import looks_like_unit
from slowtime_services.files.units import VOLTS, unit_of

LONGEST_LINE = 200
MOST_LINES = 100
_KEY = re.compile(
    r"(?:^|[\s;,:*#_-])(?:data[\s_]*|y[\s_-]*(?:axis[\s_-]*)?|vertical[\s_]*|channel[\s_]*|"
    r"signal[\s_]*|ordinate[\s_]*|amplitude[\s_]*|accel\w*[\s_]*)?"
    r"(?:units?|einheit|unit[ée]s?|unidad(?:es)?|unit[àa](?:\s+di\s+misura)?)"
    r"(?:[\s_]*(?:of|label|name))?\s*(?P<mark>[:=;,\t]|\s(?=\S))\s*(?P<unit>\S.*)$",
    re.I,
)
_IN_UNITS_OF = re.compile(r"\bin\s+(?:units\s+of\s+)?(?P<unit>\S+)", re.I)
_OF_MOTION = re.compile(r"accel|veloc|displ|beschleun|acc[ée]l|aceler", re.I)
_OTHER_AXIS = re.compile(
    r"horizontal|time|\bx[\s_-]|abscissa|zeit|temps|tiempo|lat|lon|depth", re.I
)


def stated_unit(lines: Sequence[str]) -> str:
    """Find the one unit that all samples of a file have; empty where none, or several.

    Examples
    --------
    >>> stated_unit(["ACCELERATION TIME SERIES IN UNITS OF G"]), stated_unit(["UNITS: cm/s^2"])
    ('g', 'cm/s^2')
    >>> stated_unit(["Horizontal Units: s", "Units,V,V"]), stated_unit(["Unit 5, floor 3"])
    ('V', '')
    """
    found = dict.fromkeys(unit for line in lines[:MOST_LINES] for unit in _of_line(line))
    plain = {"g" if unit == "G" else unit for unit in found}
    return plain.pop() if len(plain) == 1 else ""


def _of_line(line: str) -> Sequence[str]:
    text = line[:LONGEST_LINE].replace('"', "").strip().strip("#%!;*/ ")
    if _OTHER_AXIS.search(text.split(":")[0].split("=")[0]) and not _OF_MOTION.search(text):
        return ()
    said = _IN_UNITS_OF.search(text) if _OF_MOTION.search(text) else None
    if said is not None and _is_unit(unit := said["unit"].rstrip(".,;:")):
        return (unit,)
    key = _KEY.search(text)
    if key is None:
        return ()
    fields = [field.strip(" []()") for field in re.split(r"[;,\t|]", key["unit"])]
    fields = [field for field in fields if field]
    return tuple(fields) if fields and all(map(_is_unit, fields)) else ()


def _is_unit(text: str) -> bool:
    """Whether words are a unit of motion or of a signal; others are ignored."""
    return bool(text) and (
        unit_of(text) is not None
        or text.strip("[]()").casefold() in VOLTS
        or (looks_like_unit(text) and text.casefold() in ("counts", "n", "kn"))
    )

"""K-NET and KiK-net ASCII: one channel, eight values a line, a scale to gal.

References
----------
.. [1] National Research Institute for Earth Science and Disaster Resilience, "Format of the
   K-NET ASCII data", https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html
"""

import datetime
import math
import re
from collections.abc import Sequence

from slowtime_services.files.headings.sampling import find_facts
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Column, Sheet

from .listing import numbers_of

KEY_CHARACTERS = 18
"""Characters of a line before its value [1]_."""
DELAY_S = 15
"""By how much the recording time of a file is late [1]_."""
JAPAN = datetime.timezone(datetime.timedelta(hours=9))
_SCALE = re.compile(r"(\d+\.?\d*)\s*\((\w+)\)\s*/\s*(\d+\.?\d*)")


def recognise(lines: Sequence[str]) -> bool:
    """Whether lines begin as a file of K-NET does."""
    keys = [line[:KEY_CHARACTERS].strip().casefold() for line in lines[:20]]
    return "station code" in keys and any(key.startswith("sampling freq") for key in keys)


def read(lines: Sequence[str], name: str) -> Sheet:
    """One channel in gal, called by its direction."""
    memo = next((i for i, line in enumerate(lines[:40]) if line.startswith("Memo")), None)
    if memo is None:
        raise RecordError(
            f"{name} begins as a K-NET file and has no line 'Memo.', after which its samples "
            "stand. It is cut short or was changed; give the file as it was downloaded."
        )
    said = {line[:KEY_CHARACTERS].strip().casefold(): line[KEY_CHARACTERS:].strip()
            for line in lines[:memo]}  # fmt: skip
    values = numbers_of(lines[memo + 1 :], memo + 2, name)
    scale = _SCALE.search(said.get("scale factor", ""))
    unit, assumptions = "", ("counts, for no scale factor was found",)
    if scale is not None and float(scale.group(3)) > 0:
        factor = float(scale.group(1)) / float(scale.group(3))
        if not math.isfinite(factor):
            raise RecordError(
                f"{name} states a scale of {scale.group(0)[:40]} ..., which is no number. Give "
                "the file as it was downloaded."
            )
        values = values * factor
        unit = scale.group(2)
        assumptions = (f"K-NET file: scaled by {scale.group(0)}",)
    return Sheet(
        columns=(Column(said.get("dir.", "") or "acceleration", unit, values),),
        named=True,
        facts=find_facts(lines[:memo]),
        format="K-NET",
        start_ns=_start_ns(said.get("record time", "")),
        assumptions=assumptions,
        first_line=memo + 2,
    )


def _start_ns(text: str) -> int | None:
    try:
        when = datetime.datetime.strptime(text, "%Y/%m/%d %H:%M:%S")  # noqa: DTZ007 - next line
    except ValueError:
        return None
    began = when.replace(tzinfo=JAPAN) - datetime.timedelta(seconds=DELAY_S)
    return round(began.timestamp()) * 1_000_000_000

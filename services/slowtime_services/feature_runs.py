"""The run and sequence of a features message, without decoding all of it."""

import functools
import re
from typing import NamedTuple

from pydantic_core import from_json

from slowtime_schemas.streams import FEATURES

# What `codec.encode` writes first; five times as quick as parsing the whole message.
AS_WE_ENCODE = re.compile(
    rb'\{"version":\d{1,9},"site":"([a-z0-9_-]{1,63})","asset":"([a-z0-9_-]{1,63})",'
    rb'"boot":"([0-9A-Za-z._-]{1,64})","sequence":(\d{1,18}),'
)


LONGEST_NAME = 64
"""Characters of the longest site, asset or boot [1], as messages allow them."""


class AgentRun(NamedTuple):
    """One run of one edge agent."""

    site: str
    asset: str
    boot: str


def run_and_sequence(key: str, payload: bytes) -> tuple[AgentRun, int] | None:
    """Return the boot and sequence of a features message; None for any other."""
    if f"/{FEATURES.name}/" not in key:
        return None
    if (ours := AS_WE_ENCODE.match(payload)) is not None:
        run, own = _run_and_key(*ours.group(1, 2, 3))
        return (run, int(ours[4])) if key == own else None
    parsed = _found_by_parsing(payload)
    if parsed is None or not 0 <= parsed[1] < 2**63:
        return None
    return parsed if key == FEATURES.key(parsed[0].site, parsed[0].asset) else None


@functools.lru_cache(maxsize=65536)
def _run_and_key(site: bytes, asset: bytes, boot: bytes) -> tuple[AgentRun, str]:
    """Return a run and the key of its features, which recur from message to message."""
    run = AgentRun(site.decode(), asset.decode(), boot.decode())
    return run, FEATURES.key(run.site, run.asset)


def _found_by_parsing(payload: bytes) -> tuple[AgentRun, int] | None:
    try:
        content = from_json(payload)
        run = AgentRun(content["site"], content["asset"], content["boot"])
        sequence = content["sequence"]
    except (ValueError, KeyError, TypeError):
        return None
    sound = all(isinstance(part, str) and len(part) <= LONGEST_NAME for part in run)
    return (run, sequence) if sound and type(sequence) is int else None

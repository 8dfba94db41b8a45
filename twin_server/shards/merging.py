"""Makes one answer about the fleet of the answers of its shards."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic_core import from_json, to_json

from twin_server.serve.routes.plans import merged_fleet_answers

_SAMPLE = re.compile(r"^([A-Za-z_:][\w:]*)(?:\{(.*)\})? (\S+.*)$")
"""Line of a number in the text format of Prometheus: name, labels and value."""


def merged_twins(bodies: Sequence[bytes]) -> bytes:
    """Return the twins of all shards, by their ids."""
    twins = [twin for body in bodies for twin in from_json(body)["twins"]]
    return to_json({"twins": sorted(twins, key=lambda twin: str(twin["id"]))})


def merged_plans(bodies: Sequence[bytes]) -> bytes:
    """Return one ranking of the twins of all shards."""
    return to_json(merged_fleet_answers([from_json(body) for body in bodies]))


def merged_holdings(bodies: Sequence[bytes]) -> bytes:
    """Return what is under way in all shards, the oldest first, with the sums of quotas."""
    found = [from_json(body) for body in bodies]
    holdings = [one for each in found for one in each["holdings"]]
    quotas: dict[str, dict[str, Any]] = {}
    for one in (quota for each in found for quota in each["quotas"]):
        known = quotas.setdefault(one["kind"], {"kind": one["kind"], "most": 0, "held": 0})
        known["most"] += one["most"]
        known["held"] += one["held"]
    holdings.sort(key=lambda one: int(one["since_ns"]))
    return to_json({"holdings": holdings, "quotas": list(quotas.values())})


MERGED: Mapping[str, Callable[[Sequence[bytes]], bytes]] = {
    "/api/v1/twins": merged_twins,
    "/api/v1/fleet/plan": merged_plans,
    "/api/v1/holdings": merged_holdings,
}
"""Routes about the fleet, and how the answers of its shards become one."""


def merged_metrics(texts: Mapping[int, str], count: int) -> str:
    r"""Return the metrics of all shards, each with the label `shard`.

    Parameters
    ----------
    texts
        What each shard that answers says.
    count
        Number of shards.

    Examples
    --------
    >>> says = "# HELP a An a.\n# TYPE a gauge\na 1\n"
    >>> print(merged_metrics({1: says}, 2).strip())
    # HELP slowtime_twin_shard_up Whether a shard answers.
    # TYPE slowtime_twin_shard_up gauge
    slowtime_twin_shard_up{shard="0"} 0
    slowtime_twin_shard_up{shard="1"} 1
    # HELP a An a.
    # TYPE a gauge
    a{shard="1"} 1
    """
    up = "slowtime_twin_shard_up"
    lines = [f"# HELP {up} Whether a shard answers.", f"# TYPE {up} gauge"]
    lines += [f'{up}{{shard="{index}"}} {int(index in texts)}' for index in range(count)]
    families: dict[str, list[str]] = {}
    for index, text in texts.items():
        heads: list[str] = []
        family: list[str] = []
        for line in text.splitlines():
            if line.startswith("# HELP"):
                family = families.setdefault(line.split(" ")[2], [])
                heads = [] if family else family
            if line.startswith("#"):
                heads.append(line)
            elif (sample := _SAMPLE.match(line)) is not None:
                labels = f'shard="{index}"' + (f",{sample[2]}" if sample[2] else "")
                family.append(f"{sample[1]}{{{labels}}} {sample[3]}")
    return (
        "\n".join([*lines, *(line for family in families.values() for line in family)]) + "\n"
    )

"""What one site does with a server, step by step, so that two sites can alternate."""

import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.twin_server.conftest import _features
from tests.twin_server.serve.conftest import RIG

from .house import PLAYED, Answer, House, comparable, recording

OTHER = {"lab": "plant", "plant": "lab"}


class Tenant:
    """A site that uses the server, with all answers that it was given.

    Parameters
    ----------
    secret
        Stands in every text that the site gives; nobody can guess it.
    """

    def __init__(self, house: House, site: str, secret: str = "") -> None:
        self.house, self.site, self.secret = house, site, secret
        self.answers: list[Answer] = []
        self.found: dict[str, Any] = {}

    def ask(self, scope: str | None, method: str, path: str, **more: Any) -> Any:
        """Ask, and keep the answer to compare it."""
        response = self.house.ask(self.site, scope, method, path, **more)
        asked = f"{scope} {method} {path} {more.get('params', '')}"
        self.answers.append(comparable(method, response, asked))
        is_json = response.headers.get("content-type", "").endswith("json")
        return response.json() if is_json and response.content else response

    def get(self, path: str, **more: Any) -> Any:
        """Ask as a viewer."""
        return self.ask("viewer", "GET", path, **more)

    def quietly(self, path: str) -> Any:
        """Ask without keeping the answer: how often that is depends on the time it takes."""
        return self.house.ask(self.site, "viewer", "GET", path).json()

    def ageing(self, asset: str, count: int, first: int = 0) -> list[Any]:
        """Features of a beam that loses stiffness."""
        noise = 0.002 * np.random.default_rng(3).standard_normal(first + count)[first:]
        change = -0.2 * np.arange(first, first + count) / 60
        made = [
            _features(
                first + i, asset=asset,
                frequency_hz=float(3.0 * np.sqrt(1.0 + change[i]) + noise[i]),
            )
            for i in range(count)
        ]  # fmt: skip
        return [one.model_copy(update={"site": self.site}) for one in made]

    def recorded(self, asset: str, count: int = PLAYED) -> bytes:
        """Write a recording of a twin of this site."""
        path = Path(self.house.home) / f"{secrets.token_hex(8)}.tmp"
        content = recording(path, self.ageing(asset, count))
        path.unlink()
        return content


def registration(tenant: Tenant, **more: Any) -> dict[str, Any]:
    """Return a registration with all that can be asked about."""
    return {
        "name": f"Beam {tenant.secret}".strip(),
        "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
        "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.3}]},
        "alarms": [{"quantity": "stiffness_change", "below": -0.05}],
        "alarm_routes": [{"receiver": "ops", "severities": ["info", "warning", "alarm"]}],
        **more,
    }


def scenario(tenant: Tenant) -> Iterator[None]:
    """Do all that a site can do; the other one has its turn at each `yield`."""
    yield from _twins(tenant)
    yield from _alarms_and_events(tenant)
    yield from _composites(tenant)
    yield from _recordings(tenant)
    yield from _diagnoses(tenant)
    yield from _of_all(tenant)
    yield from _ends(tenant)


def brief(t: Tenant) -> Iterator[None]:
    """Do what is quick: composites, recordings, and what is about all sites."""
    for asset in ("beam", "mast"):
        body = {"name": f"{asset} {t.secret}"}
        t.ask("operator", "PUT", f"/twins/{t.site}.{asset}", json=body)
    yield
    yield from _composites(t)
    yield from _recordings(t)
    yield from _of_all(t)


def _twins(t: Tenant) -> Iterator[None]:
    twin, other = f"/twins/{t.site}.beam", OTHER[t.site]
    t.ask("operator", "PUT", twin, json=registration(t))
    t.ask("operator", "PUT", twin, json=registration(t))
    yield
    for receiver in (f"{other}-ops", "nobody"):
        routes = [{"receiver": receiver}]
        t.ask("operator", "PUT", twin, json=registration(t, alarm_routes=routes))
    t.ask("operator", "PUT", twin, json={"changes": "colour"})
    t.ask("viewer", "PUT", twin, json={})
    t.ask("operator", "PUT", f"/twins/{t.site}.mast", json={"name": f"Mast {t.secret}"})
    yield
    t.house.feed(t.ageing("beam", 30))
    yield
    t.house.feed(t.ageing("mast", 10))
    t.house.feed(t.ageing("beam", 30, first=30))
    yield
    for path in (
        "", "/history", "/history/hash", "/history/export", "/dtdl", "/modes", "/shapes",
        "/forecast", "/plan", "/risk", "/events", "/events/recorded", "/gap", "/fatigue",
        "/virtual", "/quarantine", "/alarms", "/alarms/deliveries", "/memberships",
        "/diagnoses", "/ledger",
    ):  # fmt: skip
        t.get(twin + path)
    for site in (t.site, other):
        for path in ("consistency?first=1", "inclusion?boot=b1&sequence=1"):
            t.get(f"/ledger/chains/{site}.beam/{path}")
    yield
    for form in ("csv", "parquet"):
        t.get(f"{twin}/history/export", params={"format": form})
    for form in ("dtdl-2", "json-ld"):
        t.get(f"{twin}/dtdl", params={"as": form})
    t.get(f"{twin}/events", params={"after": 1})
    yield
    live = t.get(f"{twin}/live").text
    last = [line[4:] for line in live.splitlines() if line.startswith("id: ")][-1]
    t.house.feed(t.ageing("beam", 2, first=60))
    t.get(f"{twin}/live", headers={"Last-Event-ID": last})
    t.get(f"{twin}/live", headers={"Last-Event-ID": "17-4"})
    yield
    load = {"kind": "step", "amplitude": 0.1}
    order = {"load": load, "duration_s": 2.0, "rate_hz": 50.0, "draws": 20}
    t.ask("viewer", "POST", f"{twin}/simulate", json=order)
    t.ask("viewer", "POST", f"{twin}/simulate", json=order | {"on": "roof"})
    t.ask("operator", "PUT", f"/twins/{t.site}.idle", json={})
    t.ask("viewer", "POST", f"/twins/{t.site}.idle/simulate", json=order)
    yield


def _alarms_and_events(t: Tenant) -> Iterator[None]:
    twin = f"/twins/{t.site}.beam"
    alarms = t.get(f"{twin}/alarms")["alarms"]
    assert alarms
    path = f"{twin}/alarms/{alarms[0]['event_id']}/acknowledge"
    t.ask("operator", "POST", path, json={"by": "Ann", "note": f"Seen {t.secret}"})
    t.ask("operator", "POST", path, json={"by": "Ann"})
    t.ask("operator", "POST", f"{twin}/alarms/{'0' * 32}/acknowledge", json={})
    yield
    t.ask("operator", "POST", f"{twin}/alarms/test", json={})
    t.ask("operator", "POST", f"{twin}/alarms/test", json={"receiver": f"{OTHER[t.site]}-ops"})
    t.ask("operator", "POST", f"{twin}/alarms/test", json={"receiver": 7})
    t.get(f"{twin}/alarms")
    t.get(f"{twin}/alarms/deliveries")
    yield
    order = {"event": "r1", "kind": "repair", "slow_time": 40.0, "person": "Ann"}
    for more in ({"text": t.secret}, {"text": t.secret}, {"text": "another"}):
        t.ask("operator", "POST", f"{twin}/events", json=order | more)
    t.ask("operator", "POST", f"{twin}/events", json=order | {"event": "r2", "slow_time": 1e9})
    t.ask("operator", "POST", f"{twin}/events", json={"event": "n1", "kind": "note",
          "person": "Ann", "text": "wrong", "reverses": "r1"})  # fmt: skip
    yield
    t.get(f"{twin}/events/recorded")
    t.get(f"{twin}/events")
    yield
    t.ask("viewer", "POST", f"{twin}/changes", json={"after": {"name": "Mine"}})
    named = {"after": {"name": f"Beam 2 {t.secret}"}, "text": t.secret}
    changed = t.ask("operator", "POST", f"{twin}/changes", json=named)
    t.ask("operator", "POST", f"{twin}/changes", json=named)
    t.ask("operator", "POST", f"{twin}/changes", json={"reverses": changed["number"]})
    t.get(f"{twin}/changes")
    yield


def _composites(t: Tenant) -> Iterator[None]:
    own, other = f"{t.site}.", f"{OTHER[t.site]}."
    line = {"name": f"Line {t.secret}", "kind": "line", "members": [own + "beam", own + "mast"]}
    yard = {"members": [own + "line", own + "beam"]}
    t.ask("operator", "PUT", f"/composites/{own}line", json=line)
    t.ask("operator", "PUT", f"/composites/{own}yard", json=yard)
    yield
    t.ask("operator", "PUT", f"/composites/{own}line", json=line | {"kind": "site"})
    t.ask("operator", "PUT", f"/composites/{own}line", json=line | {"members": [own + "yard"]})
    t.ask("operator", "PUT", f"/composites/{own}beam", json=line)
    t.ask("operator", "PUT", f"/twins/{own}line", json={})
    for name in ("beam", "none", "line"):
        wanted = {"members": [own + "beam", other + name]}
        t.ask("operator", "PUT", f"/composites/{own}mixed", json=wanted)
    yield
    for name in ("line", "yard", "none"):
        for path in ("", "/members", "/revisions", "/events"):
            t.get(f"/composites/{own}{name}{path}")
    t.get("/composites")
    t.get(f"/twins/{own}beam/memberships")
    t.get(f"/twins/{own}beam/dtdl")
    yield
    t.ask("admin", "DELETE", f"/composites/{own}line")
    t.ask("admin", "DELETE", f"/composites/{own}none")
    t.ask("admin", "DELETE", f"/composites/{own}yard")
    t.get(f"/composites/{own}yard/revisions")
    yield


def _recordings(t: Tenant) -> Iterator[None]:
    content, path = t.recorded("played"), "/recordings/monday.mcap"
    t.get("/recordings")
    t.ask("operator", "PUT", path, content=content)
    yield
    t.ask("operator", "PUT", path, content=content)
    t.ask("viewer", "PUT", path, content=content)
    t.ask("operator", "PUT", "/recordings/junk.mcap", content=b"junk")
    t.ask("operator", "PUT", "/recordings/large.mcap", content=bytes(60_001))
    foreign = Tenant(t.house, OTHER[t.site]).recorded("beam", 3)
    t.ask("operator", "PUT", "/recordings/foreign.mcap", content=foreign)
    t.ask("operator", "PUT", f"/recordings/{t.secret or 'more'}.mcap", content=content)
    yield
    t.get(path)
    t.get("/recordings")
    t.get("/recordings/none.mcap")
    t.get(path, params={"site": t.site})
    t.get(path, params={"site": OTHER[t.site]})
    yield
    t.ask("operator", "POST", f"{path}/replay", json={"speed": 1.0})
    yield
    t.ask("operator", "POST", f"{path}/replay", json={})
    t.ask("admin", "DELETE", path)
    t.get("/holdings")
    yield
    t.ask("operator", "DELETE", f"{path}/replay")
    t.house.until(lambda: _replay(t)["state"] == "stopped")
    t.ask("operator", "DELETE", f"{path}/replay")
    yield
    t.house.ask(t.site, "operator", "POST", f"{path}/replay", json={})
    t.house.until(lambda: _replay(t)["state"] == "done")
    t.get("/recordings")
    t.get(f"/twins/{t.site}.played/history")
    yield


def _replay(t: Tenant) -> Any:
    found = t.quietly("/recordings")["recordings"]
    return next(one["replay"] for one in found if one["name"] == "monday.mcap")


def _diagnoses(t: Tenant) -> Iterator[None]:
    twin = f"/twins/{t.site}.rig"
    t.ask("operator", "PUT", twin, json={"changes": "stiffness", "model": RIG})
    from_files = {"recordings": {"files": ["monday.mcap"]}}
    yield
    first = _diagnosed(t, from_files)
    yield
    t.get(f"{twin}/diagnoses")
    for name in ("report.json", "report.html", "charts.json", "augmented.yaml", "other"):
        t.get(f"{twin}/diagnoses/{first}/{name}")
    for way in ("adopt", "adopt", "undo", "undo"):
        t.ask("operator", "POST", f"{twin}/diagnoses/{first}/{way}")
    t.get(f"{twin}/events")
    yield
    number = _ordered(t, from_files | {"quick": True})
    t.house.until(lambda: t.quietly(f"{twin}/diagnoses/{number}")["state"] == "running")
    t.house.ask(t.site, "operator", "DELETE", f"{twin}/diagnoses/{number}")
    t.house.until(lambda: t.quietly(f"{twin}/diagnoses/{number}")["state"] == "cancelled")
    t.get(f"{twin}/diagnoses/{number}")
    t.ask("operator", "DELETE", f"{twin}/diagnoses/{number}")
    t.get(f"{twin}/diagnoses/{number}/report.json")
    yield
    orders: tuple[dict[str, Any], ...] = (
        {"recordings": {"files": ["unknown.mcap"]}},
        {"recordings": {"files": [f"{OTHER[t.site]}.mcap"]}},
        {"recordings": {}},
        {"raw": {"duration_s": 3.0}},
        {"clock": "slow"},
        {"raw": {}, "recordings": {}},
    )
    for order in orders:
        t.ask("operator", "POST", f"{twin}/diagnoses", json=order)
    t.ask("operator", "POST", f"/twins/{t.site}.beam/diagnoses", json=from_files)
    t.get(f"{twin}/diagnoses/99")
    t.get(f"{twin}/gap")
    yield
    second = _diagnosed(t, from_files | {"holdout_s": 1.0})
    t.ask("operator", "POST", f"{twin}/diagnoses/{second}/adopt")
    yield


def _ordered(t: Tenant, order: dict[str, Any]) -> int:
    """Order a diagnosis; whether it has begun when that is answered depends on the machine."""
    twin = f"/twins/{t.site}.rig"
    told = t.house.ask(t.site, "operator", "POST", f"{twin}/diagnoses", json=order)
    assert told.status_code == 202, told.text
    assert told.headers["location"].endswith(f"{twin}/diagnoses/{told.json()['number']}")
    return int(told.json()["number"])


def _diagnosed(t: Tenant, order: dict[str, Any]) -> int:
    number, twin = _ordered(t, order), f"/twins/{t.site}.rig"
    t.house.until(lambda: t.quietly(f"{twin}/diagnoses/{number}")["ended_ns"] is not None)
    t.get(f"{twin}/diagnoses/{number}")
    return number


def _of_all(t: Tenant) -> Iterator[None]:
    for path in (
        "/twins", "/fleet/plan", "/dtdl", "/session", "/ledger/heads", "/metrics", "/healthz",
        "/readyz", "/holdings", "/openapi.json", "/asyncapi.json", "/recordings", "/composites",
    ):  # fmt: skip
        t.get(path)
    yield
    for params in ({"site": t.site}, {"site": OTHER[t.site]}, {"site": "none"}, {"site": "A"}):
        t.get("/dtdl", params=params)
    t.ask("viewer", "POST", "/session")
    t.ask(None, "GET", "/twins")
    t.ask(None, "GET", "/twins", headers={"Authorization": "Bearer slowtime_guess"})
    t.ask(None, "DELETE", "/session")
    yield


def _ends(t: Tenant) -> Iterator[None]:
    t.house.edges.pop(f"{t.site}.mast").close()  # it would have the twin registered again
    for path in ("/recordings/monday.mcap", "/recordings/monday.mcap", f"/twins/{t.site}.mast",
                 f"/twins/{t.site}.mast"):  # fmt: skip
        t.ask("admin", "DELETE", path)
    yield
    line = f"/composites/{t.site}.line"
    for path in ("/twins", f"/twins/{t.site}.mast", "/recordings", "/composites", line):
        t.get(path)
    t.get(f"{line}/events")
    yield

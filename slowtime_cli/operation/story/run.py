"""Runs the story: processes, faults, and what people do; the twin does the rest by itself."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import click

from slowtime_cli.operation.child_processes import Children
from slowtime_cli.shared.terminal import StopFlag
from slowtime_services.client import AnswerError, Client, UnreachableError

from .scenario import TWIN, YEAR, YEARS, Scenario, edge_settings, registration, years_of

LOOK_S = 0.2
"""Interval at which the calendar of the twin is read [s]."""
MOST_BEHIND = 0.1
"""Time that the calendar may be ahead of the last record that the twin has compared [years], if
there is a newer one. Beyond it the calendar of a sped-up run stands still, so that delays on it
depend little on the computer; 37 days let an idle computer run without standing still."""
OFFLINE_YEARS = 0.5
"""How long the edge agent is offline, on the calendar of a sped-up run."""
OFFLINE_REAL_S = 600.0
"""Longest time for which it is offline [s]."""
SPOOL_KEPT_S = 1_800.0
"""How long features stay in the spool after the twin has them [s]."""
PATIENCE_S = 120.0
"""How long features that waited in the spool, and a last diagnosis, are waited for [s]."""
DIAGNOSES = f"/twins/{TWIN}/diagnoses"


class Step(NamedTuple):
    """Something that is done once the calendar has come so far [years]."""

    years: float
    act: Callable[[], None]


class Story:
    """One run of a scenario.

    Parameters
    ----------
    family
        Router, twin and recorder run already; the rest is started here.
    endpoint, gateway
        Where the router listens, and where the router of the house will.
    """

    def __init__(
        self,
        family: Children,
        client: Client,
        home: Path,
        scenario: Scenario,
        endpoint: str,
        gateway: str,
        stop: StopFlag,
    ) -> None:
        self._family, self._client, self._home = family, client, home
        self._scenario, self._stop = scenario, stop
        self._endpoint, self._gateway = endpoint, gateway
        self.years = self.held_s = self._held_since = 0.0
        self._hold_file = home / "hold"
        self.outlooks: dict[str, dict[str, Any]] = {}
        self.calendar: list[tuple[int, float]] = []
        self.done: list[dict[str, Any]] = []

    def run(self) -> None:
        """Measure ten years; the faults and acts happen at their time on the calendar."""
        self._client.register(TWIN, registration(self._scenario))
        self._start_gateway()
        self._start_edge()
        steps = list(self._steps())
        while not self._stop.wait(LOOK_S) and self._family.status("edge") is None:
            self._family.check(ending=("edge",))
            self.years = self._calendar()
            self.calendar.append((time.time_ns(), self.years))
            while steps and self.years >= steps[0].years:
                self._hold(True)
                steps.pop(0).act()
            self._hold(self._is_ahead())
        self._hold(False)
        if self._family.status("edge") not in (None, 0):
            self._family.check()
        self._await_the_end()

    def _steps(self) -> Iterator[Step]:
        effect = self._scenario.effect
        yield Step(1.5, self._restart_router)
        yield Step(2.0, self._inspect)
        yield Step(2.9, lambda: self._look("before"))
        yield Step(5.0, self._cut_edge_off)
        yield Step(6.7, lambda: self._look("with the effect"))
        yield Step(effect.leaves, self._repair)
        yield Step(8.5, self._adopt_again)
        yield Step(9.5, lambda: self._look("at the end"))

    def _start_gateway(self) -> None:
        arguments = ["router", "--listen", self._gateway, "--connect", self._endpoint]
        self._family.start("gateway", arguments)

    def _start_edge(self) -> None:
        # Kept as long as the house may be cut off: the recorder asks later than the twin does.
        spool = {"folder": str(self._home / "spool"), "keep_acknowledged_s": SPOOL_KEPT_S}
        settings = {
            "connect": [self._gateway],
            "spool": spool,
            **edge_settings(self._scenario, self._hold_file),
        }
        config = self._home / "edge.json"
        config.write_text(json.dumps(settings), encoding="utf-8")
        self._family.start("edge", ["edge", "--config", str(config)])

    def _calendar(self) -> float:
        """Years that the twin has heard of."""
        try:
            heard = self._client.json("GET", f"/twins/{TWIN}")["slow_time"]
        except (AnswerError, UnreachableError):
            return self.years
        return (heard or 0.0) / YEAR

    def _is_ahead(self) -> bool:
        """Whether records come faster than the twin compares and diagnoses."""
        try:
            readings = self._client.json("GET", f"/twins/{TWIN}/gap")["readings"]
            found = self._client.json("GET", DIAGNOSES)["diagnoses"]
        except (AnswerError, UnreachableError):
            return self._hold_file.exists()
        if any(one["ended_ns"] is None for one in found):
            return True
        compared = years_of(self._scenario, readings[-1]["t_ns"]) if readings else 0.0
        a_record = self._scenario.days_per_record / YEAR
        return self.years - compared > max(MOST_BEHIND, 1.5 * a_record)

    def _hold(self, held: bool) -> None:
        """Let the calendar stand still, or go on; count how long it stood."""
        if self._scenario.real_time or held == self._hold_file.exists():
            return
        if held:
            self._held_since = time.monotonic()
            self._hold_file.touch()
        else:
            self.held_s += time.monotonic() - self._held_since
            self._hold_file.unlink()

    def _tell(self, what: str, text: str) -> None:
        self.done.append({"what": what, "years": round(self.years, 3), "text": text})
        click.echo(f"  year {self.years:5.2f}  {text}")

    def _restart_router(self) -> None:
        self._family.stop("router")
        self._family.start("router", ["router", "--listen", self._endpoint])
        self._tell("router_restarted", "The router is ended and started again.")

    def _inspect(self) -> None:
        text = "An inspection has found no damage."
        seen = {"detected": False, "probability_of_detection": {"a50": 0.1, "slope": 2.0}}
        self._record("inspection", text, quantity="stiffness_change", detection=seen)
        self._tell("inspected", text)

    def _cut_edge_off(self) -> None:
        run_s = self._scenario.records * self._scenario.every_s
        seconds = min(OFFLINE_YEARS / YEARS * run_s, OFFLINE_REAL_S)
        self._tell(
            "edge_offline", f"The house is cut off from the network for {seconds:.0f} s."
        )
        self._family.stop("gateway")
        self._hold(False)  # the house goes on measuring, and its spool fills
        self._stop.wait(seconds)
        self._start_gateway()
        self._tell("edge_online", "The house is connected again; its spool sends what waits.")

    def _repair(self) -> None:
        place = self._scenario.effect.place
        text = f"The owner has repaired what acted at {place}: it is as built again."
        self._record("repair", text, quantity="stiffness_change", repair={})
        self._tell("repaired", text)

    def _record(self, kind: str, text: str, **more: Any) -> None:
        event = {"event": f"story-{kind}", "kind": kind, "text": text, "person": "Ann Moreau"}
        self._client.record_event(TWIN, event | {"slow_time": self.years * YEAR} | more)

    def _adopt_again(self) -> None:
        """Adopt a diagnosis that no longer holds, as a person may by mistake."""
        found = self._client.json("GET", DIAGNOSES)["diagnoses"]
        former = [
            one
            for one in found
            if one["report"] and one["report"]["verdict"] == "missing_effect"
        ]
        if not former or any(one["adopted"] for one in found):
            self._tell("nothing_adopted", "There is no former diagnosis to adopt by mistake.")
            return
        number = former[0]["number"]
        self._client.json("POST", f"{DIAGNOSES}/{number}/adopt")
        self._tell(
            "adopted_by_mistake", f"Somebody adopts diagnosis {number} again by mistake."
        )

    def _look(self, name: str) -> None:
        """Keep forecast, risk, plan and the answer to a load as they are told now."""
        self.outlooks[name] = {"years": round(self.years, 3), **outlook(self._client)}

    def _await_the_end(self) -> None:
        """Wait until all features have arrived and no diagnosis runs."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline and not self._stop.is_set():
            found = self._client.json("GET", DIAGNOSES)["diagnoses"]
            heard = self._client.digest(TWIN).features
            if heard >= self._scenario.records and all(one["ended_ns"] for one in found):
                return
            self._stop.wait(LOOK_S)


STORM = {
    "load": {"kind": "harmonic", "amplitude": 0.2, "frequency_hz": 2.0},
    "on": "base",
    "quantity": "displacement",
    "duration_s": 30.0,
    "draws": 40,
}
"""Load whose response is asked for: a base acceleration of 0.2 m/s² near the lowest mode."""


def outlook(client: Client) -> dict[str, Any]:
    """Sentences of forecast, risk and plan of the house, and its response to a load."""
    asked: dict[str, Callable[[], Any]] = {
        "forecast": lambda: [
            one["sentence"]
            for one in client.json("GET", f"/twins/{TWIN}/forecast")["crossings"]
        ],
        "risk": lambda: [
            one["sentence"] for one in client.json("GET", f"/twins/{TWIN}/risk")["limit_states"]
        ],
        "plan": lambda: client.json("GET", f"/twins/{TWIN}/plan")["sentence"],
        "storm": lambda: client.simulate(TWIN, STORM)["outputs"]["floor4"]["peak"],
    }
    found: dict[str, Any] = {}
    for name, ask in asked.items():
        try:
            found[name] = ask()
        except (AnswerError, UnreachableError) as error:
            found[name] = str(error)
    return found


def replayed_hash(recording: Path, database: Path) -> str:
    """Replay a recording in another process into a fresh database; hash of its history.

    Raises
    ------
    RuntimeError
        Where it cannot be replayed.
    """
    words = ["replay", str(recording), "--into", str(database)]
    done = subprocess.run(
        [sys.executable, "-m", "slowtime_cli", *words],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    for line in done.stdout.splitlines():
        name, _, rest = line.partition("  sha256:")
        if name == TWIN and rest:
            return rest.split()[0]
    raise RuntimeError(f"{recording} could not be replayed: {done.stderr.strip()[-500:]}")

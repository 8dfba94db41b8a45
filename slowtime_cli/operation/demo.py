"""The verb `demo`: runs router, edge agents and twin server in accelerated slow time."""

import json
import socket
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import click

from slowtime_cli.shared.demo_structures import EPOCHS_PER_S, STRUCTURES, registration
from slowtime_cli.shared.extras import require
from slowtime_cli.shared.terminal import INTERRUPTED, StopFlag, plural, until_signalled
from slowtime_services.client import Client
from slowtime_services.credentials import make_key

from .child_processes import Children, children
from .story.page import write_story_page
from .story.run import Story, replayed_hash
from .story.scenario import scenario, twin_settings
from .story.summary import gather, in_words
from .story.summary import summary as summarise

STORY, EXTRA = "story", ("frame", "bridge")
"""What `--with` names: the house instead of the other structures, or one beside them."""
STORY_S = 600.0
"""How long the ten years of the house last where no duration is given [s]."""
RECORDER_S = 300.0
"""Time that a recorder is given to pack its file once more [s]."""
WHOLE = {"max_points": 100_000}
LOOK_AT = """
  Simulated structures age in front of you, {rate:g} days of their calendar a second:
    demo.tower   loses stiffness (eq. 5.12), heard under ambient excitation
    demo.tank    is filled and emptied (eq. 5.13): its mass changes
    demo.wing    both at once, from hammer tests: frequency and damping tell them apart
{more}  The bands are 95 % intervals; the dashed line is the true value (simulation only).
  To the right is the forecast, and below the charts when a threshold will be reached.
  Below -30 % an alarm is raised. After 1,000 days tower and wing are renewed: an event
  says so, and the charts mark it.

  The same in numbers:
    curl {url}/api/v1/twins
    curl '{url}/api/v1/twins/demo.tower/history?max_points=500'
    curl '{url}/api/v1/twins/demo.tower/forecast?threshold=-0.3'
"""
LEDGER_S = 5.0
"""Interval between signed heads [s]. Source: a recording of half a minute has some."""
FRAME = """\
    demo.frame   three sensors on three storeys, one of which weakens after day 30: the
                 twin names it by frequencies and shapes of all modes ({frame:g} day a second)
"""


BRIDGE = """\
    demo.bridge  in the weather: for a year its twin learns what temperature
                 does, and takes it out; on day 400 it cracks, and loses 3 % of its stiffness
"""


def demo(
    port: int,
    duration_s: float,
    recording: Path | None,
    epochs_per_s: float,
    wanted: tuple[str, ...],
    seed: int,
    real_time: bool,
    folder: Path | None,
) -> int:
    """Run router, edge agents, twin server and page on this machine."""
    require("fastapi", "uvicorn", "mcap")
    if _port_in_use(port):
        raise click.UsageError(
            f"Port {port} is in use on this computer. Give another, such as --port "
            f"{port + 1}; `slowtime doctor` says whether a twin server answers there."
        )
    if recording is not None and recording.exists():
        raise click.UsageError(
            f"{recording} exists and may be the only copy of a recording. Give another name."
        )
    if STORY in wanted:
        return _tell_story(folder, port, duration_s, recording, seed, real_time)
    with (
        tempfile.TemporaryDirectory(prefix="slowtime-demo-") as temporary,
        # Outermost: a second Ctrl-C, or SIGTERM, must not leave children behind.
        until_signalled() as stop,
        children((folder or Path(temporary)) / "logs") as family,
    ):
        names = [name for name in STRUCTURES if name not in EXTRA or name in wanted]
        home = folder or Path(temporary)
        _run(family, home, names, port, duration_s, recording, epochs_per_s, stop)
    return INTERRUPTED if duration_s and stop.interrupted else 0


def _tell_story(
    folder: Path | None,
    port: int,
    duration_s: float,
    recording: Path | None,
    seed: int,
    real_time: bool,
) -> int:
    """Run the story of a house; its files stay in a folder."""
    home = folder or Path(f"house-{seed}")
    if home.exists() and any(home.iterdir()):
        raise click.UsageError(f"{home} is not empty. Give another folder by --data.")
    told = scenario(seed, duration_s or STORY_S, real_time=real_time)
    path = recording or home / "house.mcap"
    with until_signalled() as stop, children(home / "logs") as family:
        endpoint, gateway = (f"tcp/127.0.0.1:{_free_port()}" for _ in range(2))
        click.echo("Starting router, twin server and recorder ...")
        family.start("router", ["router", "--listen", endpoint])
        _start_twin(family, home, endpoint, port, twin_settings())
        client = Client(f"http://127.0.0.1:{port}")
        _wait_until_ready(family, client, stop)
        family.start("recorder", ["record", "--connect", endpoint, "--out", str(path)])
        _wait_for_file(family, path, stop)
        if stop.is_set():
            return INTERRUPTED
        click.echo(f"\n  The page: {client.url}\n")
        story = Story(family, client, home, told, endpoint, gateway, stop)
        story.run()
        if stop.is_set():
            return INTERRUPTED
        found = gather(client, story)
        family.stop("recorder", RECORDER_S)
    document = summarise(told, found, replayed_hash(path, home / "replayed.sqlite"))
    (home / "story.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    write_story_page(home / "story.html", told, found, document)
    click.echo("\n" + "\n".join(f"  {sentence}" for sentence in in_words(document)))
    click.echo(f"\n  The story as a page: {home / 'story.html'}")
    return 0 if document["hash"]["equal"] else 1


def _run(
    family: Children,
    home: Path,
    names: Sequence[str],
    port: int,
    duration_s: float,
    recording: Path | None,
    epochs_per_s: float,
    stop: StopFlag,
) -> None:
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    url = f"http://127.0.0.1:{port}"
    click.echo("Starting router, twin server and edge agents ...")
    family.start("router", ["router", "--listen", endpoint])
    _start_twin(family, home, endpoint, port)
    client = Client(url)
    _wait_until_ready(family, client, stop)
    if stop.is_set():
        return
    for name in names:
        client.register(f"demo.{name}", registration(name))
    if recording is not None:
        family.start("recorder", ["record", "--connect", endpoint, "--out", str(recording)])
        _wait_for_file(family, recording, stop)
    for name in names:
        _start_edge(family, home, endpoint, name, epochs_per_s, raw=recording is not None)
    click.echo(f"\n  The page: {url}\n" + _look_at(url, names, epochs_per_s))
    click.echo("Ctrl-C ends everything." if not duration_s else f"Ends after {duration_s:g} s.")
    _watch(family, duration_s, stop)
    if stop.is_set():
        click.echo("\nEnding ...")
    for name in names:
        history, whole = latest(client, name)
        click.echo(summary(name, history, whole=whole))


def _start_twin(
    family: Children,
    home: Path,
    endpoint: str,
    port: int,
    settings: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    key = home / "ledger.pem"
    if not key.exists():
        make_key(key)
    database, recordings = home / "twin.sqlite", home / "recordings"
    config = home / "twin.json"
    config.write_text(json.dumps(dict(settings)), encoding="utf-8")
    family.start(
        "twin",
        [
            "twin", "--config", str(config), "--connect", endpoint, "--port", str(port),
            "--database", str(database),
            "--recordings", str(recordings), "--ledger-key", str(key),
        ],
        {"SLOWTIME_TWIN_LEDGER__EVERY_S": str(LEDGER_S)},
    )  # fmt: skip


def _start_edge(
    family: Children,
    home: Path,
    endpoint: str,
    name: str,
    epochs_per_s: float,
    *,
    raw: bool,
) -> None:
    family.start(
        f"edge-{name}",
        [
            "edge", "--simulate", name, "--connect", endpoint,
            "--spool", str(home / f"spool-{name}"),
            "--epochs-per-s", str(_pace(name, epochs_per_s)),
            "--setting", "raw=yes" if raw else "raw=no",
        ],
    )  # fmt: skip


def _look_at(url: str, names: Sequence[str], epochs_per_s: float) -> str:
    more = FRAME.format(frame=_pace("frame", epochs_per_s)) if "frame" in names else ""
    more += BRIDGE if "bridge" in names else ""
    return LOOK_AT.format(url=url, rate=epochs_per_s, more=more)


def _pace(name: str, epochs_per_s: float) -> float:
    """Days per second of one structure, when the usual ones have `epochs_per_s`."""
    return epochs_per_s * EPOCHS_PER_S[name] / max(EPOCHS_PER_S.values())


def _watch(family: Children, duration_s: float, stop: StopFlag) -> None:
    deadline = time.monotonic() + duration_s if duration_s else float("inf")
    while (left := deadline - time.monotonic()) > 0 and not stop.wait(min(left, 0.5)):
        family.check()


def latest(client: Client, name: str) -> tuple[dict[str, Any], bool]:
    """Ask for a twin's history, and whether it is whole; of a long one for its latest part.

    A thinned history holds the extremes, of which intervals hold fewer than of all readings.
    """
    path = f"/twins/demo.{name}/history"
    history: dict[str, Any] = client.json("GET", path, WHOLE)
    bands = history.get("bands")
    if bands is None:
        return history, True
    left = bands["readings"]
    for start_ns, count in zip(bands["start"]["t_ns"], bands["count"], strict=True):
        if left <= WHOLE["max_points"]:
            return client.json("GET", path, WHOLE | {"start": start_ns}), False
        left -= count
    return history, False


def summary(name: str, history: dict[str, Any], *, whole: bool = True) -> str:
    """Return how often the intervals of a twin held the true values."""
    points = [point for point in history["points"] if point.get("truth")]
    judged: dict[str, list[bool]] = {}
    for point in points:
        for quantity, estimate in _estimates(point).items():
            true = point["truth"].get(quantity)
            if true is not None:
                held = estimate["lo"] <= true <= estimate["hi"]
                judged.setdefault(quantity, []).append(held)
    if not judged:
        return f"  demo.{name}: no estimate yet, after {plural(len(points), 'epoch')}"
    said = ", ".join(
        f"the true {quantity.replace('_', ' ')} in {sum(held) / len(held):.1%}"
        for quantity, held in judged.items()
    )
    part = "" if whole else "the latest "
    suspects = points[-1].get("suspects")
    named = f"; suspected now: {', '.join(suspects)}" if suspects else ""
    return f"  demo.{name}: of {part}{len(points)} epochs, 95 % intervals held {said}{named}"


def _estimates(point: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Estimates of changes in a state, of the whole structure or of its elements."""
    whole = {
        name: point[name]
        for name in ("stiffness_change", "mass_change")
        if point[name] is not None and name not in point["assumed"]
    }
    return whole | (point.get("elements") or {})


def _wait_until_ready(
    family: Children, client: Client, stop: StopFlag, patience_s: float = 60.0
) -> None:
    deadline = time.monotonic() + patience_s
    while not stop.wait(0.1):
        family.check()
        if client.ready():
            return
        if time.monotonic() > deadline:
            raise RuntimeError(f"The twin server was not ready after {patience_s:g} s.")


def _wait_for_file(
    family: Children, path: Path, stop: StopFlag, patience_s: float = 20.0
) -> None:
    deadline = time.monotonic() + patience_s
    while not path.exists() and not stop.wait(0.05):
        family.check()
        if time.monotonic() > deadline:
            raise RuntimeError(f"The recorder did not begin {path} within {patience_s:g} s.")


def _port_in_use(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port

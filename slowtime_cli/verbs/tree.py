"""The commands of `slowtime`: where each is declared, its line of help, and its old name.

The lines are repeated here so that `--help` answers without importing every command; a test
holds them to the commands' own.
"""

from collections.abc import Iterator, Mapping

from slowtime_cli.shared.verb_groups import Verb

MODES = {
    "merge": Verb("records.merge:merge", "Merge modes measured with several sensor set-ups."),
    "scale": Verb(
        "records.scale:scale", "Scale operational mode shapes by known added masses."
    ),
    "orders": Verb(
        "records.orders:orders", "Track the orders of a rotating machine, with a tacho signal."
    ),
    "distortion": Verb(
        "records.distortion:distortion",
        "Measure nonlinear distortion, or damping against amplitude.",
    ),
    "track": Verb(
        "records.track:track", "Track the constants of a nonlinear structure over slow time."
    ),
}
MODEL = {
    "convert": Verb(
        "models.convert:convert", "Convert a mesh of beams, bars and shells to a model file."
    ),
    "reduce": Verb(
        "models.reduce:reduce", "Reduce finite-element matrices to a small model and verify it."
    ),
    "update": Verb(
        "models.update:update", "Update a finite-element model from measured modes."
    ),
    "place": Verb(
        "models.place:place", "Choose the sensor positions that are most informative."
    ),
    "effects": Verb("models.effects:effects", "List the physical effects that slowtime knows."),
    "fmu": Verb("models.fmu:fmu", "Export a model as an FMU for other simulation programs."),
}
ROUTER = {
    "run": Verb(
        "operation.router:router",
        "Run a Zenoh router that edges, twin and recorder connect to.",
    ),
    "status": Verb(
        "operation.router:status",
        "Show whether the router answers, and which edges are online.",
    ),
}
TWIN = {
    "run": Verb(
        "operation.twin:twin", "Run the twin server: features in; estimates, REST and page out."
    ),
    "evolve": Verb(
        "twins.evolve:evolve", "Estimate changes of stiffness and mass from frequencies."
    ),
    "separate": Verb(
        "twins.separate:separate", "Separate a history into a drift and a recurring part."
    ),
    "forecast": Verb(
        "twins.forecast:forecast",
        "Forecast the changes of a twin, and when they reach thresholds.",
    ),
    "whatif": Verb(
        "twins.whatif:whatif", "Simulate a twin's current structure under a load, with bands."
    ),
    "risk": Verb(
        "twins.risk:risk", "Compute a twin's probability of failure for each limit state."
    ),
    "plan": Verb(
        "twins.plan:plan", "Recommend an action for a twin: repair, inspect, wait or close."
    ),
    "event": Verb(
        "twins.event:event", "Record repairs and inspections of an asset, and undo them."
    ),
    "composite": Verb(
        "twins.composite:composite", "Combine twins into sites, lines and structures of parts."
    ),
    "alarms": Verb(
        "twins.alarms:alarms", "Send a test alarm of a twin, and show deliveries of alarms."
    ),
    "outputs": Verb(
        "operation.outputs:outputs",
        "Send states and events of a server to MQTT, InfluxDB and OPC UA.",
    ),
    "holdings": Verb(
        "twins.holdings:holdings",
        "Show what a server has under way for your sites, and end it.",
    ),
    "quarantine": Verb(
        "twins.quarantine:quarantine",
        "List, release and drop messages that the server set aside.",
    ),
}
DB = {
    "check": Verb("operation.check:check", "Check a twin's database for damage."),
    "backup": Verb(
        "operation.backup:backup", "Copy a twin's database while the server is running."
    ),
    "restore": Verb("operation.backup:restore", "Restore a twin's database from a backup."),
    "ledger": Verb(
        "operation.ledger:ledger", "Verify that a twin's history was not altered or deleted."
    ),
}
MCAP = {
    "recover": Verb("records.recover:recover", "Repair a truncated or damaged recording."),
    "layout": Verb(
        "records.layout:layout", "Write a layout for Foxglove or Lichtblick to fit a recording."
    ),
}
VERBS: Mapping[str, Verb] = {
    "identify": Verb(
        "records.identify:identify",
        "Identify natural frequencies and damping, with uncertainty.",
    ),
    "modes": Verb(
        "",
        "Merge, scale and track modes; orders, and damping by amplitude.",
        MODES,
        examples=(
            "slowtime modes merge low.json high.json --out whole.json",
            "slowtime modes orders runup.csv --tacho pulse --orders 1,2,3",
        ),
    ),
    "fatigue": Verb(
        "models.fatigue:fatigue",
        "Count stress cycles and sum fatigue damage, with its scatter.",
    ),
    "virtual": Verb(
        "models.virtual:virtual", "Estimate drift, force or stress that nobody measures."
    ),
    "diagnose": Verb(
        "models.diagnose:diagnose",
        "Find effects that a model lacks, with their place and size.",
    ),
    "assess": Verb(
        "models.assess:assess", "Find members that lost stiffness between two measurements."
    ),
    "simulate": Verb(
        "records.simulate:simulate",
        "Write the vibration of an ageing structure or of a model file.",
    ),
    "model": Verb(
        "",
        "Convert, reduce and update models; sensor places, effects, FMU.",
        MODEL,
        examples=(
            "slowtime model convert tower.bdf --out tower.yaml",
            "slowtime model reduce tower.yaml --modes 20",
        ),
    ),
    "reliability": Verb(
        "models.reliability:reliability", "Compute a probability of failure by several methods."
    ),
    "design": Verb(
        "models.design:design", "Choose a damper, mass or stiffness: cheap, robust and safe."
    ),
    "surrogate": Verb(
        "models.surrogate:surrogate", "Fit a fast surrogate to runs of a slow model."
    ),
    "demo": Verb(
        "operation.demo:demo", "Run router, edge agents, twin server and page on this computer."
    ),
    "edge": Verb(
        "operation.edge:edge", "Run an edge agent: samples in, features with uncertainty out."
    ),
    "router": Verb(
        "",
        "Run the router that edges, twin and recorder connect to.",
        ROUTER,
        default="run",
        examples=("slowtime router", "slowtime router status --asset demo.tower"),
    ),
    "twin": Verb(
        "",
        "Run the twin server; ask a twin: forecast, risk, plan, events.",
        TWIN,
        default="run",
        examples=(
            "slowtime twin --port 8080 --database twin.sqlite",
            "slowtime twin forecast modes.json --nominal-hz 4 --threshold -0.2",
            "slowtime twin event list lab.beam",
        ),
    ),
    "publish": Verb(
        "operation.publish:publish", "Simulate an acceleration sensor and publish its samples."
    ),
    "import": Verb("records.import_record:import_", "Turn a record into an MCAP recording."),
    "export": Verb(
        "twins.export:export", "Export the history of a twin, or the samples of a record."
    ),
    "record": Verb(
        "operation.record:record", "Record the messages of the bus into an MCAP file."
    ),
    "replay": Verb(
        "operation.replay:replay", "Replay a recording and print the hash of its history."
    ),
    "mcap": Verb(
        "",
        "Repair a recording, or lay it out for Foxglove.",
        MCAP,
        examples=("slowtime mcap recover killed.mcap --out sound.mcap",),
    ),
    "doctor": Verb(
        "operation.doctor:doctor", "Check installation, ports, router, clock and write access."
    ),
    "db": Verb(
        "",
        "Check, back up, restore and verify a twin's database.",
        DB,
        examples=(
            "slowtime db check twin.sqlite",
            "slowtime db backup twin.sqlite --out monday.sqlite",
        ),
    ),
    "keys": Verb(
        "operation.keys:keys", "Create, renew and revoke the TLS certificates of a site."
    ),
    "tokens": Verb(
        "operation.tokens:tokens", "Create, list and revoke tokens for REST and the page."
    ),
    "plugins": Verb("operation.plugins:plugins", "List installed plug-ins."),
    "completion": Verb(
        "operation.completion:completion", "Print a script for tab completion in a shell."
    ),
}
"""Command at top level → what it is, in the order of the help."""

GROUPS: Mapping[str, tuple[str, ...]] = {
    "Analyse a record": ("identify", "modes", "fatigue", "virtual"),
    "Models and diagnosis": (
        "diagnose", "assess", "simulate", "model", "reliability", "design", "surrogate",
    ),
    "Run and ask a twin": ("demo", "router", "edge", "twin", "publish"),
    "Data and operation": (
        "import", "export", "record", "replay", "mcap", "doctor", "db", "keys", "tokens",
        "plugins", "completion",
    ),
}  # fmt: skip
"""Heading → commands at top level, in the order of the help."""

NESTED = ("modes", "model", "twin", "db", "mcap")
"""Groups whose commands stood at top level until 0.2."""

OLD_NAMES: Mapping[str, tuple[str, ...]] = {
    **{
        name: (group, name)
        for group in NESTED
        for name in VERBS[group].verbs
        if name not in ("run", "outputs")
    },
    "status": ("router", "status"),
}
"""Name at top level until 0.2 → words of today; understood until 0.4, with a warning."""


def paths(verbs: Mapping[str, Verb] = VERBS, before: str = "") -> Iterator[tuple[str, Verb]]:
    """Yield the words of each command and group that stands here, and what it is."""
    for name, verb in verbs.items():
        yield f"{before}{name}", verb
        yield from paths(verb.verbs, f"{before}{name} ")

"""The verbs `fatigue` and `virtual`: damage and estimates from files."""

import json
import threading

import numpy as np
import pytest
from scipy.signal import butter, decimate, lsim, sosfilt

from edge_agent.__main__ import run as run_edge
from edge_agent.settings import EdgeSettings
from slowtime_schemas.codec import decode
from slowtime_schemas.streams import FATIGUE, parse_key
from slowtime_services.bus import MemoryBus
from slowtime_services.record import RecordingWriter
from twin_server.persist import SqliteStore

READ = ("--rate-hz", "50", "--reading", "columns=a", "--unit", "m/s^2")
MODEL = """\
slowtime_model: 1
nodes: [{id: m, mass_kg: 100}]
elements: [{id: k, between: [base, m], stiffness_n_per_m: 1e5, damping_n_s_per_m: 60}]
sensors: [{channel: a, quantity: acceleration, node: m, unit: m/s^2, noise_sd: 0.01}]
tolerance: {stiffness: 0.05}
"""


@pytest.fixture
def stress(tmp_path):
    wave = 50 * np.sin(2 * np.pi * np.arange(0, 100, 0.01) + 0.1)
    path = tmp_path / "s.csv"
    path.write_text("s [MPa]\n" + "\n".join(f"{x:.6f}" for x in wave))
    return path


@pytest.fixture
def one(tmp_path):
    """A mass on a spring under a random force by `scipy.signal.lsim`; force of the spring."""
    mass, stiffness, damping, finer = 100.0, 1e5, 60.0, 10
    force = np.random.default_rng(1).normal(0.0, 2000.0, 3000 * finer)
    inward = [[0.0, 1.0], [-stiffness / mass, -damping / mass]]
    outward = [inward[1], [stiffness, 0.0]]
    system = (inward, [[0.0], [1 / mass]], outward, [[1 / mass], [0.0]])
    _, shown, _ = lsim(system, force, np.arange(len(force)) / (50 * finer))
    sway = decimate(shown[:, 0], finer, ftype="fir")
    (tmp_path / "a.csv").write_text("\n".join(f"{x:.6f}" for x in sway))
    (tmp_path / "one.yaml").write_text(MODEL)
    return tmp_path / "one.yaml", tmp_path / "a.csv", sway, shown[::finer, 1]


def test_constant_amplitude_gives_cycles_over_life(run, stress):
    said = run(
        "fatigue",
        stress,
        "--rate-hz",
        "100",
        "--setting",
        "sn=3",
        "--setting",
        "sn_constant=1e12",
        "--out",
        "-",
    )
    assert said.status == 0, said.err
    found = json.loads(said.out)
    assert found["damage"]["median"] == pytest.approx(100 / (1e12 / 100**3), rel=0.01)
    assert found["damage"]["lo"] < found["damage"]["median"] < found["damage"]["hi"]
    assert found["largest_range"] == pytest.approx(100, rel=0.03)


def test_a_person_sees_a_table_and_what_it_assumes(run, stress):
    said = run("fatigue", stress, "--rate-hz", "100", "--detail-category", "71")
    assert said.status == 0
    assert "repeated for ever" in said.err
    names, values = (line.split("\t") for line in said.out.splitlines())
    found = dict(zip(names, values, strict=True))
    assert float(found["damage_lo"]) < float(found["damage_median"]) < float(found["damage_hi"])
    assert {"years_to_failure_50_%", "spectral_damage_per_year_dirlik"} <= found.keys()


def test_a_terminal_is_shown_the_digits_that_the_scatter_leaves(run, stress, monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    shown = []
    monkeypatch.setattr(
        "slowtime_cli.models.fatigue.show",
        lambda _title, _heads, rows, plain: shown.extend(rows),
    )
    assert run("fatigue", stress, "--rate-hz", "100", "--detail-category", "71").status == 0
    cells = {row[0]: row[1] for row in shown}
    digits = [char for char in cells["Miner's sum, median"].partition("e")[0] if char.isdigit()]
    assert len("".join(digits).lstrip("0")) <= 3


def test_intervals_of_the_force_in_a_spring_hold_what_was_simulated(run, one, tmp_path):
    model, record, _, force = one
    out = tmp_path / "v.csv"
    given = ("virtual", model, record, *READ, "--quantity", "force")
    said = run(*given, "--element", "k", "--out", out)
    assert said.status == 0, said.err
    assert "above 1.26 Hz" in said.err
    table = np.genfromtxt(out, delimiter=",", skip_header=1)
    above = sosfilt(butter(2, 1.258, "high", fs=50, output="sos"), force)[: len(table)]
    settled = table[:, 3] == 1
    found, sd = table[settled, 1], table[settled, 2]
    assert settled.mean() > 0.9
    assert np.corrcoef(found, above[settled])[0, 1] > 0.999
    # The model's stiffness may be 5 % off; this one is not.
    assert np.mean(np.abs(found - above[settled]) < 1.96 * sd) > 0.95
    assert sd.mean() < 0.1 * above.std()


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--setting", "sn=3"), "either a detail category, or constant and slope"),
        (("--detail-category", "71", "--quantity", "force"), "belong together"),
        (("--detail-category", "71", "--channels", "x"), "x"),
    ],
)
def test_fatigue_that_cannot_be_says_why(run, stress, flags, says):
    said = run("fatigue", stress, "--rate-hz", "100", *flags)
    assert said.status != 0
    assert says in said.err


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        ((), "Give --quantity: displacement, drift"),
        (("--quantity", "drift"), "needs `between`"),
        (("--quantity", "force", "--element", "z"), "no element 'z'. Allowed: k"),
        (("--quantity", "moment", "--element", "k"), "is not a beam. Ask"),
    ],
)
def test_a_quantity_that_cannot_be_says_why(run, one, flags, says):
    said = run("virtual", one[0], one[1], *READ, *flags)
    assert said.status != 0
    assert says in said.err


def test_a_record_shorter_than_a_window_is_refused(run, one, tmp_path):
    short = tmp_path / "short.csv"
    short.write_text("\n".join(f"{x:.6f}" for x in one[2][:300]))
    said = run("virtual", one[0], short, *READ, "--quantity", "displacement", "--node", "m")
    assert said.status != 0
    assert "shorter than one window" in said.err


def test_a_replay_into_a_fresh_database_gives_the_damage_that_the_edge_told(run, one, tmp_path):
    np.save(tmp_path / "a.npy", one[2][:, None])
    settings = EdgeSettings(
        input={
            "kind": "file", "path": tmp_path / "a.npy", "rate_hz": 50.0, "start_ns": 10**18,
            "columns": ("a",), "units": ("m/s^2",),
        },
        extract={"method": "peak", "window_s": 20.0},
        virtual={"model": one[0], "outputs": [
            {"name": "f", "quantity": "force", "element": "k"}]},
        fatigue={"points": [{"at": "f", "constant": 1e12, "slope": 3.0}], "every_s": 20.0},
        spool={"folder": tmp_path / "spool", "fsync": "never"},
        publish={"linger_s": 0.0},
    )  # fmt: skip
    bus, told = MemoryBus(), []
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        bus.subscribe("slowtime/**", lambda s: writer.write(*parse_key(s.key), s.payload, 0))
        bus.subscribe(FATIGUE.everywhere, lambda s: told.append(decode(FATIGUE, s.payload)))
        run_edge(settings, bus=bus, stop=threading.Event())
    said = run("replay", tmp_path / "a.mcap", "--into", tmp_path / "fresh.sqlite")
    assert said.status == 0, said.err
    store = SqliteStore(tmp_path / "fresh.sqlite")
    rows = store.fatigue("demo.tower")
    store.close()
    assert len(told) > 1
    assert decode(FATIGUE, rows[-1].message) == told[-1]

"""The scoring: an oracle is always right, a liar never, and a process is measured."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.blind.answers import judge
from tests.blind.cases import draw_cases
from tests.blind.laws import LAWS
from tests.blind.running import Trial, run_one, score
from tests.blind.tables import BESIDE, beside, rate, tabulate, text_of

HOLDOUT = (
    "import sys, json, numpy, pathlib; a = sys.argv; "
    "report = pathlib.Path(a[a.index('--out') + 1]) / 'report.json'; "
    "report.write_text(json.dumps({'verdict': 'nothing_missing', 'effects': []})); "
    "x = numpy.ones(50_000_000); print(a[1:])"
)


def truth_of(kinds, group, **more):
    effects = [
        {
            "effect": kind, "family": LAWS[kind].family, "leading": LAWS[kind].leading,
            "where": {"kind": LAWS[kind].where, "id": f"p{i}"}, "kin": list(LAWS[kind].kin),
            "parameters": {LAWS[kind].leading: 2.0},
        }
        for i, kind in enumerate(kinds)
    ]  # fmt: skip
    design = {
        "mode": "states", "snr_db": 30, "size": 1, "drive": "force", "coloured": False,
        "at_rest": True, "stiffness_sd": 0.01,
    }  # fmt: skip
    return {
        "case": "c", "group": group, "effects": effects, "equivalents": [], "design": design,
        "predictable": group != "two", "effect_to_noise_db": 20.0,
        "world": {"wander": {"kind": "record"}, "campaign_s": 100.0},
    } | more  # fmt: skip


def report_of(truth, **more):
    effects = [
        {
            "effect": e["effect"], "where": e["where"], "probability": 0.97,
            "parameters": {e["leading"]: {"value": 2.02, "sd": 0.02}} if e["leading"] else {},
        }
        for e in truth["effects"]
    ]  # fmt: skip
    verdict = {
        "nothing": "nothing_missing",
        "parameters": "parameters_only",
        "outside": "unknown_effect",
    }
    gap = {"nominal": 0.3, "refitted_nominal": 0.2, "augmented": 0.0502, "noise_floor": 0.05}
    return {
        "verdict": verdict.get(truth["group"], "missing_effect"),
        "effects": effects,
        "gap": gap,
    } | more


@pytest.fixture
def sealed(tmp_path):
    time = np.arange(2000) / 200.0
    clean = np.sin(time)[:, None]
    noise = np.array([0.05 * clean.std()])
    measured = clean + noise * np.random.default_rng(1).standard_normal(clean.shape)
    np.savez(
        tmp_path / "clean.npz", clean=clean, measured=measured, noise=noise, channels=["a1"]
    )
    return tmp_path


CASES = [
    *[((k,), "listed") for k in ("coulomb", "base_motion", "sensor_dropout", "input_gain")],
    ((), "nothing"), ((), "parameters"), (("wedge_friction",), "outside"),
    (("coulomb", "sensor_gain"), "two"),
]  # fmt: skip


@pytest.mark.parametrize(("kinds", "group"), CASES)
def test_an_oracle_is_always_right(kinds, group, sealed):
    truth = truth_of(kinds, group)
    row = judge(truth, report_of(truth), sealed, sealed)
    assert row["exact"]
    assert not row.get("claimed")
    assert not row.get("spurious")
    assert all(one["right"] for one in row["stated"])
    if group == "listed" and kinds[0] == "coulomb":
        assert row["leading_error"] == pytest.approx(0.01)
        assert row["gap_augmented"] < 1 < row["gap_refitted_nominal"] < row["gap_nominal"]


@pytest.mark.parametrize(("kinds", "group"), CASES)
def test_a_liar_is_never_right(kinds, group, sealed):
    truth = truth_of(kinds, group)
    lie = {
        "effect": "cubic_hardening",
        "where": {"kind": "element", "id": "j9"},
        "probability": 0.99,
    }
    row = judge(
        truth, report_of(truth, verdict="missing_effect", effects=[lie]), sealed, sealed
    )
    assert not row["exact"]
    assert not any(one["right"] for one in row["stated"])
    assert row.get("claimed", True)
    assert row.get("sure_far", True)


def test_a_report_that_is_missing_is_wrong(sealed):
    for kinds, group in CASES:
        row = judge(truth_of(kinds, group), None, sealed, sealed)
        assert row["failed"]
        assert not row["exact"]


def test_undecided_is_right_only_where_all_it_names_could_not_be_told_apart(sealed):
    truth = truth_of(("coulomb",), "listed")
    report = report_of(truth, verdict="undecided", undecided=["coulomb", "stribeck"])
    assert not judge(truth, report, sealed, sealed)["exact"]
    assert judge(truth, report, sealed, sealed)["family"]
    assert judge(truth | {"equivalents": ["stribeck"]}, report, sealed, sealed)["exact"]
    report["undecided"] = [{"effect": "stribeck"}, {"effect": "quadratic_damping"}]
    assert not judge(truth | {"equivalents": ["stribeck"]}, report, sealed, sealed)["exact"]


def test_a_right_name_at_the_wrong_place_or_with_another_beside_it_is_noticed(sealed):
    truth = truth_of(("coulomb",), "listed")
    report = report_of(truth)
    report["effects"][0]["where"] = {"kind": "element", "id": "elsewhere"}
    row = judge(truth, report, sealed, sealed)
    assert row["family"]
    assert not row["place"]
    assert "leading_error" not in row
    report = report_of(truth)
    report["effects"].append({"effect": "sensor_gain", "where": {}, "probability": 0.6})
    row = judge(truth, report, sealed, sealed)
    assert not row["exact"]
    assert row["spurious"]


def test_a_drift_told_for_another_span_is_carried_over_to_the_campaign(sealed):
    truth = truth_of(("stiffness_drift",), "listed")
    report = report_of(truth)
    report["effects"][0]["parameters"] = {
        "dk_n_per_m": {"value": 1.01, "sd": 0.01}, "span_s": {"value": 50.0, "sd": 0.0}
    }  # fmt: skip
    row = judge(truth, report, sealed, sealed)
    assert row["leading_error"] == pytest.approx(0.01)
    assert row["leading_z"] == pytest.approx(1.0)


@pytest.mark.parametrize(("off", "score"), [(0.0, 0.0), (1e-9, np.inf)])
def test_an_interval_of_no_width_holds_only_what_it_is_at(off, score, sealed):
    truth = truth_of(("coulomb",), "listed")
    report, (effect,) = report_of(truth), truth["effects"]
    value = effect["parameters"][effect["leading"]] + off
    report["effects"][0]["parameters"][effect["leading"]] = {"value": value, "sd": 0.0}
    assert judge(truth, report, sealed, sealed)["leading_z"] == score


def test_the_run_on_the_held_out_record_counts_before_what_the_report_says(sealed):
    truth = truth_of(("coulomb",), "listed")
    with np.load(sealed / "clean.npz") as kept:
        clean, noise = kept["clean"], kept["noise"]
    np.savez(
        sealed / "holdout.npz", channels=["other", "a1"],
        augmented=np.column_stack([0 * clean, clean + 2 * noise]),
        nominal=np.column_stack([clean, 0 * clean]),
    )  # fmt: skip
    row = judge(truth, report_of(truth), sealed, sealed)
    assert row["gap_augmented"] == pytest.approx(2.0)
    assert row["gap_from"] == "holdout.npz"


def test_the_tables_hold_every_figure_and_print(sealed):
    rows = []
    for kinds, group in CASES:
        truth = truth_of(kinds, group)
        rows.append(
            judge(truth, report_of(truth), sealed, sealed) | {"seconds": 2.0, "mebibytes": 90.0}
        )
    tables = tabulate(rows)
    assert tables["naming"]["physics"]["exact"]["right"] == 2
    assert tables["naming"]["faults"]["exact"]["right"] == 2
    assert tables["two"]["both"]["share"] == 1
    assert tables["nothing"]["discovery_claimed"]["share"] == 0
    assert tables["numbers"]["covered"]["of"] == 3
    text = text_of(tables)
    assert "coulomb" in text
    assert json.dumps(tables)


def test_tools_stand_beside_each_other_in_one_table(sealed):
    truth = truth_of(["coulomb"], "listed")
    ours = {"cpu_seconds": 3.5} | judge(truth, report_of(truth), sealed, sealed)
    theirs = {"cpu_seconds": 1.5} | judge(truth, None, sealed, sealed)
    lines = beside({"slowtime": tabulate([ours]), "peer": tabulate([theirs])}).splitlines()
    assert lines[0].split() == ["slowtime", "peer"]
    named = next(line for line in lines if line.startswith("physics named exactly"))
    assert "100.0 % (3-100) of 1" in named
    assert "0.0 % (0-98) of 1" in named
    assert next(line for line in lines if line.startswith("CPU worst")).split()[-2:] == [
        "3.5", "1.5",
    ]  # fmt: skip
    assert len(lines) == 2 + len(BESIDE)


def test_intervals_are_those_of_the_binomial_law():
    # Clopper and Pearson's own limits for 0 of 10 and 5 of 10.
    assert rate([False] * 10)["high"] == pytest.approx(1 - 0.025 ** (1 / 10))
    half = rate([True] * 5 + [False] * 5)
    assert (half["low"], half["high"]) == pytest.approx((0.18709, 0.81291), abs=1e-5)


@pytest.mark.long
def test_a_command_is_run_in_the_case_folder_and_measured(battery):
    out, cases = battery
    name = next(iter(cases))
    trial = Trial("fake", (sys.executable, "-c", f"import numpy; {HOLDOUT}"), 60.0)
    run = run_one(out / "cases" / name, out / "results" / "fake" / name, trial)
    assert run["exit"] == 0
    assert run["mebibytes"] > 350
    (row,) = score(out, "fake")
    assert row["verdict"] == "nothing_missing"
    words = (out / "results" / "fake" / name / "log.txt").read_text()
    listing = json.loads((out / "cases" / name / "case.json").read_text())
    assert all(record in words for record in listing["records"])
    assert "sealed" not in words.replace(str(Path(out)), "")


@pytest.mark.long
def test_a_command_without_end_is_ended(battery, tmp_path):
    out, cases = battery
    trial = Trial("slow", (sys.executable, "-c", "import time; time.sleep(60)"), 0.3)
    run = run_one(out / "cases" / next(iter(cases)), tmp_path / "r", trial)
    assert not run["in_time"]
    assert run["exit"] != 0
    assert run["seconds"] < 20


def test_every_kind_of_effect_is_drawn():
    kinds = {kind for _, design, _ in draw_cases(400, 1) for kind in design.kinds}
    assert kinds == set(LAWS)

"""Equivalent pairs, the experiment that decides, and the judge of what cannot be decided."""

import dataclasses
import json
import sys

import pytest

from slowtime_services.files import read_record
from slowtime_services.models import read_description
from tests.blind.adjudicate import (
    SHAPES,
    adjudicate,
    least_excess,
    scaled,
    scaled_excess,
    training_plans,
)
from tests.blind.experiment import Request, perform, planned
from tests.blind.files import write_case
from tests.blind.law import Placed
from tests.blind.laws import LAWS
from tests.blind.loop import close_loop, tabulate_pairs
from tests.blind.pairs import PAIRS, build_pair
from tests.blind.running import Trial
from tests.blind.sensing import Sensor
from tests.blind.unexplained import price
from tests.blind.world import from_json

MASS = next(pair for pair in PAIRS if pair.name == "stiffness_loss|added_mass")
SWING = next(pair for pair in PAIRS if pair.name == "pendulum_sine|cubic_softening")

# Undecided on three files of records, sure of the truth on four.
ANSWERS = """
import json, pathlib, sys
a = sys.argv
records = a.index('--holdout') - 2
out = pathlib.Path(a[a.index('--out') + 1])
where = {'kind': 'element', 'id': 'j0'}
effect = {'effect': 'stiffness_loss', 'where': where, 'probability': 0.9}
report = {'verdict': 'undecided', 'effects': [], 'undecided': ['stiffness_loss', 'added_mass'],
          'experiment_request': %s}
if records == 3:
    report = {'verdict': 'missing_effect', 'effects': [effect]}
(out / 'report.json').write_text(json.dumps(report))
"""


@pytest.fixture(scope="module")
def pair_case(tmp_path_factory):
    out = tmp_path_factory.mktemp("pairs")
    write_case(build_pair(MASS, "000000aa", 3), out)
    return out


def answering(request):
    return Trial("fake", (sys.executable, "-c", ANSWERS % repr(request)), 60.0)


def test_there_are_twenty_kinds_of_pairs_and_more():
    names = {pair.name for pair in PAIRS}
    assert len(names) == len(PAIRS) >= 20
    assert all({pair.truth, pair.rival} <= set(LAWS) for pair in PAIRS)


def test_the_loop_is_closed_by_the_proposed_experiment(pair_case):
    row = close_loop(pair_case, "000000aa", answering(MASS.deciding))
    assert row["undecided"]
    assert row["proposed"]
    assert row["decided"]
    tables = tabulate_pairs([row])
    assert tables["decided_of_all"]["share"] == 1


@pytest.mark.long
@pytest.mark.parametrize(("name", "called"), [("000000c1", "f1"), ("000000c2", "f_m1")])
def test_a_known_force_separates_mass_from_stiffness(pair_case, name, called):
    wanted = Request.from_report(MASS.deciding)
    wanted = dataclasses.replace(
        wanted, add_inputs=tuple(entry | {"channel": called} for entry in wanted.add_inputs)
    )
    folder = perform(pair_case, "000000aa", wanted, name)
    listing = json.loads((folder / "case.json").read_text())
    description = read_description(folder / "model.yaml")
    assert [entry.channel for entry in description.inputs] == ["ab", "f1"]
    new = read_record(folder / listing["records"][-1], keep=["all"])
    assert not new.channel("ab").any()
    assert new.channel("f1").std() > 0
    for old in [*listing["records"][:-1], listing["holdout"]]:
        record = read_record(folder / old, keep=["all"])
        assert not record.channel("f1").any()
        assert record.channel("ab").std() > 0


def test_sensors_and_masses_that_are_asked_for_are_there(pair_case):
    request = Request.from_report(
        {
            "add_sensors": [{"channel": "x1", "quantity": "displacement", "node": "m1"}],
            "add_mass": {"node": "m1", "mass_kg": 0.5},
            "level_factor": 3.0,
            "band_hz": [0.5, 9.0],
        }
    )
    folder = perform(pair_case, "000000aa", request, "000000cc")
    listing = json.loads((folder / "case.json").read_text())
    new = read_record(folder / listing["records"][-1], keep=["all"])
    assert float(new.aux["added_mass_kg.m1"]) == 0.5
    truth = json.loads((pair_case / "sealed" / "000000aa" / "truth.json").read_text())
    before = max(training_plans(truth), key=lambda plan: plan.level)
    # Louder, and in another band: root mean squares compare as the levels do.
    drive = truth["world"]["drive"]
    assert new.channel("ab").std() == pytest.approx(3 * before.level * drive, rel=0.05)
    assert "x1" in {s.channel for s in read_description(folder / "model.yaml").sensors}
    assert new.channel("x1").std() > 0


def test_a_request_that_nobody_knows_is_refused():
    with pytest.raises(ValueError, match=r"Unknown in a request: lever.*Allowed: add_inputs"):
        Request.from_report({"lever": 2})


@pytest.mark.slow
def test_a_small_swing_hides_the_sine_and_a_large_one_shows_it(tmp_path):
    case = build_pair(SWING, "000000dd", 5)
    plans = [plan for i, plan in enumerate(case.plans) if i != case.held]
    quiet = least_excess(case.world, plans[:1], "cubic_softening", evaluations=8)
    loud = dataclasses.replace(plans[0], level=4 * plans[0].level, seconds=10.0)
    assert quiet < 9
    assert least_excess(case.world, [loud], "cubic_softening", evaluations=8) > 100


def test_only_what_says_the_same_is_called_equivalent(pair_case):
    truth = json.loads((pair_case / "sealed" / "000000aa" / "truth.json").read_text())
    plans = [dataclasses.replace(training_plans(truth)[0], seconds=4.0)]
    world = from_json(truth["world"])
    element = world.rig.elements[0]
    for more, same in ((1.0, True), (30.0, False)):
        drag = {"c2_n_s2_per_m2": element.damping / world.scale[1] * more}
        dragged = world.with_effects(Placed(LAWS["quadratic_damping"], "j0", drag))
        noise = dragged.take(plans[0], noiseless=True).clean.std(axis=0) * (
            0.5 if same else 0.02
        )
        dragged = dataclasses.replace(dragged, noise=tuple(noise.tolist()))
        assert (least_excess(dragged, plans, "viscous_damping", evaluations=6) < 9) == same


@pytest.mark.parametrize(
    ("name", "parameters", "place", "rivals"),
    [
        ("added_mass", {"dm_kg": 0.2}, "m1", {"input_gain", "sensor_gain"}),
        ("input_gain", {"gain": 1.1}, "f1", {"added_mass"}),
        ("sensor_gain", {"gain": 0.9}, "a1", {"added_mass"}),
    ],
)
def test_what_scales_a_whole_equation_says_the_same(pair_case, name, parameters, place, rivals):
    truth = json.loads((pair_case / "sealed" / "000000aa" / "truth.json").read_text())
    known = from_json(truth["world"])
    element = dataclasses.replace(known.rig.elements[0], first=-1, second=0)
    rig = dataclasses.replace(known.rig, masses=known.rig.masses[:1], elements=(element,))
    world = dataclasses.replace(
        known, rig=rig, nominal=rig, driven=("m1",), noise=known.noise[:1],
        sensors=(Sensor("acceleration", 0),),
        effects=(Placed(LAWS[name], place, parameters),),
    )  # fmt: skip
    plan = dataclasses.replace(training_plans(truth)[0], seconds=4.0, kick=0.0)
    says = world.take(plan, noiseless=True).outputs
    found = scaled(world)
    assert set(found) == rivals
    factor = rig.masses[0] / (rig.masses[0] + 0.2) if name == "added_mass" else 1 / 0.9
    factor = 1 / 1.1 if name == "input_gain" else factor
    for rival in found.values():
        other = dataclasses.replace(world, rig=rig.scaled([factor], [factor]), effects=(rival,))
        assert other.take(plan, noiseless=True).outputs == pytest.approx(
            says, abs=1e-4 * says.std()
        )
    due = sum(((factor - 1) / sd) ** 2 for sd in world.tolerance)
    assert scaled_excess(world) == pytest.approx(due)
    two = dataclasses.replace(world, sensors=(*world.sensors, Sensor("displacement", 0)))
    assert scaled(two) == {} == scaled(known.with_effects(world.effects[0]))


@pytest.mark.parametrize("loss", [0.0, 0.02, 0.06])
def test_constants_have_a_price(pair_case, loss):
    """What is a softer spring costs as many tolerances squared as it is softer."""
    truth = json.loads((pair_case / "sealed" / "000000aa" / "truth.json").read_text())
    world = from_json(truth["world"])
    element, claimed = world.rig.elements[0], world.nominal.elements[0]
    softer = Placed(LAWS["stiffness_loss"], "j0", {"dk_n_per_m": loss * claimed.stiffness})
    world = dataclasses.replace(
        world, effects=(softer,), noise=tuple(0.03 * n for n in world.noise)
    )
    seen = [world.take(plan, noiseless=True).seen for plan in training_plans(truth)]
    known = world.nominal, world.rig, world.sensors, world.tolerance
    off = element.stiffness / claimed.stiffness - loss, element.damping / claimed.damping
    due = sum(((a - 1) / sd) ** 2 for a, sd in zip(off, world.tolerance, strict=True))
    assert price(seen, *known, False) == pytest.approx(due, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(PAIRS)))
def test_every_pair_is_undecidable_before_and_decidable_after(number, tmp_path):
    pair = PAIRS[number]
    case = build_pair(pair, f"{number:08x}", 700 + number)
    write_case(case, tmp_path)
    perform(tmp_path, case.name, Request.from_report(pair.deciding), "ffffffff")
    truth = json.loads((tmp_path / "sealed" / "ffffffff" / "truth.json").read_text())
    assert truth["effects"][0]["effect"] == pair.truth
    if pair.places[0] or pair.truth not in SHAPES or pair.rival not in SHAPES:
        return
    plans = [plan for i, plan in enumerate(case.plans) if i != case.held]
    assert least_excess(case.world, plans, pair.rival, evaluations=12, enough=3) < 9
    after = from_json(truth["world"])
    both = [*plans, planned(Request.from_report(pair.deciding), plans, case.world)]
    excess = least_excess(after, both, pair.rival, evaluations=12)
    assert excess > 30, f"{pair.name}: {excess:.1f} after the experiment"


@pytest.mark.parametrize("extra", [0.02, 0.5])
def test_what_a_gain_says_as_well_is_written_beside_the_truth(pair_case, tmp_path, extra):
    """Of much mass it does not: spring and damper would be far from what is claimed."""
    given = json.loads((pair_case / "sealed" / "000000aa" / "truth.json").read_text())
    known = given["world"]
    element = known["rig"]["elements"][0] | {"first": -1, "second": 0}
    rig = known["rig"] | {"masses": [2.0], "elements": [element]}
    effect = {"effect": "added_mass", "place": "m1", "parameters": {"dm_kg": 2.0 * extra}}
    world = known | {
        "rig": rig, "nominal": rig, "driven": ["m1"], "noise": known["noise"][:1],
        "sensors": [{"quantity": "acceleration", "node": 0}], "effects": [effect],
    }  # fmt: skip
    truth = given | {
        "world": world,
        "equivalents": [],
        "effects": [effect | {"where": {"kind": "node", "id": "m1"}}],
    }
    told = {"verdict": "undecided", "undecided": ["added_mass", "input_gain", "sensor_gain"]}
    for folder, name, what in (
        ("sealed/c1", "truth.json", truth),
        ("results/slowtime/c1", "report.json", told),
    ):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / name).write_text(json.dumps(what))
    adjudicate(tmp_path, "slowtime")
    found = json.loads((tmp_path / "sealed" / "c1" / "equivalent.json").read_text())
    assert set(found) == {"input_gain", "sensor_gain"}
    assert all(one["equivalent"] is (extra < 0.1) for one in found.values())

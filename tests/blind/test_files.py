"""What the generator writes: readable, the truth in none of it, the same every time."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slowtime_services.files import read_record
from slowtime_services.models import read_description
from slowtime_services.replay import record_of
from tests.blind.cases import build, draw_cases
from tests.blind.conftest import SEED, short_cases
from tests.blind.design import GROUPS, draw_design, draw_rigs
from tests.blind.files import write_case
from tests.blind.laws import LAWS
from tests.blind.world import from_json

ROOT = Path(__file__).parents[2]


def digest(folder):
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            found.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return found.hexdigest()


def read(path):
    return record_of(path) if path.suffix == ".mcap" else read_record(path, keep=["all"])


@pytest.mark.long
def test_equal_seeds_give_equal_bytes(battery, tmp_path):
    out, cases = battery
    first = short_cases()[0]
    write_case(build(*first), tmp_path)
    for part in ("cases", "sealed"):
        assert digest(tmp_path / part / first[0]) == digest(out / part / first[0])
    assert short_cases(SEED + 1)[0][0] not in cases


@pytest.mark.long
def test_the_case_folder_says_nothing_of_the_truth(battery):
    out, cases = battery
    for name, case in cases.items():
        folder = out / "cases" / name
        listing = json.loads((folder / "case.json").read_text())
        assert set(listing) == {"model", "records", "holdout"}
        expected = {"case.json", "model.yaml", *listing["records"], listing["holdout"]}
        assert {path.name for path in folder.iterdir()} == expected
        for path in folder.iterdir():
            held = path.read_bytes().lower()
            for word in (*LAWS, "truth", "effect", "seed", "clean", "sealed"):
                if path.suffix == ".mcap" and word == "truth":
                    continue  # the block's schema has a field of that name, which stays empty
                assert word.encode() not in held, (path.name, word)
            numbers = [v for p in case.world.effects for v in p.parameters.values()]
            assert not any(repr(v).encode() in held for v in numbers if len(repr(v)) > 9)


def test_names_of_files_tell_neither_order_nor_level(battery):
    _, cases = battery
    for name, case in cases.items():
        assert len(name) == 8
        starts = [taken.times[0] for taken in case.taken]
        assert starts == sorted(starts)
        assert case.held < len(case.taken) - 1


def test_model_and_records_read_back_as_what_was_taken(battery):
    out, cases = battery
    for name, case in cases.items():
        folder = out / "cases" / name
        description = read_description(folder / "model.yaml")
        assert [s.channel for s in description.sensors] == [
            s.channel for s in case.world.sensors
        ]
        listing = json.loads((folder / "case.json").read_text())
        held = case.taken[case.held]
        record = read(folder / listing["holdout"])
        assert record.rate_hz == pytest.approx(case.world.rate_hz, rel=1e-6)
        for column, sensor in zip(held.outputs.T, case.world.sensors, strict=True):
            kept = record.channel(sensor.channel)
            np.testing.assert_allclose(kept, column, rtol=1e-7, atol=1e-7 * column.std())
        for channel, values in held.inputs.items():
            np.testing.assert_allclose(record.channel(channel), values, rtol=1e-7, atol=1e-9)


def test_the_tolerance_in_the_model_is_honest():
    ratios = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        design = draw_design("nothing", (), rng)
        nominal, true = draw_rigs(design, rng)
        for told, is_so in zip(nominal.elements, true.elements, strict=True):
            ratios.append((is_so.stiffness / told.stiffness - 1) / design.stiffness_sd)
    assert max(map(abs, ratios)) <= 2
    assert 0.7 < np.std(ratios) < 1.05


def test_the_sealed_world_takes_the_same_record_again(battery):
    out, cases = battery
    for name, case in cases.items():
        truth = json.loads((out / "sealed" / name / "truth.json").read_text())
        again = from_json(truth["world"]).take(case.plans[case.held])
        np.testing.assert_array_equal(again.outputs, case.taken[case.held].outputs)


def test_noise_has_the_size_that_is_sealed(battery):
    _, cases = battery
    for case in cases.values():
        if not any(p.law.where == "sensor" for p in case.world.effects):
            taken = case.taken[0]
            noise = (taken.outputs - taken.clean).std(axis=0)
            np.testing.assert_allclose(noise, taken.seen.noise, rtol=0.12)


def test_effects_stand_above_the_noise_and_nothing_does_not(battery):
    _, cases = battery
    for case in cases.values():
        ratio = case.truth["effect_to_noise_db"]
        assert ratio < -30 if case.truth["group"] == "nothing" else 5 <= ratio <= 42


def test_a_battery_holds_every_group():
    groups = {design.group for _, design, _ in draw_cases(40, 1)}
    assert groups == set(GROUPS)


@pytest.mark.long
def test_the_generator_knows_nothing_of_the_simulator_under_trial():
    code = (
        "import sys, tests.blind.files, tests.blind.running; "
        "rooms = ('slowtime.dynamics', 'slowtime.discrepancy'); "
        "sys.exit(any(name.startswith(rooms) for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0

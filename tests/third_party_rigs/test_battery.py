"""The rigs obey closed forms, and answers are scored by name, place and number."""

import json

import numpy as np
import pytest
import yaml

from .battery import cut, gets_worse, scored, table
from .rigs import FINE, Excitation, Link, Structure, run

RATE_HZ, SAMPLES = 200.0, 400
LINK = Link("s1", (-1, 0), 800.0, 1.6)


def released(structure):
    """Let one mass go from one millimetre."""
    points = (SAMPLES - 1) * FINE + 1
    start = np.array([[1e-3], [0.0]])
    given = Excitation(RATE_HZ, SAMPLES, np.zeros((points, 1)), np.zeros(points), start)
    return run(structure, given)


def test_one_mass_decays_as_its_closed_form():
    mass, k, c = 2.0, LINK.stiffness, LINK.damping
    times = np.arange(SAMPLES) / RATE_HZ
    decay, own = c / (2 * mass), np.sqrt(k / mass - (c / (2 * mass)) ** 2)
    truth = (
        1e-3
        * np.exp(-decay * times)
        * (np.cos(own * times) + decay / own * np.sin(own * times))
    )
    found = released(Structure((mass,), (LINK,)))["q"][:, 0]
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_a_force_between_two_points_acts_as_the_link_that_it_stands_for():
    whole = Structure((2.0,), (LINK, Link("s2", (-1, 0), 300.0, 0.4)))
    forced = Structure(
        (2.0,), (LINK,), forces=(((-1, 0), lambda e, v, t: 300.0 * e + 0.4 * v),)
    )
    np.testing.assert_allclose(released(forced)["a"], released(whole)["a"], atol=1e-6)


def answered(folder, named, verdict="missing_effect"):
    """Write a case that lacks a spring between base and f2, and an answer to it."""
    truth = {
        "kinds": ["missing_spring"], "where": ["base", "f2"], "parameter": "k_n_per_m",
        "value": 900.0, "off": True,
    }  # fmt: skip
    (folder / "found").mkdir()
    (folder / "truth.json").write_text(
        json.dumps({"label": "spring", "excitation": "random", "truth": [truth]})
    )
    own = {"id": "s1", "between": ["base", "f1"]}
    new = {"id": "base-f2", "between": ["base", "f2"]}
    (folder / "rig.yaml").write_text(yaml.safe_dump({"elements": [own]}))
    (folder / "found/augmented.yaml").write_text(yaml.safe_dump({"elements": [own, new]}))
    effects = [
        {
            "effect": kind,
            "where": {"kind": "element", "id": place},
            "parameters": {"k_n_per_m": {"value": value, "sd": 1.0}},
        }
        for kind, place, value in named
    ]
    gap = {"refitted_nominal": 0.2, "augmented": 0.0101, "noise_floor": 0.01}
    (folder / "found/report.json").write_text(
        json.dumps({"verdict": verdict, "effects": effects, "gap": gap})
    )
    return scored(folder) | {"seconds": 5.0}


RIGHT = ("missing_spring", "base-f2", 900.5)


@pytest.mark.parametrize(
    ("named", "verdict", "outcome"),
    [
        ([RIGHT], "missing_effect", "exact"),
        ([("missing_spring", "s1", 900.0)], "missing_effect", "wrong"),
        ([("missing_damper", "base-f2", 900.0)], "missing_effect", "wrong"),
        ([RIGHT, ("coulomb", "s1", 1.0)], "missing_effect", "wrong"),
        ([RIGHT, ("bouc_wen", "base-f2", 1.0)], "missing_effect", "wrong"),
        ([], "nothing_missing", "missed"),
        ([], "unknown_effect", "unknown_effect"),
    ],
)
def test_an_answer_is_right_by_name_and_place_and_with_nothing_beside(
    tmp_path, named, verdict, outcome
):
    assert answered(tmp_path, named, verdict)["outcome"] == outcome


@pytest.mark.parametrize(("value", "within"), [(900.5, True), (905.0, False)])
def test_a_number_counts_by_its_own_interval(tmp_path, value, within):
    row = answered(tmp_path, [("missing_spring", "base-f2", value)])
    assert row["within"] == [within]
    told = table([row])
    assert f"its 95 % interval: {int(within)} of 1" in told
    assert "something off the model: 1 of 1" in told


def test_a_case_is_cut_to_the_beginning_of_its_records(tmp_path):
    answered(tmp_path, [RIGHT])
    for name, size in (("a", 400), ("b", 200), ("held", 100)):
        channels = {"t": np.arange(size) / RATE_HZ, "a1": np.arange(size)}
        np.savez(tmp_path / f"{name}.npz", allow_pickle=False, **channels)
    part = cut(tmp_path, 0.25)
    sizes = {n: len(np.load(part / f"{n}.npz")["a1"]) for n in ("a", "b", "held")}
    assert sizes == {"a": 100, "b": 50, "held": 100}
    np.testing.assert_array_equal(np.load(part / "a.npz")["a1"], np.arange(100))
    assert (part / "rig.yaml").read_text() == (tmp_path / "rig.yaml").read_text()
    assert not (part / "found").exists()
    assert cut(tmp_path, 1.0) == tmp_path


@pytest.mark.parametrize(
    ("outcomes", "worse"),
    [
        (("unknown_effect", "exact", "exact"), False),
        (("exact", "alike", "exact"), False),
        (("exact", "undecided", "exact"), True),
        (("unknown_effect", "missed", "wrong"), True),
        (("wrong", "unknown_effect", "partial"), False),
    ],
)
def test_an_answer_gets_worse_where_longer_records_say_less_or_say_it_wrongly(outcomes, worse):
    assert gets_worse(outcomes) == worse

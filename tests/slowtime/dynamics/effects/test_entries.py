"""Effects of a model file: right ones are read, wrong ones are told with place and cure."""

import dataclasses

import pytest

from slowtime.dynamics.builders import beam, chain
from slowtime.dynamics.description import DescriptionError, Input, Sensor
from slowtime.dynamics.effects import Effect, Place, read_effects

RIG = dataclasses.replace(
    chain([2.0, 1.0], [300.0, 200.0]),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=(Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),),
)


def read(*entries, rig=RIG):
    return read_effects(dataclasses.replace(rig, effects=entries))


@pytest.mark.parametrize(
    ("entry", "effect"),
    [
        (
            {"effect": "coulomb", "element": "k2", "friction_n": 4.1},
            Effect("coulomb", Place("element", "k2"), {"friction_n": 4.1}),
        ),
        (
            {"effect": "added_mass", "node": "m1", "dm_kg": -0.1},
            Effect("added_mass", Place("node", "m1"), {"dm_kg": -0.1}),
        ),
        (
            {"effect": "base_motion", "rms_m_per_s2": 0.1},
            Effect("base_motion", Place("base", "base"), {"rms_m_per_s2": 0.1}),
        ),
        (
            {"effect": "input_gain", "input": "u", "gain": 0.9},
            Effect("input_gain", Place("input", "u"), {"gain": 0.9}),
        ),
        (
            {"effect": "sensor_dropout", "sensor": "a1"},
            Effect("sensor_dropout", Place("sensor", "a1"), {}),
        ),
    ],
)
def test_an_entry_reads_as_an_effect_and_is_written_back(entry, effect):
    assert read(entry) == (effect,)
    assert effect.entry() == entry


@pytest.mark.parametrize(
    ("entry", "where", "says"),
    [
        (
            {"effect": "culomb"},
            "effect",
            r"called 'culomb'\. Did you mean 'coulomb'",
        ),
        ({"effect": "coulomb"}, None, r"coulomb sits on one element\. Add `element:`"),
        (
            {"effect": "coulomb", "element": "k9", "friction_n": 1.0},
            "element",
            r"no element is called 'k9'\. There are: k1, k2",
        ),
        (
            {"effect": "coulomb", "element": "k2", "friction": 1.0},
            "friction",
            r"has no `friction`\. Did you mean 'friction_n'\? Allowed: element, friction_n",
        ),
        (
            {"effect": "coulomb", "element": "k2", "friction_n": -1.0},
            "friction_n",
            r"`friction_n` is -1; allowed: at least 0\. It is the friction of sliding \[N\]",
        ),
        (
            {"effect": "coulomb", "element": "k2", "friction_n": "much"},
            "friction_n",
            r"`friction_n` is 'much'\. Give a number",
        ),
        (
            {"effect": "coulomb", "element": "k2", "friction_n": True},
            "friction_n",
            r"`friction_n` is True\. Give a number",
        ),
        (
            {"effect": "coulomb", "element": "k2", "friction_n": 10**400},
            "friction_n",
            r"`friction_n` is beyond the range of numbers",
        ),
        ({"effect": "coulomb", "element": "k2"}, None, r"coulomb needs `friction_n`"),
        (
            {"effect": "bouc_wen", "element": "k2", "kh_n_per_m": 1.0, "zy_m": 0, "n": 1},
            "zy_m",
            r"`zy_m` is 0; allowed: above 0",
        ),
        (
            {
                "effect": "gap_one_sided",
                "element": "k2",
                "kg_n_per_m": 1,
                "gap_m": 0,
                "side": 2,
            },
            "side",
            r"`side` is 2; allowed: 1 or -1",
        ),
        (
            {"effect": "sensor_bias", "sensor": "u", "bias": 1.0},
            "sensor",
            r"no sensor is called 'u'\. There are: a1",
        ),
    ],
)
def test_a_wrong_entry_is_told_with_its_place_and_cure(entry, where, says):
    with pytest.raises(DescriptionError, match=says) as caught:
        read({"effect": "sensor_dropout", "sensor": "a1"}, entry)
    assert caught.value.where == (("effects", 1) if where is None else ("effects", 1, where))


def test_beams_bear_no_effects():
    bending = beam(1.0, 10.0, 1.0, elements=2)
    name = bending.elements[0].id
    with pytest.raises(DescriptionError, match=r"of a beam\. Effects sit on spring elements"):
        read({"effect": "coulomb", "element": name, "friction_n": 1.0}, rig=bending)
    node = bending.nodes[-1].id
    with pytest.raises(DescriptionError, match=r"of a beam\. Effects sit on spring elements"):
        read({"effect": "added_mass", "node": node, "dm_kg": 1.0}, rig=bending)

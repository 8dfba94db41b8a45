"""Units of files: what is known is turned into SI once, what is not is said or asked."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime_services.files import Record, RecordError, accelerations, in_si, mixed_units
from slowtime_services.files.units import sensitivity_of, unit_of

# NIST Special Publication 811, appendix B.8: factors for units listed alphabetically.
NIST = {
    "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "m/s**2": 1.0, "m·s-2": 1.0, "m/sec^2": 1.0,
    "m/s/s": 1.0, "ms^-2": 1.0, "m/(s^2)": 1.0, "g": 9.80665, "G": 9.80665, "mg": 9.80665e-3,
    "Gal": 1e-2, "gal": 1e-2, "mGal": 1e-5, "cm/s^2": 1e-2, "cm/sec/sec": 1e-2, "cm/s2": 1e-2,
    "mm/s²": 1e-3, "in/s^2": 2.54e-2, "in/sec2": 2.54e-2, "ft/s^2": 3.048e-1, "µg": 9.80665e-6,
    "[g]": 9.80665, "(m/s^2)": 1.0,
}  # fmt: skip
OTHER = ("", "V", "N", "°C", "deg/s", "rad/s^2", "s", "counts", "m/s^3", "kg", "Pa", "strain")


def record(samples, units, channels=None):
    channels = channels or tuple(f"a{i}" for i in range(len(units)))
    return Record(samples=samples, rate_hz=100.0, channels=channels, units=tuple(units))


@pytest.mark.parametrize("unit", NIST)
def test_accelerations_are_worth_what_the_tables_say(unit):
    found = in_si(record(np.array([[1.0], [-2.0]]), [unit]))
    assert found.units == ("m/s^2",)
    np.testing.assert_allclose(found.samples[:, 0], [NIST[unit], -2 * NIST[unit]], rtol=1e-12)
    assert bool(found.notes) == (NIST[unit] != 1.0)


@pytest.mark.parametrize("unit", OTHER)
def test_what_is_no_motion_stays_what_it_is(unit):
    made = record(np.array([[1.0], [-2.0]]), [unit])
    found = in_si(made)
    assert found.units == (unit,)
    assert found.samples is made.samples


@given(
    units=st.lists(st.sampled_from([*NIST, *OTHER, "mm", "in/s"]), min_size=1, max_size=6),
    seed=st.integers(0, 9),
)
def test_nothing_is_turned_twice(units, seed):
    samples = np.random.default_rng(seed).normal(size=(3, len(units)))
    once = in_si(record(samples, units))
    twice = in_si(dataclasses.replace(once, notes=()))
    np.testing.assert_array_equal(twice.samples, once.samples)
    assert twice.units == once.units
    assert not [note for note in twice.notes if note.startswith("Turned")]


@given(st.lists(st.sampled_from(list(NIST)), min_size=2, max_size=6))
def test_one_motion_in_many_units_is_one_motion(units):
    motion = np.random.default_rng(0).normal(size=5)
    samples = np.column_stack([motion / NIST[unit] for unit in units])
    found = in_si(record(samples, units))
    assert mixed_units(found.channels, found.units) == ""
    np.testing.assert_allclose(found.samples, np.repeat(motion[:, None], len(units), axis=1))


@pytest.mark.parametrize(
    ("unit", "sensitivity", "worth"),
    [
        ("V", "100mV/g", 98.0665),
        ("mV", "100 mV/g", 0.0980665),
        ("V", "10.2 mV/(m/s^2)", 1 / 0.0102),
        ("mV", "10.2 mV/m/s^2", 1 / 10.2),
        ("V", "1 V/g", 9.80665),
        ("volts", "9.81 m/s^2/V", 9.81),
        ("", "256LSB/g", 9.80665 / 256),
        ("counts", "16384 counts/g", 9.80665 / 16384),
        ("V", "20 V/(m/s)", 0.05),
        ("V", "0.1 V/mm", 0.01),
    ],
)
def test_volts_and_counts_are_worth_what_the_sensitivity_says(unit, sensitivity, worth):
    found = in_si(record(np.ones((2, 1)), [unit]), sensitivities=[sensitivity])
    np.testing.assert_allclose(found.samples, worth, rtol=1e-12)
    assert found.units[0] in ("m/s^2", "m/s", "m")
    assert sensitivity.replace(" ", "") in found.notes[0].replace(" ", "")


@pytest.mark.parametrize("text", ["", "100", "mV", "100 pC/g", "100 mV/kg", "-3 mV/g", "0mV/g"])
def test_what_is_no_sensitivity_is_refused_with_an_example(text):
    with pytest.raises(ValueError, match="100mV/g"):
        sensitivity_of(text)


def test_each_channel_has_its_own_unit_and_sensitivity():
    made = record(np.ones((2, 4)), ["V", "V", "", "g"])
    found = in_si(
        made, units=["a2=in/s^2", "a3=mg"], sensitivities=["100mV/g", "a1=10mV/(m/s^2)"]
    )
    np.testing.assert_allclose(found.samples[0], [98.0665, 100.0, 0.0254, 9.80665e-3])
    assert found.units == ("m/s^2",) * 4
    said = " ".join(found.notes)
    assert "a3 is in g; mg was given and is used" in said
    assert "a2 from in/s^2 (times 0.0254)" in said


@pytest.mark.parametrize(
    ("units", "given", "said"),
    [
        (["", ""], ["100mV/g"], "a0 is in no stated unit.*--unit a0=mV"),
        (["g", "V"], ["a0=100mV/g"], "a0 is in g; .* of volts"),
        (["V", "V"], ["a0=256LSB/g"], "a0 is in V; .* of counts"),
        (["V", "g"], ["b=100mV/g"], "No column is called 'b'"),
        (["V", "g"], ["a0="], "gives no sensitivity"),
    ],
)
def test_a_sensitivity_without_a_signal_is_a_question(units, given, said):
    with pytest.raises(RecordError, match=said):
        in_si(record(np.ones((2, 2)), units), sensitivities=given)


def test_volts_without_a_sensitivity_are_said_to_be_volts():
    found = in_si(record(np.ones((2, 2)), ["V", "g"]))
    assert found.units == ("V", "m/s^2")
    assert any(
        "Left in volts, because no sensitivity is known: a0" in note for note in found.notes
    )
    assert mixed_units(found.channels, found.units) == "a0 in V; a1 in m/s^2"


def test_grams_and_milligauss_are_no_accelerations():
    names = ("MagX", "load_cell", "weight", "ax")
    found = in_si(record(np.ones((2, 4)), ["mG", "g", "g", "mG"], names))
    assert found.units == ("mG", "g", "g", "m/s^2")
    assert accelerations(names, ("mG", "g", "g", "mG")) == ("ax",)
    assert unit_of("g", "magnitude") is not None


def test_a_g_that_is_left_is_noted():
    found = in_si(record(np.ones((2, 3)), ["mG", "g", "g"], ("MagX", "load_cell", "ax")))
    note = next(text for text in found.notes if "no acceleration" in text)
    assert "MagX in mG, load_cell in g. If they are accelerations" in note
    assert "ax" not in note.partition("If they")[0]


@pytest.mark.parametrize(
    "name",
    [
        "damaged_acc_1", "image_acc", "overload_acc", "reinforced_acc", "imageX", "overload",
        "reinforced beam", "load_acc_1", "forceAccZ", "AccMag", "gForceX", "G-force", "massif",
        "payloadAcc", "magnitude", "",
    ],
)  # fmt: skip
def test_g_is_an_acceleration_unless_whole_words_say_otherwise(name):
    assert unit_of("g", name) == unit_of("g")


@pytest.mark.parametrize(
    "name",
    ["mag", "MAGX", "mag1", "magnetometer_y", "LoadCell", "loadcell2", "force", "Force-1",
     "MassFlow", "mass_2", "Gesamtgewicht", "Federkraft", "field gauss", "HTTPLoad"],
)  # fmt: skip
def test_g_of_a_name_of_another_quantity_is_no_acceleration(name):
    assert unit_of("g", name) is None


@pytest.mark.parametrize("kind", [np.int16, np.float32])
def test_samples_of_few_bits_stay_small(kind):
    found = in_si(record(np.ones((2, 1), dtype=kind), ["g"]))
    assert found.samples.dtype == np.float32

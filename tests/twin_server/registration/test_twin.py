"""Registrations: what is said of a twin is whole, sensible, or refused with the cure."""

import math

import pytest
from pydantic import ValidationError

from twin_server.registration.nominal import Covariates, Nominal
from twin_server.registration.thresholds import Alarm
from twin_server.registration.twin import (
    MODEL_EXAMPLE,
    Registration,
    WrongRegistrationsError,
    registrations,
)


def test_physical_and_modal_quantities_say_the_same():
    frequency, damping = Nominal(
        mass_kg=2.0, damping_n_s_per_m=4.0, stiffness_n_per_m=800.0
    ).modal
    assert frequency == pytest.approx(20 / (2 * math.pi))
    assert damping == pytest.approx(4.0 / (2 * math.sqrt(1600.0)))


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"damping_ratio": 0.02},
        {"mass_kg": 1.0},
        {"mass_kg": 1.0, "stiffness_n_per_m": 9.0},
        {"frequency_hz": 3.0, "mass_kg": 1.0},
        {"frequency_hz": 3.0, "mass_kg": 1.0, "damping_n_s_per_m": 1.0, "stiffness_n_per_m": 9},
        {"damping_ratio": 0.1, "mass_kg": 1, "damping_n_s_per_m": 1, "stiffness_n_per_m": 9},
    ],
)
def test_half_a_nominal_model_or_two_are_refused(given):
    with pytest.raises(ValidationError, match=r"given twice, or not whole\. Give freq"):
        Nominal(**given)


def test_an_overdamped_model_is_refused():
    with pytest.raises(ValidationError, match=r"nothing would ring.*below 2 sqrt"):
        Nominal(mass_kg=1.0, damping_n_s_per_m=20.0, stiffness_n_per_m=100.0)


@pytest.mark.parametrize("limits", [{}, {"below": 0.0, "above": 1.0}])
def test_an_alarm_has_one_limit(limits):
    with pytest.raises(ValidationError, match=r"has one limit. Give below or above"):
        Alarm(quantity="mass_change", **limits)


@pytest.mark.parametrize("damping", [{}, {"damping_ratio": 0.0}])
def test_both_need_a_damping_ratio(damping):
    nominal = {"frequency_hz": 3.0, **damping}
    with pytest.raises(ValidationError, match=r"told apart by damping.*nominal.damping_ratio"):
        Registration(changes="both", nominal=nominal)


def test_it_is_written_and_read_without_loss():
    registration = Registration(
        name="Bridge",
        changes="both",
        nominal={"frequency_hz": 1 / 3, "damping_ratio": 0.1},
        alarms=[{"quantity": "stiffness_change", "below": -0.1}],
    )
    assert Registration.from_json(registration.to_json()) == registration
    assert Registration.model_validate(registration.to_dict()) == registration


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("r.toml", '["lab.beam"]\nchanges = "mass"\nnominal = {frequency_hz = 3.0}\n'),
        ("r.json", '{"lab.beam": {"changes": "mass", "nominal": {"frequency_hz": 3.0}}}'),
    ],
)
def test_a_file_of_registrations_is_read(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    expected = Registration(changes="mass", nominal={"frequency_hz": 3.0})
    assert registrations(tmp_path / name) == {"lab.beam": expected}
    assert registrations(None) == {}


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("r.toml", "=", r"cannot be read as registrations.*Give a .toml or .json"),
        ("r.json", "[1]", r"is not a valid twin's id. Give SITE.ASSET"),
        ("r.json", '{"beam": {}}', r"'beam' is not a valid twin's id"),
        ("r.json", '{"lab.beam": {"chages": "mass"}}', r"at lab.beam.chages, 'mass' was given"),
        (
            "r.json",
            '{"lab.beam": {"learn_epochs": 0}}',
            r"at lab.beam.learn_epochs, 0 was given",
        ),
        ("none.json", None, r"cannot be read as registrations"),
    ],
)
def test_a_wrong_file_of_registrations_says_where_and_why(tmp_path, name, text, says):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(WrongRegistrationsError, match=says):
        registrations(tmp_path / name)


def of_elements(**more):
    return {"changes": "elements", "model": MODEL_EXAMPLE["model"], **more}


def test_a_twin_of_elements_is_written_and_read_without_loss():
    registration = Registration.model_validate(MODEL_EXAMPLE)
    assert Registration.from_json(registration.to_json()) == registration
    assert Registration.model_validate(registration.to_dict()) == registration
    assert registration.structure().free == ("storey1", "storey2", "floor2.mass")
    assert [name for name, _ in registration.watched()] == list(registration.structure().free)
    everything = Registration(**of_elements()).structure()
    assert everything.free == ("storey1", "storey2")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"changes": "elements"}, r"without a model.*Give a model, and changes='elements'"),
        ({"parameters": {"storey1": 0.1}}, r"'stiffness' was given with parameters"),
        (
            of_elements(parameters={"attic": 0.1}),
            r"attic may change.*Allowed: storey1, storey2",
        ),
        (of_elements(parameters={}), r"at least 1 item"),
        (of_elements(nominal={"frequency_hz": 3.0}), r"Leave `nominal` out"),
        (
            of_elements(alarms=[{"quantity": "attic", "below": 0.0}]),
            r"An alarm on 'attic'.*Allowed: .*storey2",
        ),
        (
            {"alarms": [{"quantity": "elements", "below": 0.0}]},
            r"An alarm on 'elements'.*Allowed: frequency_hz",
        ),
        (
            of_elements(model={**MODEL_EXAMPLE["model"], "sensors": []}),
            r"No sensor of the model is on something that moves",
        ),
    ],
)
def test_a_model_and_parameters_that_do_not_go_together_are_refused(given, says):
    with pytest.raises(ValidationError, match=says):
        Registration.model_validate(given)


def test_a_model_that_contradicts_itself_is_refused_by_name():
    model = {**MODEL_EXAMPLE["model"], "nodes": MODEL_EXAMPLE["model"]["nodes"][:1]}
    with pytest.raises(ValidationError, match=r"No node is called 'floor2'"):
        Registration(**of_elements(model=model))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"names": []}, "at least 1"),
        ({"names": ["t", "t"]}, "name one twice"),
        ({"names": ["t"], "temperature": "x"}, r"x is none of the covariates.*: t\."),
        ({"names": ["t"], "reference": {"load": 1.0}}, "load is none of the covariates"),
        ({"names": ["t"], "train_epochs": 20}, "greater than or equal to 30"),
        ({"names": ["t"], "time_between_false_alarms": 0.0}, "greater than 0"),
        ({"names": ["t"], "colour": "red"}, "Extra inputs"),
    ],
)
def test_covariates_that_make_no_sense_are_refused(given, says):
    with pytest.raises(ValidationError, match=says):
        Registration(covariates=given)


def test_the_temperature_is_known_by_its_name_or_by_being_told():
    assert Covariates(names=["load_kg", "temperature_c"]).hinge == 1
    assert Covariates(names=["load_kg", "deck"]).hinge is None
    assert Covariates(names=["load_kg", "deck"], temperature="deck").hinge == 1


def test_covariates_do_not_go_with_what_is_smoothed_or_holds_at_no_temperature():
    weather = {"names": ["temperature_c"]}
    with pytest.raises(ValidationError, match="frequency_source='measured'"):
        Registration(covariates=weather, frequency_source="smoothed")
    nominal = {"frequency_hz": 3.0, "damping_ratio": 0.02}
    with pytest.raises(ValidationError, match=r"Give covariates\.reference for temperature_c"):
        Registration(covariates=weather, nominal=nominal)
    at = {**weather, "reference": {"temperature_c": 10.0}}
    made = Registration(covariates=at, nominal=nominal)
    assert Registration.from_json(made.to_json()) == made


@pytest.mark.parametrize(
    "given",
    [
        {"name": "Tower\u202e"},
        {"name": "Tower\n"},
        {"covariates": {"names": ["temperature_c\u2066"]}},
        {"covariates": {"names": ["a"], "reference": {"a\x1b": 1.0}}},
        {"alarms": [{"quantity": "stiffness_change\u200f", "below": -0.1}]},
    ],
)
def test_names_with_characters_that_are_not_seen_are_refused(given):
    with pytest.raises(ValidationError, match=r"has U\+\w{4}"):
        Registration.model_validate(given)


def test_a_twin_registered_before_names_were_held_to_that_is_read_again():
    stored = Registration(name="Tower").to_json().replace("Tower", r"Tow\u202eer")
    assert Registration.from_json(stored).name == "Tow\u202eer"


def test_a_line_break_behind_an_id_is_no_id(tmp_path):
    (tmp_path / "known.json").write_text('{"lab.beam\\n": {}}')
    with pytest.raises(WrongRegistrationsError, match=r"is not a valid twin's id"):
        registrations(tmp_path / "known.json")

"""Registrations: what is said of a twin is whole, sensible, or refused with the cure."""

import math

import pytest
from pydantic import ValidationError

from twin_server.registration import (
    Alarm,
    Nominal,
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
        ("r.json", "[1]", r"is no twin's id. Give SITE.ASSET"),
        ("r.json", '{"beam": {}}', r"'beam' is no twin's id"),
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

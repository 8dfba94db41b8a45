"""Faults of sensors as the report of a history tells them."""

from slowtime.dynamics.effects import Effect, Place
from slowtime.history_diagnosis.forecasting.mixture import MixtureModel
from slowtime.history_diagnosis.reporting.parameters import ReportUnits
from slowtime.history_diagnosis.reporting.summary import _sensor_faults
from slowtime.history_diagnosis.selection.mode_departures import ModeDeparture

# Of no account to a mode that departs: only a swapped one is scaled by the model.
MODEL = object.__new__(MixtureModel)


def test_a_mode_that_departs_is_named_with_size_and_time_in_the_units_of_the_report():
    departed = ModeDeparture(1, 9.5, -0.019, 0.98)
    (fault,) = _sensor_faults(MODEL, None, departed, ReportUnits("%", 100.0, "day"))
    assert (fault.family, fault.probability) == ("sensor", 0.98)
    assert fault.effect == Effect("sensor_change", Place("sensor", "mode 1"))
    assert fault.sentence == (
        "Mode 1 alone changes by −1.9 % at 9.5 day, the others do not: look at its sensor or "
        "tracking."
    )
    told = {name: (n.value, n.sd, n.unit) for name, n in fault.numbers.items()}
    # No error is known of any of them, and none is made up.
    assert told == {
        "mode": (1.0, 0.0, "1"),
        "change": (-1.9, 0.0, "%"),
        "time": (9.5, 0.0, "day"),
    }


def test_where_no_sensor_is_at_fault_nothing_is_told():
    assert _sensor_faults(MODEL, None, None, ReportUnits("%", 100.0, "day")) == []

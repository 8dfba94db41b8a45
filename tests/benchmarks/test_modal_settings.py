"""Estimates are compared with the mode that they are nearest to."""

from benchmarks.methods.modal_settings import Cell, SettingTally


def test_the_estimate_of_one_of_two_close_modes_is_not_the_other_missed():
    tally = SettingTally()
    tally.add(Cell("none", "1200", "close", "complete"), 1.0, [[2.1629, 0.001, 0.01, 0.001]])
    assert tally.held == ([True], [True])
    # Modes at 1.0, 2.1 and 4.4 Hz are not told.
    assert tally.refused == 3
    assert tally.strangers == 0

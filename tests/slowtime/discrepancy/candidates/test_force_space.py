"""What a law does beyond all bounds counts as nothing."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slowtime.discrepancy.candidates.force_space import ForceSpace


@pytest.mark.parametrize("beyond", [np.inf, np.nan, 1e200])
def test_a_force_without_bounds_is_none_in_every_record(beyond):
    space: Any = object.__new__(ForceSpace)
    lines = SimpleNamespace(rate_hz=10.0, frequency_hz=np.zeros(17))
    space.located = SimpleNamespace(lines=(lines, lines))
    calm, wild = np.ones((32, 2)), np.ones((32, 2))
    wild[7, 1] = beyond
    for spectrum in space.lines_of([wild, calm]):
        assert np.isfinite(np.abs(spectrum) ** 2).all()
        assert np.abs(spectrum[:, 0]).any()
        assert not spectrum[:, 1].any()

"""A history that somebody kept in a table, as a diagnosis in slow time wants it."""

import numpy as np
import pytest

from slowtime_services.diagnose.history_table import read_history
from slowtime_services.files import RecordError


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_a_frequency_is_a_change_about_its_median_and_the_rest_may_drive_it(tmp_path):
    found = read_history(
        written(
            tmp_path / "bridge.csv",
            "slow_time,frequency_hz,frequency_hz_sd,temperature_c,note\n"
            "0,2.0,0.02,10,a\n1,2.2,0.02,12,b\n2,,0.02,13,c\n3,1.8,0.04,,d\n",
        )
    )
    assert (found.of, found.quantity) == ("bridge", "frequency_ratio")
    assert found.time.tolist() == [0, 1, 3]
    assert found.value == pytest.approx([0.0, 0.1, -0.1])
    assert found.sd == pytest.approx([0.01, 0.01, 0.02])
    names = [(one.name, one.unit) for one in found.covariates]
    assert names == [("temperature_c", "°C"), ("note", "")]
    assert found.covariates[0].values.tolist()[:2] == [10, 12]


def test_without_a_standard_deviation_it_is_taken_from_neighbours(tmp_path):
    rng = np.random.default_rng(1)
    change = np.linspace(0.0, 1.0, 4000) + 0.01 * rng.standard_normal(4000)
    np.savez(tmp_path / "h.npz", t=np.arange(4000), stiffness_change=change)
    found = read_history(tmp_path / "h.npz")
    assert found.quantity == "stiffness_change"
    assert found.value == pytest.approx(change)
    assert found.sd == pytest.approx(np.full(4000, 0.01), rel=0.05)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("when,frequency_hz\n0,1\n", "no column of the time.*slow_time.*when, frequency_hz"),
        ("t,f\n0,1\n", "no column of the value.*stiffness_change.*there are: t, f"),
        ("t,frequency_hz\n0,1\n1\n", "is not a table"),
    ],
)
def test_what_is_missing_is_said(tmp_path, text, says):
    with pytest.raises(RecordError, match=says):
        read_history(written(tmp_path / "h.csv", text))

"""Positions outlast the process, and damage is said."""

import pytest

from slowtime_services.outputs import Positions
from slowtime_services.outputs.positions import Position, WrongPositionsError


def test_a_position_outlasts_the_process(tmp_path):
    path = tmp_path / "folder" / "db.json"
    first = Positions(path)
    assert first.of("lab.beam") is None
    first.move("lab.beam", Position("b1:12", 4))
    first.move("lab.tower", Position("b2:0", 0))
    again = Positions(path)
    assert again.of("lab.beam") == Position("b1:12", 4)
    assert again.of("lab.tower") == Position("b2:0", 0)
    assert [one.name for one in path.parent.iterdir()] == ["db.json"]


@pytest.mark.parametrize("content", ["{", "[]", '{"lab.beam": 3}', '{"lab.beam": ["b1:1"]}'])
def test_a_damaged_file_is_named_and_not_begun_anew(tmp_path, content):
    path = tmp_path / "db.json"
    path.write_text(content)
    with pytest.raises(WrongPositionsError, match="delete it to send from the beginning"):
        Positions(path)

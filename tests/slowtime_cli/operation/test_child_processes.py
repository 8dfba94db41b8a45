"""Children of a command: one of them is ended and started again, another ends by itself."""

import pytest

from slowtime_cli.operation.child_processes import children


def test_one_child_is_ended_and_started_again_and_keeps_its_log(tmp_path):
    with children(tmp_path) as family:
        family.start("one", ["--version"])
        family.stop("one")
        family.start("one", ["--version"])
        assert family._of("one").wait(120) == 0
        assert family.status("one") == 0
        family.check(ending=("one",))
        with pytest.raises(RuntimeError, match="one ended with status 0"):
            family.check()
    assert len((tmp_path / "one.log").read_text().splitlines()) in (1, 2)

import signal
import time
from pathlib import Path

import pytest

from slowtime_cli.shared.connection import TIMEOUT_S, connected
from slowtime_cli.shared.terminal import until_signalled
from slowtime_services.bus import BusUnreachableError

NOBODY = "tcp/127.0.0.1:1"


def test_a_router_that_does_not_answer_is_told_after_the_patience():
    began = time.monotonic()
    with (
        until_signalled() as stop,
        pytest.raises(BusUnreachableError, match="No router answers"),
        connected([NOBODY], stop, patience_s=0.3),
    ):
        pass
    assert 0.3 <= time.monotonic() - began < TIMEOUT_S  # which it has by default


def test_the_end_of_a_duration_is_not_taken_for_ctrl_c():
    with (
        until_signalled(0.01) as stop,
        pytest.raises(BusUnreachableError, match="No router answers"),
        connected([NOBODY], stop, patience_s=0.3),
    ):
        pass


def catches(pid: int, number: int) -> bool:
    """Whether a process has set a handler of its own for a signal."""
    words = Path(f"/proc/{pid}/status").read_text().split()
    return bool(int(words[words.index("SigCgt:") + 1], 16) >> (number - 1) & 1)


@pytest.mark.long
@pytest.mark.system
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (("record", "--out", "a.mcap"), 130),
        # The server serves meanwhile, so that its end is one like any other.
        (("twin", "--port", "0", "--database", "twin.sqlite"), 0),
    ],
)
def test_ctrl_c_is_heard_while_a_router_is_waited_for(start, arguments, status):
    started = time.monotonic()
    process = start("-v", *arguments, "--connect", NOBODY)
    deadline = started + 300
    while not catches(process.pid, signal.SIGTERM):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    time.sleep(0.5)  # until Zenoh has begun to look for the router
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, out) == (status, ""), err
    assert "Traceback" not in err
    # It goes faster than it waits for a router. A server that is starting ends once it has
    # started, which on a busy machine takes as long again as what came before.
    assert time.monotonic() - began < max(5.0, 3.0 * (began - started))

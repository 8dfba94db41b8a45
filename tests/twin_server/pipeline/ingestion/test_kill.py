"""A server killed at any moment goes on as if it had not been."""

import signal
import subprocess
import sys

import pytest

from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

CHILD = """
import sys
from pathlib import Path
from slowtime_services.bus import Sample
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

database, messages = Path(sys.argv[1]), Path(sys.argv[2])
pipeline = Pipeline(TwinSettings(pipeline={"batch_messages": 7}), SqliteStore(database))
for line in messages.read_bytes().splitlines():
    pipeline.ingest([Sample("slowtime/v1/lab/beam/features", line, None, True)])
    print("taken", flush=True)
sys.stdin.read()
"""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, ageing, sample):
    """Samples as they come, and the store of a server that nobody killed."""
    samples = [sample(message) for message in ageing(4000)]
    expected = SqliteStore(tmp_path_factory.mktemp("undisturbed") / "twin.sqlite")
    Pipeline(TwinSettings(), expected).ingest(samples)
    # Out of order here and there, so that a part is held on disk when the end comes.
    for i in range(3, 3990, 11):
        samples[i], samples[i + 4] = samples[i + 4], samples[i]
    yield samples, expected
    expected.close()


@pytest.mark.parametrize(
    "after", [200, *(pytest.param(after, marks=pytest.mark.long) for after in (50, 500))]
)
def test_sigkill_and_another_start_give_the_undisturbed_history(tmp_path, undisturbed, after):
    samples, expected = undisturbed
    # It never has all of them, however long it lives.
    (tmp_path / "messages").write_bytes(b"\n".join(s.payload for s in samples[:3000]))
    database = tmp_path / "killed.sqlite"
    arguments = [sys.executable, "-c", CHILD, str(database), str(tmp_path / "messages")]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        for _ in range(after):
            assert child.stdout.readline() == b"taken\n"
        child.send_signal(signal.SIGKILL)
        child.wait()

    store = SqliteStore(database)
    survived = store.count("lab.beam")
    assert 0 < survived < 4000
    Pipeline(TwinSettings(), store).ingest(samples)
    assert store.digest("lab.beam") == expected.digest("lab.beam")
    for points in (20, 300):
        (history, bands), (expected_history, expected_bands) = (
            one.thinned("lab.beam", points) for one in (store, expected)
        )
        assert history.states.tobytes() == expected_history.states.tobytes()
        assert bands is not None
        assert expected_bands is not None
        assert bands.to_bytes() == expected_bands.to_bytes()
    assert [e.body for e in store.events("lab.beam") if e.derived] == [
        e.body for e in expected.events("lab.beam") if e.derived
    ]
    store.close()

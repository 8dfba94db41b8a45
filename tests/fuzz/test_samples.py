"""A sample of what `make fuzz` does at length: same mutations, same laws, other seeds."""

import logging
import resource

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime_schemas.codec import Refused, decode
from slowtime_schemas.streams import STREAMS
from tests.fuzz import files, formats, rest, wire
from tests.fuzz.house import behind_the_door


@pytest.fixture(autouse=True)
def _quietly(caplog):
    caplog.set_level(logging.CRITICAL)


def test_no_message_is_a_fault(capsys):
    counts = wire.run(2_000, seed=11)
    assert counts["accepted"] > 50
    assert counts["refused"] > 1_000


@settings(max_examples=60, deadline=None)
@given(payload=st.binary(max_size=300), stream=st.sampled_from(STREAMS))
def test_no_bytes_are_a_fault(payload, stream):
    with pytest.raises(Refused):
        decode(stream, payload)


def test_no_file_is_a_fault_or_swells():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    counts = files.run(90, seed=12)
    assert {name.split()[1] for name in counts} == {"read", "refused"}
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


@pytest.mark.long
def test_no_file_of_a_known_format_is_a_fault_or_swells():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    counts = formats.run(30, seed=12)
    for kind in formats.MAKERS:
        assert counts[f"{kind} refused"] + counts[f"{kind} read in part"] > 3, kind
        assert counts[f"{kind} read"] > 0, kind
    assert counts[f"readers that were ended after {formats.PATIENCE_S:g} s"] == 0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


@pytest.fixture(scope="module")
def house():
    with behind_the_door() as opened:
        yield opened


@pytest.mark.long
def test_what_was_let_in_the_estimators_stand(house):
    """Asked of the server: its worker has lived through all that `accepted` let in."""
    guard, document, headers = house
    counts = rest.run(guard, document, 25, 13, headers)
    assert sum(counts.values()) >= 25
    assert not counts["5xx"]

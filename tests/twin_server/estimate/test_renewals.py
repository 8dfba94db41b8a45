"""A renewal that the edge announces becomes an event, once, however the stream is cut."""

import itertools

import pytest

from slowtime_schemas.quantities import RENEWALS
from slowtime_services.simulate import FatigueLoss, SimulatedFrame, SimulatedStructure
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.registration.twin import Registration

NOMINAL = {"frequency_hz": 3.0, "damping_ratio": 0.02}


def readings(features, counts):
    """One message of each count; None where the edge counts nothing."""
    made = [features(i) for i in range(len(counts))]
    return [
        one if count is None else one.model_copy(update={"covariates": {RENEWALS: count}})
        for one, count in zip(made, counts, strict=True)
    ]


def told(messages, cuts=()):
    """Which readings a renewal belongs to, of a stream cut at `cuts`."""
    registration = Registration.model_validate({"nominal": NOMINAL})
    checkpoint, found = Checkpoint.start(registration), []
    edges = [0, *cuts, len(messages)]
    for first, last in itertools.pairwise(edges):
        part = messages[first:last]
        done = estimate(
            [Twin(registration, checkpoint)], part, [0] * len(part), [0] * len(part)
        )
        checkpoint = Checkpoint.from_json(done.checkpoints[0].to_json())
        found += [first + n.row for n in done.notices[0] if n.kind == "renewed"]
    return found


@pytest.mark.parametrize(
    ("counts", "renewed"),
    [
        ([0, 0, 1, 1, 2], [2, 4]),
        ([3, 3, 3], []),  # of renewals before the first reading nobody was to be told
        ([0, None, 2], [2]),  # a reading that was lost, or said nothing, loses no renewal
        ([2, 0, 0, 1], [3]),  # an edge that began anew counts anew
        ([None, None], []),
    ],
)
def test_a_count_that_rises_is_told_at_the_first_reading_after_it(features, counts, renewed):
    messages = readings(features, counts)
    assert told(messages) == renewed
    assert told(messages, cuts=range(1, len(counts))) == renewed


def test_simulated_structures_count_their_renewals():
    tower = SimulatedStructure(stiffness=FatigueLoss(renewed_after=10.0), seconds=4.0)
    frame = SimulatedFrame(
        stiffness={"storey2": {"kind": "linear", "renewed_after": 20.0, "begins": 5.0}},
        seconds=4.0,
    )
    for structure, counts in ((tower, {0: 0, 9: 0, 10: 1, 25: 2}), (frame, {19: 0, 20: 1})):
        for epoch, count in counts.items():
            assert structure.epoch(epoch)[0].covariates == {RENEWALS: float(count)}
    assert frame.truth(19)["element.storey2"] == pytest.approx(-2e-4 * 14)
    assert frame.truth(20)["element.storey2"] == 0.0
    assert SimulatedStructure(seconds=4.0).epoch(5)[0].covariates == {}

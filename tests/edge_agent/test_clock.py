"""A device whose rate is not what it promises, from raw samples to the message."""

import dataclasses
import functools

import numpy as np
import pytest

from edge_agent.pipeline import Edge, rerun
from edge_agent.publish.publisher import raw_message
from edge_agent.settings import Origin, Processing
from slowtime.signals.block import Block, RateCorrection
from slowtime.signals.clock.sampling_clock import SamplingClock
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features
from slowtime_schemas.raw import encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import block_of, record_of
from tests.slowtime.identification.oscillators import record
from tests.slowtime.signals.clock.latencies import Messages, messages

NOMINAL_HZ, PER_MESSAGE = 100.0, 20
ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="live", slow_time_unit="s")


def blocks(samples, clocks, start_ns=10**18):
    """A block of `PER_MESSAGE` rows each, with what was known of the clock by then."""
    for number, clock in enumerate(clocks):
        first = number * PER_MESSAGE
        yield Block(
            samples=samples[first : first + PER_MESSAGE],
            rate_hz=NOMINAL_HZ,
            first_index=first,
            start_ns=start_ns + round(first * 1e9 / NOMINAL_HZ),
            channels=("acc",),
            units=("m/s^2",),
            clock=clock,
        )


def told(stream, processing=None):
    """Every message of a stream."""
    edge = Edge.of(processing or Processing(), ORIGIN)
    state = edge.start()
    out: tuple[Features, ...] = ()
    for block in stream:
        state, messages_ = edge.step(state, block)
        out += messages_
    return out + edge.finish(state)[1]


def sampled(seed, *, correction, seconds=130.0, f=3.0, z=0.01):
    """Samples at the true rate, of a structure at `f` Hz."""
    rng = np.random.default_rng(seed)
    rate = NOMINAL_HZ * (1 + correction)
    return record(rng, f=f, z=z, rate=rate, seconds=seconds, noise=0.03)


@pytest.fixture(scope="module")
def fast():
    """One per cent fast."""
    return sampled(1, correction=0.01)


@pytest.fixture(scope="module")
def steady(fast):
    """Messages of what is one per cent fast, by one word on the clock all the time."""
    return functools.cache(
        lambda clock: told(blocks(fast, [clock] * (len(fast) // PER_MESSAGE)))
    )


def test_a_clock_that_is_right_changes_nothing_but_its_own_word(steady):
    without = steady(None)
    exact = steady(RateCorrection(relative=0.0, sd=0.0))
    assert [encode(message) for message in exact] == [encode(message) for message in without]


def test_a_correction_moves_every_frequency_and_leaves_damping(steady):
    for raw, right in zip(
        steady(None), steady(RateCorrection(relative=0.01, sd=0.0)), strict=True
    ):
        one, other = raw.modes[0], right.modes[0]
        ratio = other.frequency_hz.value / one.frequency_hz.value
        assert ratio == pytest.approx(1.01, rel=1e-5)
        assert other.damping_ratio.value == pytest.approx(one.damping_ratio.value, rel=1e-3)
        smoothed = other.smoothed_frequency_hz.value / one.smoothed_frequency_hz.value
        assert smoothed == pytest.approx(1.01, rel=1e-5)


def test_the_error_of_the_clock_is_added_and_not_averaged_away(steady):
    known = steady(RateCorrection(relative=0.01, sd=0.0))[-1]
    vague = steady(RateCorrection(relative=0.01, sd=0.01))[-1]
    for name in ("frequency_hz", "smoothed_frequency_hz"):
        before, after = getattr(known.modes[0], name), getattr(vague.modes[0], name)
        assert after.value == before.value
        assert after.sd == pytest.approx(np.hypot(before.sd, before.value * 0.01 / 1.01))
    covariance = [
        mode.correlation * mode.frequency_hz.sd for mode in (known.modes[0], vague.modes[0])
    ]
    assert covariance[0] == pytest.approx(covariance[1])
    assert "clock_uncertain" in vague.quality.flags
    assert "clock_uncertain" not in known.quality.flags


@pytest.mark.long
def test_a_correction_found_late_counts_for_windows_before(fast, steady):
    count = len(fast) // PER_MESSAGE
    unknown, found = (
        RateCorrection(relative=0.0, sd=0.01),
        RateCorrection(relative=0.01, sd=1e-5),
    )
    late = told(
        blocks(fast, [unknown] * (count // 2 - 10) + [found] * (count - count // 2 + 10))
    )
    early = steady(found)
    assert late[-1].modes[0].smoothed_frequency_hz.value == pytest.approx(
        early[-1].modes[0].smoothed_frequency_hz.value, rel=1e-5
    )


@pytest.mark.long
def test_several_modes_carry_the_error_of_the_clock_too(fast):
    processing = Processing.model_validate({"extract": {"method": "modes"}})
    clocks = [RateCorrection(relative=0.01, sd=0.02)] * (len(fast) // PER_MESSAGE)
    for message in told(blocks(fast, clocks), processing):
        assert "clock_uncertain" in message.quality.flags
        mode = min(message.modes, key=lambda mode: abs(mode.frequency_hz.value - 3.0))
        assert abs(mode.frequency_hz.value - 3.0) < 0.05
        assert mode.frequency_hz.sd > 3.0 * 0.02 / 1.011


@pytest.mark.long
def test_times_of_windows_follow_the_clock(fast):
    clock = RateCorrection(relative=0.01, sd=1e-6)
    stream = [
        dataclasses.replace(block, start_ns=10**18 + round(block.first_index * 1e9 / 101.0))
        for block in blocks(fast, [clock] * (len(fast) // PER_MESSAGE))
    ]
    for message in told(stream):
        begins = round((message.start_ns - 10**18) * 101.0 / 1e9)
        assert message.start_ns - 10**18 == pytest.approx(begins * 1e9 / 101.0, abs=3)
        length = (message.t_ns - message.start_ns) * 101.0 / 1e9
        assert length == pytest.approx(message.quality.samples - 1, abs=1e-6)


def test_recorded_blocks_keep_the_clock_and_give_the_same_bytes_again(fast):
    clocks = [RateCorrection(relative=0.01 / k, sd=0.01 / k) for k in range(1, 400)]
    stream = list(blocks(fast, clocks))
    payloads = [
        encode_raw(*raw_message(block, ORIGIN, number)) for number, block in enumerate(stream)
    ]
    again = [block_of(payload) for payload in payloads]
    assert [block.clock for _, block in again] == clocks
    assert list(rerun(again, Processing())) == [encode(message) for message in told(stream)]


def test_a_record_of_recorded_blocks_has_the_rate_of_their_last_features(fast, tmp_path):
    clocks = [RateCorrection(relative=0.01 - 0.01 / k, sd=0.01 / k) for k in range(1, 400)]
    stream = list(blocks(fast, clocks))
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for number, block in enumerate(stream):
            payload = encode_raw(*raw_message(block, ORIGIN, number))
            writer.write(RAW, "lab", "beam", payload, block.start_ns)
    assert record_of(tmp_path / "a.mcap").rate_hz == stream[-1].true_rate_hz


def scores(seeds):
    """Distance of each window's frequency from the truth, and its flags, by arrivals alone."""
    out = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 3])
        correction = float(rng.choice([-0.01, -1e-3, 1e-4, 3e-3, 0.01]))
        f, z = float(rng.uniform(1.0, 10.0)), float(rng.uniform(0.005, 0.02))
        jitter = str(rng.choice(["exponential", "uniform", "gamma", "bimodal"]))
        samples = sampled(seed, correction=correction, seconds=190.0, f=f, z=z)
        given = Messages(
            seconds=190.0,
            rate_hz=NOMINAL_HZ,
            per_message=PER_MESSAGE,
            correction=correction,
            jitter=jitter,
            loss=0.0,
        )
        came = messages(rng, given)
        clock, clocks = SamplingClock(nominal_rate_hz=NOMINAL_HZ), []
        state = clock.start()
        for at in range(len(came.index)):
            state = clock.step(state, came.index[at : at + 1], came.arrival_ns[at : at + 1])
            clocks.append(clock.read(state).rate_correction)
        for message in told(blocks(samples, clocks)):
            out += [
                ((mode.frequency_hz.value - f) / mode.frequency_hz.sd, correction)
                for mode in message.modes[:1]
            ]
    return np.array(out)


@pytest.mark.long
def test_a_clock_wrong_by_a_percent_is_corrected_from_arrivals():
    found = scores(range(5))
    assert len(found) >= 12
    assert np.mean(np.abs(found[:, 0]) < 1.96) > 0.7
    assert np.max(np.abs(found[:, 0])) < 5


@pytest.mark.slow
def test_frequencies_behind_a_wrong_clock_hold_as_often_as_they_say():
    found = scores(range(100))
    assert len(found) > 280
    assert 0.91 <= np.mean(np.abs(found[:, 0]) < 1.96) <= 0.98

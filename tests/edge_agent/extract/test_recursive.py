"""A continuous stream tells all its modes, each hop anew, in bounded memory."""

import dataclasses
import functools
import itertools
import pickle

import numpy as np
import pytest
import scipy.signal as sps
from pydantic import ValidationError

from edge_agent.extract import Extract
from edge_agent.pipeline import Edge
from edge_agent.settings import ExtractSettings, Origin, Processing
from slowtime.signals.block import Block, RateCorrection
from slowtime_schemas.messages import Features

RATE, HZ, DAMPING = 20.0, 2.0, 0.02
ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="recorded")
GIVEN = {
    "method": "recursive",
    "band_hz": (1.5, 3.0),
    "hop_s": 100.0,
    "memory_s": 400.0,
    "smooth": False,
    "covariates": {"temperature_c": "temp"},
}


def whole(seconds=1200, seed=1, **other):
    count = round(seconds * RATE)
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * HZ
    pole = np.exp((-DAMPING + 1j * np.sqrt(1 - DAMPING**2)) * omega / RATE)
    sway = sps.lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], rng.standard_normal(count))
    samples = np.stack([sway, -0.5 * sway, 0.0 * sway], axis=1)
    samples += 0.05 * sway.std() * rng.standard_normal(samples.shape)
    samples[:, 2] = 20.0 + np.arange(count) / count
    given = {
        "samples": samples,
        "rate_hz": RATE,
        "first_index": 0,
        "start_ns": 10**9,
        "channels": ("a", "b", "temp"),
        "units": ("g", "g", "°C"),
    }
    return Block(**{**given, **other})


def cut(block, where):
    edges = [0, *sorted(where), len(block.samples)]
    return [
        dataclasses.replace(
            block,
            samples=block.samples[a:b],
            first_index=block.first_index + a,
            start_ns=block.start_ns + round(a * 1e9 / block.rate_hz),
        )
        for a, b in itertools.pairwise(edges)
    ]


def run(blocks, **more):
    stage = Extract(ExtractSettings(**{**GIVEN, **more}), ORIGIN)
    state = stage.start()
    out: list[Features] = []
    for block in blocks:
        marks = np.zeros((len(block.samples), 2), dtype=int)
        state, features = stage.step(state, block, marks)
        out += features
    return out, state


def each_second(block):
    return cut(block, range(20, len(block.samples), 20))


@functools.cache
def told():
    return tuple(run(each_second(whole()))[0])


def test_each_hop_gives_one_message_and_the_mode_lies_where_it_says():
    out = told()
    assert [message.sequence for message in out] == list(range(12))
    assert [message.quality.samples for message in out] == [2000] * 12
    (mode,) = out[-1].modes
    assert out[-1].method == "ssi"
    assert abs(mode.frequency_hz.value - HZ) < 3 * mode.frequency_hz.sd
    assert abs(mode.damping_ratio.value - DAMPING) < 3 * mode.damping_ratio.sd
    assert mode.shape is not None
    assert mode.shape.re[1] / mode.shape.re[0] == pytest.approx(-0.5, abs=0.05)
    assert mode.identity is not None
    assert out[-1].covariates["temperature_c"] == pytest.approx(20.96, abs=0.01)


def test_a_message_says_that_it_shares_samples_with_the_ones_before():
    out = told()
    assert "overlapping" not in out[0].quality.flags
    assert all("overlapping" in message.quality.flags for message in out[1:])
    # As much as two memories of even weight, or all that has been.
    assert (out[-1].t_ns - out[-1].start_ns) / 1e9 == pytest.approx(800.0)
    assert out[3].start_ns == 10**9


def test_before_modes_are_known_a_message_says_why_it_has_none():
    out, _ = run(each_second(whole(seconds=120)))
    assert out[0].modes == ()
    assert "no_mode" in out[0].quality.flags


@pytest.mark.long
def test_cutting_the_stream_between_hops_changes_no_message():
    hops = set(range(2000, 24_000, 2000))
    out, _ = run(cut(whole(), hops | {17, 5003, 5004}))
    # Means of covariates are sums in another order.
    assert [message.model_copy(update={"covariates": {}}) for message in out] == [
        message.model_copy(update={"covariates": {}}) for message in told()
    ]


@pytest.mark.long
def test_frequencies_are_at_the_true_rate_and_carry_the_error_of_the_clock():
    clock = RateCorrection(relative=0.01, sd=1e-2)
    out, _ = run([dataclasses.replace(block, clock=clock) for block in each_second(whole())])
    for message, nominal in zip(out, told(), strict=True):
        for mode, plain in zip(message.modes, nominal.modes, strict=True):
            value = 1.01 * plain.frequency_hz.value
            assert mode.frequency_hz.value == pytest.approx(value)
            share = np.hypot(1.01 * plain.frequency_hz.sd, 1e-2 * plain.frequency_hz.value)
            assert mode.frequency_hz.sd == pytest.approx(share)
    assert "clock_uncertain" in out[-1].quality.flags


@pytest.mark.long
def test_a_gap_is_counted_and_the_modes_are_kept():
    first, lost, last = cut(whole(), {15_000, 15_200})
    pieces = [*each_second(first), *each_second(last)]
    out, _ = run(pieces, tracking={"confirm": 2})
    assert sum(message.quality.missing for message in out) == len(lost.samples)
    assert out[6].modes[0].identity == out[-1].modes[0].identity is not None


def test_other_channels_begin_a_stream_of_their_own():
    out, _ = run(
        [
            *each_second(whole(seconds=600)),
            *each_second(whole(seconds=100, channels=("x", "y", "temp"), start_ns=601 * 10**9)),
        ]
    )
    assert out[-1].modes == ()
    assert out[-1].start_ns == 601 * 10**9
    assert [message.sequence for message in out] == list(range(7))


def test_an_epoch_ends_with_a_message_whatever_the_hop():
    epochs = [
        dataclasses.replace(whole(seconds=150, seed=n), epoch=n, start_ns=(1 + 200 * n) * 10**9)
        for n in range(4)
    ]
    edge = Edge.of(Processing(extract=ExtractSettings(**GIVEN)), ORIGIN)
    state = edge.start()
    out: list[Features] = []
    for block in epochs:
        state, features = edge.step(state, block)
        out += features
    _, last = edge.finish(state)
    out += last
    assert [message.quality.samples for message in out] == [3000] * 4


@pytest.mark.long
def test_what_is_kept_of_a_stream_does_not_grow():
    _, early = run(each_second(whole(seconds=900)))
    _, late = run(each_second(whole(seconds=1800)))
    assert len(pickle.dumps(late)) < 1.2 * len(pickle.dumps(early))


def test_a_memory_of_too_few_cycles_is_refused_with_the_cure():
    with pytest.raises(ValidationError, match=r"memory_s=20 holds fewer.*at least 33.3333 s"):
        ExtractSettings(**{**GIVEN, "memory_s": 20.0})


def test_more_channels_than_are_read_at_once_are_said_to_be_too_many():
    out, _ = run(each_second(whole(seconds=100)), max_channels=1)
    assert "too_many_channels" in out[0].quality.flags

"""Every mode of a window travels with its shape, and keeps its identity from then on."""

import dataclasses
import types

import numpy as np
import pytest
import scipy.linalg
from pydantic import ValidationError

from edge_agent.extract import Extract
from edge_agent.extract import multiple_modes as several
from edge_agent.pipeline import Edge, rerun
from edge_agent.publish import raw_message
from edge_agent.settings import ExtractSettings, Origin, Processing, TrackingSettings
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import normalised
from slowtime.identification.modes import Mode
from slowtime.identification.tracking import ModeTracker
from slowtime_schemas.codec import decode, encode
from slowtime_schemas.messages import Features
from slowtime_schemas.raw import encode_raw
from slowtime_schemas.streams import FEATURES
from slowtime_services.replay import block_of
from slowtime_services.simulate import Linear, Machine, SensorErrors, SimulatedFrame

ORIGIN = Origin(site="lab", asset="frame", boot="b1", time_base="simulated")
FRAME = SimulatedFrame(
    seconds=120.0,
    rate_hz=50.0,
    stiffness={"storey2": Linear(rate=-0.01)},
    sensor=SensorErrors(noise=0.1, spikes_per_epoch=0.5, dropouts_per_epoch=0.2),
)
SHAPES = {2.0: [1.0, 2.0, 3.0], 6.0: [1.0, 0.1, -1.0], 9.0: [1.0, -2.0, 1.0]}


def mode(frequency, kind="structural", sd=0.005, **other):
    shape = normalised(np.array(SHAPES.get(round(frequency), [1.0, 1.0, 1.0])))
    given = {
        "frequency_hz": Measured(frequency, sd),
        "damping_ratio": Measured(0.01, 0.002),
        "correlation": 0.1,
        "shape": shape,
        "shape_sd": np.full(len(shape), 0.01),
        "kind": kind,
    }
    return Mode(**{**given, **other})


@pytest.fixture
def scripted(monkeypatch):
    """Let identification find what the test says, window after window."""

    def run(windows, numbers=None, channels=None, **settings):
        answers = iter(windows)

        def identify(samples, rate_hz, **_):
            answer = next(answers)
            if isinstance(answer, Exception):
                raise answer
            return types.SimpleNamespace(modes=tuple(answer))

        monkeypatch.setattr(several, "identify_modes", identify)
        stage = Extract(ExtractSettings(method="modes", **settings), ORIGIN)
        (block,) = FRAME.model_copy(update={"sensor": SensorErrors()}).epoch(0)
        out: tuple[Features, ...] = ()
        state = stage.start()
        for place, number in enumerate(numbers or range(len(windows))):
            names = channels[place] if channels else block.channels
            columns = [block.channels.index(name) for name in names]
            heard = dataclasses.replace(
                block,
                samples=block.samples[:500, columns],
                channels=names,
                units=("m/s^2",) * len(names),
                epoch=number,
                first_index=place * 500,
            )
            marks = np.zeros((500, 2), dtype=np.int64)
            state, found = stage.step(state, heard, marks)
            out += found
        state, found = stage.finish(state)
        return (*out, *found), state

    return run


def names(message):
    return [found.identity for found in message.modes]


def test_modes_travel_with_shapes_over_named_channels_in_ascending_order(scripted):
    (message,), _ = scripted([[mode(6.0), mode(2.0, flags=("close",))]])
    assert (message.method, message.channels) == ("ssi", FRAME.channels)
    low, high = message.modes
    assert (low.frequency_hz.value, high.frequency_hz.value) == (2.0, 6.0)
    assert low.shape.re == pytest.approx(np.array([1, 2, 3]) / np.sqrt(14), abs=1e-7)
    assert (low.shape.im, low.shape.sd) == ((0.0, 0.0, 0.0), (0.01, 0.01, 0.01))
    assert (low.flags, low.kind, low.correlation) == (("close",), "structural", 0.1)
    assert decode(FEATURES, encode(message)) == message


def test_an_identity_is_given_after_some_windows_and_lasts_through_failed_ones(scripted):
    three = [mode(2.0), mode(6.0), mode(9.0)]
    windows = [three] * 4 + [ValueError("dead sensor"), [mode(6.0), mode(9.0)], three]
    messages, _ = scripted(windows, tracking={"confirm": 3})
    assert names(messages[0]) == [None] * 3
    first = names(messages[3])
    assert sorted(first) == [1, 2, 3]
    assert messages[4].quality.flags == ("not_usable",)
    assert names(messages[5]) == first[1:]
    assert names(messages[6]) == first


def test_the_line_of_a_machine_is_told_as_such_and_never_followed(scripted):
    windows = [[mode(2.0), mode(4.0, kind="harmonic", sd=1e-4)]] * 8
    messages, _ = scripted(windows)
    line = messages[-1].modes[1]
    assert (line.kind, line.identity, line.smoothed_frequency_hz) == ("harmonic", None, None)
    assert messages[-1].modes[0].identity == 1


def test_each_identity_has_its_own_smoothed_frequency(scripted):
    windows = [[mode(2.0 + 0.001 * n), mode(6.0)] for n in range(8)]
    messages, state = scripted(windows, tracking={"confirm": 2}, ewma_a=0.5, median_window=1)
    low, high = messages[-1].modes
    average = 2.001
    for n in range(2, 8):
        average = 0.5 * (2.0 + 0.001 * n) + 0.5 * average
    assert low.smoothed_frequency_hz.value == pytest.approx(average, rel=1e-9)
    assert high.smoothed_frequency_hz.value == pytest.approx(6.0, rel=1e-9)
    assert messages[0].modes[0].smoothed_frequency_hz is None
    assert {name for name, _ in state.memory.smoothers} == {1, 2}
    messages, _ = scripted(windows, smooth=False)
    assert messages[-1].modes[0].smoothed_frequency_hz is None


def test_other_channels_begin_anew_and_no_name_is_given_twice(scripted):
    pair = FRAME.channels[:2]
    two = [
        mode(f, shape=normalised(np.array(s)), shape_sd=np.full(2, 0.01))
        for f, s in ((2.0, [1.0, 2.0]), (6.0, [1.0, -1.0]))
    ]
    windows = [[mode(2.0), mode(6.0)]] * 3 + [two] * 3
    messages, _ = scripted(
        windows, channels=[FRAME.channels] * 3 + [pair] * 3, tracking={"confirm": 2}
    )
    assert names(messages[2]) == [1, 2]
    assert messages[3].channels == pair
    assert names(messages[3]) == [None, None]
    assert names(messages[5]) == [3, 4]


def test_time_passed_without_windows_counts_when_modes_are_followed(scripted, monkeypatch):
    passed = []
    real = ModeTracker.step

    def step(self, state, modes, *, elapsed=1.0):
        passed.append(elapsed)
        return real(self, state, modes, elapsed=elapsed)

    monkeypatch.setattr(ModeTracker, "step", step)
    windows = [[mode(2.0)], ValueError("no"), [mode(2.0)], [], [mode(2.0)], [mode(2.0)]]
    messages, _ = scripted(windows, numbers=[0, 1, 2, 7, 8, 3])
    assert passed == [1.0, 2.0, 5.0, 1.0, 1.0]
    assert [m.quality.flags for m in messages] == [
        (), ("not_usable",), (), ("no_mode",), (), ()
    ]  # fmt: skip


@pytest.mark.parametrize(
    "broken",
    [
        {"frequency_hz": Measured(np.nan, 0.1)},
        {"damping_ratio": Measured(0.01, np.inf)},
        {"shape": np.array([1.0, 0.0, np.nan]) + 0j},
        {"shape": np.zeros(3, complex)},
        {"shape_sd": np.array([0.1, 0.1, -0.1])},
    ],
)
def test_what_is_not_credible_does_not_travel(scripted, broken):
    (alone,), _ = scripted([[mode(9.0, **broken)]])
    assert (alone.modes, alone.method) == ((), "none")
    assert alone.quality.flags == ("not_credible",)
    (message,), _ = scripted([[mode(2.0), mode(9.0, **broken)]])
    assert [found.frequency_hz.value for found in message.modes] == [2.0]


def test_more_than_a_message_holds_costs_lines_of_machines_first(scripted):
    lines = [mode(10.0 + n, kind="harmonic", sd=1e-4) for n in range(70)]
    (message,), _ = scripted([[*lines, mode(2.0), mode(99.0)]])
    assert len(message.modes) == 64
    assert message.modes[-1].frequency_hz.value == 99.0


def test_more_channels_than_allowed_are_not_read(scripted):
    (message,), _ = scripted([[mode(2.0)]], max_channels=2)
    assert message.quality.flags == ("too_many_channels",)
    (message,), _ = scripted([[mode(2.0)]], max_channels=3)
    assert len(message.modes) == 1


def test_tracking_that_gives_up_before_it_misses_is_refused():
    with pytest.raises(ValidationError, match="raise patience"):
        TrackingSettings(quiet=10, patience=9)


def through(processing, blocks):
    edge = Edge.of(processing, ORIGIN)
    out: tuple[Features, ...] = ()
    state = edge.start()
    for block in blocks:
        state, found = edge.step(state, block)
        out += found
    return out + edge.finish(state)[1]


ALL_MODES = Processing.model_validate(
    {"extract": {"method": "modes", "tracking": {"confirm": 2}}}
)


@pytest.fixture(scope="module")
def epochs():
    """Blocks of a frame with a machine on its second floor, epoch by epoch."""
    frame = FRAME.model_copy(
        update={"machine": Machine(floor="floor2", frequency_hz=4.4, size=0.5)}
    )
    return [frame.epoch(number) for number in range(6)]


@pytest.fixture(scope="module")
def told(epochs):
    """Features of that frame."""
    return through(ALL_MODES, [block for blocks in epochs for block in blocks])


def structural(message):
    """Structural modes of a message, each with the number of the true mode that it is."""
    true = np.array([message.truth[f"mode.{n}.frequency_hz"] for n in (1, 2, 3)])
    for found in message.modes:
        if found.kind == "structural":
            yield 1 + int(np.argmin(np.abs(true - found.frequency_hz.value))), found


@pytest.mark.long
def test_the_modes_of_an_ageing_frame_keep_their_names_and_the_machine_has_none(told):
    assert [message.sequence for message in told] == list(range(6))
    names: dict[int, int] = {}
    sightings = 0
    for message in told:
        for number, found in structural(message):
            off = found.frequency_hz.value - message.truth[f"mode.{number}.frequency_hz"]
            assert abs(off) < 4.5 * found.frequency_hz.sd < 0.05 * found.frequency_hz.value
            sightings += 1
            if found.identity is not None:
                assert names.setdefault(found.identity, number) == number
        (line,) = (found for found in message.modes if found.kind == "harmonic")
        assert line.frequency_hz.value == pytest.approx(4.4, abs=0.01)
        assert line.identity is None
    assert sightings >= 14  # of 18
    assert sorted(names) == sorted(names.values()) == [1, 2, 3]


@pytest.mark.long
def test_shapes_of_an_ageing_frame_are_those_of_its_matrices(told):
    for message in told:
        k1, k2, k3 = (
            k * (1 + message.truth[f"element.storey{n}"])
            for n, k in enumerate(FRAME.storeys_n_per_m, start=1)
        )
        stiffness = np.array([[k1 + k2, -k2, 0], [-k2, k2 + k3, -k3], [0, -k3, k3]])
        _, shapes = scipy.linalg.eigh(stiffness, np.diag(FRAME.floors_kg))
        for number, found in structural(message):
            heard = np.array(found.shape.re) + 1j * np.array(found.shape.im)
            true = normalised(shapes[:, number - 1])
            off = np.abs(heard - true * np.vdot(true, heard))
            assert (off < 5 * np.array(found.shape.sd) + 0.01).all()


@pytest.mark.long
def test_cutting_epochs_changes_no_mode(epochs, told):
    cut = [
        dataclasses.replace(
            block,
            samples=block.samples[first : first + 700],
            first_index=block.first_index + first,
            start_ns=block.start_ns + first * 20_000_000,
        )
        for blocks in epochs[:2]
        for block in blocks
        for first in range(0, len(block.samples), 700)
    ]
    for one, other in zip(through(ALL_MODES, cut), told[:2], strict=True):
        assert len(one.modes) == len(other.modes)
        for a, b in zip(one.modes, other.modes, strict=True):
            assert a.frequency_hz.value == pytest.approx(b.frequency_hz.value, rel=1e-6)
            assert a.shape.re == pytest.approx(b.shape.re, abs=1e-4)


@pytest.mark.long
def test_a_rerun_of_recorded_blocks_gives_the_same_bytes_shapes_and_names(epochs, told):
    recorded = [
        encode_raw(*raw_message(block, ORIGIN, number))
        for number, block in enumerate(block for blocks in epochs[:4] for block in blocks)
    ]
    again = list(rerun(map(block_of, recorded), ALL_MODES))
    assert again == [encode(message) for message in told[:4]]
    assert any(found.identity for found in told[3].modes)

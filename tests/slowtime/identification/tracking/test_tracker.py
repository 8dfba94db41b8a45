import dataclasses
import pickle

import numpy as np
import pytest

from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import normalised
from slowtime.identification.modes import Mode
from slowtime.identification.tracking import ModeTracker

TRACKER = ModeTracker()
CHANNELS = 5


def mode(frequency, shape, *, sd=1e-3, shape_sd=0.02, kind="structural"):
    return Mode(
        frequency_hz=Measured(frequency, sd * frequency),
        damping_ratio=Measured(0.01, 0.002),
        correlation=0.0,
        shape=normalised(np.asarray(shape, dtype=complex)),
        shape_sd=np.full(len(shape), shape_sd),
        kind=kind,
    )


def seen(rng, frequency, shape, *, sd=1e-3, shape_sd=0.02):
    noise = shape_sd / np.sqrt(2) * rng.normal(size=(2, len(shape)))
    noisy = shape + noise[0] + 1j * noise[1]
    return mode(frequency * (1 + sd * rng.normal()), noisy, sd=sd, shape_sd=shape_sd)


def run(epochs, tracker=TRACKER, state=None):
    state = tracker.start() if state is None else state
    brought = []
    for modes in epochs:
        state, tracked = tracker.step(state, modes)
        brought.append(tracked)
    return state, brought


def shapes_of_a_chain(channels=CHANNELS):
    place = np.arange(1, channels + 1)
    rows = [np.sin((2 * k + 1) * np.pi * place / (2 * channels + 1)) for k in range(channels)]
    return [row / np.linalg.norm(row) for row in rows]


@dataclasses.dataclass
class Campaign:
    """Epochs of modes as a year of monitoring brings them, and whose each one truly is."""

    epochs: list[list[Mode]]
    truth: list[list[int | None]]
    modes: int


def campaign(seed, count=2000, channels=CHANNELS):
    """Drift, two crossing modes, one mode away for 100 epochs, 5 % failed epochs."""
    rng = np.random.default_rng(seed)
    shapes = shapes_of_a_chain(channels)
    t = np.arange(count)
    season = np.sin(2 * np.pi * t / count)[:, None] * rng.uniform(0.01, 0.04, channels)
    day = np.sin(2 * np.pi * t / 24)[:, None] * rng.uniform(0.0, 0.003, channels)
    walk = np.cumsum(3e-4 * rng.normal(size=(count, channels)), axis=0)
    wander = season + day + walk
    base = np.tile(np.array([2.0, 5.0, 5.0, 9.0, 12.0])[:channels], (count, 1))
    base[:, 1] *= np.linspace(0.94, 1.06, count)
    base[:, 2] *= np.linspace(1.06, 0.94, count)
    # The pair goes together but for the crossing, so that it crosses once.
    wander[:, 2] = wander[:, 1] + 0.3 * (wander[:, 2] - wander[:, 1])
    frequencies = base * np.exp(wander)
    away = int(rng.integers(count // 4, 3 * count // 4))
    epochs, truth = [], []
    for k in range(count):
        modes, owners = _epoch(rng, frequencies[k], shapes, absent=away <= k < away + 100)
        epochs.append(modes)
        truth.append(owners)
    return Campaign(epochs, truth, channels)


def _epoch(rng, frequencies, shapes, *, absent):
    failed, what = rng.random() < 0.05, rng.random()
    modes: list[Mode] = []
    owners: list[int | None] = []
    if failed and what < 0.5:
        return modes, owners
    if not failed:
        shown = [
            i for i in range(len(shapes)) if rng.random() > 0.03 and (i != 3 or not absent)
        ]
        now = list(shapes)
        close = abs(frequencies[1] / frequencies[2] - 1.0)
        if close < 0.004:
            # Nearly one frequency: identification returns any two shapes of their plane.
            turn = rng.uniform(-np.pi, np.pi) * (1.0 - close / 0.004)
            now[1] = np.cos(turn) * shapes[1] + np.sin(turn) * shapes[2]
            now[2] = np.cos(turn) * shapes[2] - np.sin(turn) * shapes[1]
            if close < 0.002 and rng.random() < 0.5:
                shown = [i for i in shown if i != 2]
        for i in shown:
            modes.append(seen(rng, frequencies[i], now[i], sd=0.0015, shape_sd=0.03))
            owners.append(i if close >= 0.004 or i not in (1, 2) else None)
    for _ in range(rng.poisson(4.0 if failed else 0.2)):
        shape = rng.normal(size=len(shapes)) + 0.3j * rng.normal(size=len(shapes))
        modes.append(mode(rng.uniform(1.0, 15.0), shape, sd=0.003, shape_sd=0.05))
        owners.append(None)
    order = np.argsort([m.frequency_hz.value for m in modes])
    return [modes[i] for i in order], [owners[i] for i in order]


def judge(brought, truth):
    """Identities each true mode was given, how often; and how often it was passed over."""
    given: dict[int, list[int]] = {}
    passed = 0
    for tracked, owners in zip(brought, truth, strict=True):
        for identity, owner in zip(tracked.identities, owners, strict=True):
            if owner is not None and identity is None:
                passed += 1
            elif owner is not None:
                given.setdefault(owner, []).append(identity)
    return given, passed


def check_campaign(seed, count=2000):
    made = campaign(seed, count)
    state, brought = run(made.epochs)
    given, passed = judge(brought, made.truth)
    settled = {owner: {int(i) for i in np.unique(ids)} for owner, ids in given.items()}
    assert all(len(ids) == 1 for ids in settled.values()), settled
    assert len({min(ids) for ids in settled.values()}) == made.modes
    assert state.next_identity == made.modes + 1
    assert passed < 0.02 * sum(map(len, given.values()))
    kinds = [event.kind for tracked in brought for event in tracked.events]
    assert kinds.count("born") == made.modes
    assert kinds.count("crossed") == 1
    return brought


@pytest.mark.long
def test_no_identity_is_swapped_or_invented_in_a_year_of_epochs():
    check_campaign(0, count=700)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_no_identity_is_swapped_or_invented_in_2000_epochs_over_many_seeds(seed):
    check_campaign(seed)


def test_a_mode_that_is_missing_shifts_no_other_and_comes_back_as_itself():
    rng = np.random.default_rng(4)
    shapes = shapes_of_a_chain()

    def epoch(shown):
        return [seen(rng, 2.0 + i, shapes[i]) for i in shown]

    epochs = [epoch(range(4))] * 20 + [epoch((0, 2, 3))] * 100 + [epoch(range(4))] * 5
    state, brought = run(epochs)
    assert brought[19].identities == (1, 2, 3, 4)
    assert {tracked.identities for tracked in brought[20:120]} == {(1, 3, 4)}
    assert brought[120].identities == (1, 2, 3, 4)
    told = [(e.kind, e.identity, e.epoch) for tracked in brought[20:] for e in tracked.events]
    assert told == [("missing", 2, 19), ("found", 2, 120)]
    assert state.next_identity == 5


def test_modes_that_cross_keep_their_shapes_and_so_their_identities():
    rng = np.random.default_rng(5)
    one, other = shapes_of_a_chain()[:2]
    rising, falling = np.linspace(4.8, 5.2, 101), np.linspace(5.2, 4.8, 101)
    epochs = [
        [seen(rng, up, one), seen(rng, down, other)]
        for up, down in zip(rising, falling, strict=True)
    ]
    _, brought = run(epochs)
    assert {tracked.identities for tracked in brought[5:]} == {(1, 2)}
    crossings = [e for tracked in brought for e in tracked.events if e.kind == "crossed"]
    assert [(e.identity, e.other) for e in crossings] == [(1, 2)]
    assert 50 <= crossings[0].epoch <= 60


def test_modes_that_veer_keep_their_frequencies_and_are_said_to_have_exchanged_shapes():
    rng = np.random.default_rng(6)
    one, other = shapes_of_a_chain()[:2]
    epochs = []
    for tuning in np.linspace(-1, 1, 201):
        values, vectors = np.linalg.eigh([[25 + tuning, 0.2], [0.2, 25 - tuning]])
        pair = vectors.T @ np.array([one, other])
        epochs.append([seen(rng, np.sqrt(v), s) for v, s in zip(values, pair, strict=True)])
    _, brought = run(epochs)
    assert {tracked.identities for tracked in brought[5:]} == {(1, 2)}
    told = [e for tracked in brought for e in tracked.events if e.kind in ("veered", "crossed")]
    assert [(e.kind, e.identity, e.other) for e in told] == [("veered", 1, 2)]
    assert 100 <= told[0].epoch <= 140


def test_identities_survive_a_sudden_damage_that_moves_every_frequency():
    rng = np.random.default_rng(7)
    shapes = shapes_of_a_chain()

    def epoch(factor):
        return [seen(rng, factor * (2.0 + i), shapes[i]) for i in range(5)]

    _, brought = run([epoch(1.0) for _ in range(30)] + [epoch(0.9) for _ in range(10)])
    assert brought[29].identities == brought[-1].identities == (1, 2, 3, 4, 5)


def test_a_pole_split_in_two_gets_no_second_identity():
    rng = np.random.default_rng(8)
    shape = shapes_of_a_chain()[1]
    epochs = [[seen(rng, 5.0, shape), seen(rng, 5.03, shape)] for _ in range(40)]
    state, _ = run(epochs)
    assert list(state.identities) == [1]


def test_one_channel_is_followed_by_frequency_alone():
    rng = np.random.default_rng(9)
    truth = np.exp(np.cumsum(1e-3 * rng.normal(size=(500, 3)), axis=0)) * [2.0, 5.0, 9.0]
    keep = rng.random((500, 3)) > 0.1
    epochs = [
        [seen(rng, f, np.ones(1)) for f, k in zip(row, kept, strict=True) if k]
        for row, kept in zip(truth, keep, strict=True)
    ]
    _, brought = run(epochs)
    expected = [tuple((np.flatnonzero(kept) + 1).tolist()) for kept in keep]
    agree = [t.identities == e for t, e in zip(brought, expected, strict=True)]
    assert all(agree[20:])


def test_failed_epochs_say_nothing_of_any_mode():
    epochs = [[mode(5.0, np.ones(3))]] * 6 + [[]] * 5000 + [[mode(5.0, np.ones(3))]]
    _, brought = run(epochs)
    assert brought[-1].identities == (1,)
    assert [e.kind for tracked in brought for e in tracked.events] == ["born"]


def test_a_mode_given_up_is_said_to_have_died_and_its_number_is_not_used_again():
    tracker = ModeTracker(patience=20)
    other = np.array([1.0, -1.0, 1.0])
    epochs = [[mode(5.0, np.ones(3))]] * 10 + [[mode(9.0, other)]] * 40
    epochs += [[mode(5.0, np.ones(3))]] * 10
    state, brought = run(epochs, tracker)
    assert ("died", 1) in [(e.kind, e.identity) for t in brought for e in t.events]
    assert list(state.identities) == [2, 3]


def test_harmonics_are_nobodys():
    line = mode(7.0, np.ones(3), kind="harmonic")
    _, brought = run([[mode(5.0, np.ones(3)), line]] * 10)
    assert brought[-1].identities == (1, None)


def test_the_order_in_which_modes_are_listed_does_not_matter():
    epochs = campaign(3, count=120).epochs
    _, forth = run(epochs)
    _, back = run([modes[::-1] for modes in epochs])
    assert [t.identities for t in forth] == [t.identities[::-1] for t in back]


@pytest.mark.long
def test_a_state_that_was_pickled_goes_on_the_same_and_steps_change_no_state():
    epochs = campaign(2, count=160).epochs
    whole, _ = run(epochs)
    middle, _ = run(epochs[:80])
    kept = pickle.dumps(middle)
    run(epochs[80:], state=middle)
    assert pickle.dumps(middle) == kept
    resumed, _ = run(epochs[80:], state=pickle.loads(kept))
    for one, other in zip(resumed.tracks, whole.tracks, strict=True):
        assert (one.identity, one.frequency_hz) == (other.identity, other.frequency_hz)
        assert np.array_equal(one.shape.shape, other.shape.shape)


def test_the_cost_of_an_epoch_is_bounded_whatever_comes():
    rng = np.random.default_rng(10)
    tracker = ModeTracker(most=12)
    epochs = [[mode(f, rng.normal(size=3)) for f in rng.uniform(1, 50, 20)] for _ in range(30)]
    state, _ = run(epochs, tracker)
    assert len(state.tracks) <= 12


def test_the_believed_frequency_is_the_true_one_within_its_sd():
    rng = np.random.default_rng(11)
    truth = 5.0 * np.exp(np.cumsum(3e-4 * rng.normal(size=400)))
    state, scores = TRACKER.start(), []
    for f in truth:
        state, _ = TRACKER.step(state, [seen(rng, f, np.ones(3), sd=2e-3)])
        track = state.tracks[0]
        scores.append((track.frequency_hz.value - f) / track.frequency_hz.sd)
    assert 0.5 < np.mean(np.square(scores[20:])) < 1.5
    assert np.ptp(truth) > 3 * 2e-3 * 5.0


def test_senseless_input_is_refused_with_the_cure():
    state, _ = TRACKER.step(TRACKER.start(), [mode(5.0, np.ones(3))])
    with pytest.raises(ValueError, match=r"channels \[2, 3\].*|Shapes of \[2, 3\] channels"):
        TRACKER.step(state, [mode(5.0, np.ones(2))])
    with pytest.raises(ValueError, match="Give epochs in order"):
        TRACKER.step(state, [], elapsed=-1.0)
    with pytest.raises(ValueError, match="leave out modes without"):
        TRACKER.step(state, [mode(5.0, np.ones(3), sd=np.nan)])
    with pytest.raises(ValueError, match="quiet at most patience"):
        ModeTracker(quiet=10, patience=5)
    with pytest.raises(ValueError, match="positive number"):
        ModeTracker(false_modes=0.0)

"""States: right as often as they say, and the same however the stream is cut."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime_schemas.messages import Mode
from slowtime_schemas.quantities import Quantity
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.history import states as rows
from twin_server.registration.twin import Registration

NOMINAL = {"frequency_hz": 3.0, "damping_ratio": 0.02}


def begin(**registration):
    made = Registration(**registration)
    return Twin(made, Checkpoint.start(made))


def run(twin, features, cuts=()):
    """Estimate in pieces; states together, the last twin, all notices."""
    bounds = [0, *sorted(cuts), len(features)]
    states, notices = [], []
    for first, last in itertools.pairwise(bounds):
        part = features[first:last]
        found = estimate([twin], part, [0] * len(part), [0] * len(part))
        # What is remembered must survive being written down.
        written = Checkpoint.from_json(found.checkpoints[0].to_json())
        assert written.to_json() == found.checkpoints[0].to_json()
        twin = twin._replace(checkpoint=written)
        states.append(found.states)
        notices += [n._replace(row=n.row + first) for n in found.notices[0]]
    return np.concatenate(states), twin, notices


def held(states, name):
    truth = states["truth"][:, rows.ESTIMATES.index(name)]
    lo, hi = states[name][:, 2], states[name][:, 3]
    known = np.isfinite(lo)
    return float(np.mean((lo[known] <= truth[known]) & (truth[known] <= hi[known])))


def test_the_interval_of_stiffness_holds_the_truth_as_often_as_it_says(ageing):
    states, _, notices = run(begin(nominal=NOMINAL), ageing(2000))
    assert 0.935 < held(states, "stiffness_change") < 0.965
    assert (states["reasons"] == 0).all()
    assert not notices


def test_the_error_of_a_learnt_nominal_enters_every_interval(features):
    # A structure that stands still: the nominal's error is all the bias there is.
    outcomes = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        still = [
            features(i, frequency_hz=float(3 + 0.002 * rng.standard_normal()), sd=0.002)
            for i in range(40)
        ]
        states, _, _ = run(begin(learn_epochs=4), still)
        change = states["stiffness_change"][4:]
        outcomes.append(np.mean((change[:, 2] <= 0) & (change[:, 3] >= 0)))
    assert 0.93 < np.mean(outcomes) < 0.99


@pytest.mark.parametrize(
    "registration",
    [
        {"nominal": NOMINAL},
        {"learn_epochs": 7},
        {"changes": "mass", "learn_epochs": 7, "frequency_source": "smoothed"},
        {"changes": "both", "nominal": NOMINAL, "damping_coefficient_sd": 0.0},
        {
            "nominal": NOMINAL,
            "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
            "confirm_readings": 2,
        },
    ],
)
@settings(max_examples=15, deadline=None)
@given(cuts=st.sets(st.integers(1, 59), max_size=12))
def test_cutting_the_stream_anywhere_changes_no_bit(ageing, registration, cuts):
    features = ageing(60, smoothed=2.9)
    whole, last, told = run(begin(**registration), features)
    cut, cut_last, cut_told = run(begin(**registration), features, cuts)
    assert cut.tobytes() == whole.tobytes()
    assert cut_last == last
    assert cut_told == told


def test_twins_estimated_together_are_estimated_as_if_alone(ageing):
    kinds: list[dict[str, Any]] = [
        {"nominal": NOMINAL},
        {"changes": "mass", "nominal": NOMINAL},
        {"changes": "both", "nominal": NOMINAL},
        {"changes": "both", "nominal": NOMINAL, "prior_mass_sd": 0.1},
        {"learn_epochs": 5},
    ]
    twins = [begin(**kind) for kind in kinds]
    streams = [ageing(30, seed=seed) for seed in range(len(kinds))]
    mixed = [(place, s[i]) for i in range(30) for place, s in enumerate(streams)]
    found = estimate(twins, [f for _, f in mixed], [p for p, _ in mixed], [0] * len(mixed))
    owners = np.array([p for p, _ in mixed])
    for place, twin in enumerate(twins):
        alone, after, _ = run(twin, streams[place])
        assert found.states[owners == place].tobytes() == alone.tobytes()
        assert found.checkpoints[place] == after.checkpoint


def test_while_learning_there_is_no_change_and_a_reason(ageing):
    states, twin, notices = run(begin(learn_epochs=20), ageing(30, loss=0.0))
    assert np.isnan(states["stiffness_change"][:20, 0]).all()
    assert np.isfinite(states["stiffness_change"][20:, 0]).all()
    assert (states["reasons"][:20] == rows.LEARNING).all()
    assert [n.kind for n in notices] == ["nominal_learnt"]
    assert notices[0].row == 19
    assert twin.checkpoint.known.frequency_hz == pytest.approx(3.0, abs=0.002)


def test_epochs_without_a_mode_are_not_learnt_from(features, ageing):
    empty = [features(i, modes=()) for i in range(10)]
    states, twin, _ = run(begin(learn_epochs=5), empty)
    assert twin.checkpoint.known is None
    assert (states["reasons"] == rows.NO_MODE | rows.LEARNING).all()
    _, twin, _ = run(twin, ageing(5, first=10))
    assert twin.checkpoint.known is not None


def test_a_nominal_that_cannot_be_learnt_is_learnt_from_later_epochs(features):
    wild = [features(i, frequency_hz=3.0, sd=5.0) for i in range(4)]
    _, twin, _ = run(begin(learn_epochs=4), wild)
    assert twin.checkpoint.known is None
    _, twin, _ = run(twin, [features(i, frequency_hz=3.0) for i in range(4, 8)])
    assert twin.checkpoint.known is not None


def test_a_mass_twin_assumes_stiffness_and_says_so(ageing):
    states, _, _ = run(begin(changes="mass", nominal=NOMINAL), ageing(50))
    assert (states["stiffness_change"] == 0).all()
    assert rows.assumed(int(states["notes"][0])) == ("stiffness_change",)
    assert states["mass_change"][-1, 0] == pytest.approx(1 / 0.804 - 1, abs=0.01)


def test_both_are_told_apart_by_damping_or_refused(features):
    # Stiffness falls by a tenth, mass grows by a tenth, the damper stays what it was.
    k, m = 0.9, 1.1
    changed = [
        features(
            i,
            frequency_hz=3.0 * np.sqrt(k / m),
            damping=0.02 / np.sqrt(k * m),
            damping_sd=0.0004,
        )
        for i in range(5)
    ]
    states, _, _ = run(
        begin(changes="both", nominal=NOMINAL, damping_coefficient_sd=0.0), changed
    )
    assert (states["reasons"] == 0).all()
    assert states["stiffness_change"][0, 0] == pytest.approx(-0.1, abs=0.01)
    assert states["mass_change"][0, 0] == pytest.approx(0.1, abs=0.01)
    assert states["correlation"][0] > 0.9
    refused, _, _ = run(
        begin(changes="both", nominal=NOMINAL, damping_coefficient_sd=0.5), changed
    )
    said = rows.sentences(int(refused["reasons"][0]))
    assert any("not separately identifiable" in sentence for sentence in said)


def test_both_without_a_nominal_damping_is_refused_not_failed(features):
    still = [features(i, damping=0.0, damping_sd=0.0) for i in range(12)]
    states, _, _ = run(begin(changes="both", learn_epochs=5), still)
    assert (states["reasons"][5:] & rows.NO_DAMPING > 0).all()
    assert np.isnan(states["damping_ratio"]).all()


def test_the_smoothed_frequency_is_used_where_asked_for_and_there(features):
    stream = [features(0, smoothed=2.5), features(1)]
    states, _, _ = run(begin(nominal=NOMINAL, frequency_source="smoothed"), stream)
    assert states["frequency_hz"][:, 0].tolist() == [2.5, 3.0]
    assert (states["notes"] & rows.USED_SMOOTHED).tolist() == [rows.USED_SMOOTHED, 0]


def test_the_mode_of_the_registration_is_followed(features):
    two = tuple(
        Mode(
            frequency_hz=Quantity(value=f, sd=0.01),
            damping_ratio=Quantity(value=0.02, sd=0.001),
        )
        for f in (3.0, 18.0)
    )
    states, _, _ = run(
        begin(mode=1, nominal={"frequency_hz": 18.0, "damping_ratio": 0.02}),
        [features(0, modes=two), features(1, modes=two[:1])],
    )
    assert states["frequency_hz"][0, 0] == 18.0
    assert states["reasons"].tolist() == [0, rows.NO_MODE]


def test_the_line_of_a_machine_is_not_counted_among_the_modes(features):
    lowest, first, second = (
        Mode(
            frequency_hz=Quantity(value=f, sd=0.01),
            damping_ratio=Quantity(value=0.02, sd=0.001),
            kind="harmonic" if f == 2.0 else "structural",
        )
        for f in (2.0, 3.0, 18.0)
    )
    twin = begin(nominal={"frequency_hz": 3.0, "damping_ratio": 0.02})
    states, _, _ = run(
        twin, [features(0, modes=(lowest, first, second)), features(1, modes=(lowest,))]
    )
    assert states["frequency_hz"][0, 0] == 3.0
    assert states["reasons"].tolist() == [0, rows.NO_MODE]


def test_an_alarm_is_raised_once_and_ends_once(features):
    def at(change, i):
        return features(i, frequency_hz=3.0 * np.sqrt(1 + change))

    changes = [0.0] * 5 + [-0.12] * 20 + [-0.099] * 5 + [-0.12] * 5 + [-0.05] * 10
    twin = begin(nominal=NOMINAL, alarms=[{"quantity": "stiffness_change", "below": -0.1}])
    _, _, notices = run(twin, [at(change, i) for i, change in enumerate(changes)])
    assert [(n.kind, n.severity, n.row) for n in notices] == [
        ("alarm", "alarm", 7),
        ("alarm_cleared", "info", 37),
    ]
    assert notices[0].message.startswith("Stiffness change below −10 % with 97.5 % certainty")
    assert notices[0].details["estimate"]["hi"] < -0.1


def test_one_outlier_raises_no_alarm(features):
    twin = begin(nominal=NOMINAL, alarms=[{"quantity": "frequency_hz", "above": 3.5}])
    stream = [features(i, frequency_hz=9.0 if i % 5 == 4 else 3.0) for i in range(50)]
    _, _, notices = run(twin, stream)
    assert not notices


def test_validity_is_told_when_it_changes_and_not_at_each_reading(features):
    stream = [features(i, frequency_hz=1.9 if 10 <= i < 30 else 3.0) for i in range(50)]
    states, _, notices = run(begin(nominal=NOMINAL), stream)
    assert [(n.kind, n.severity, n.row) for n in notices] == [
        ("validity", "warning", 12),
        ("validity", "info", 32),
    ]
    assert "outside the recommended range" in notices[0].message
    assert (states["reasons"][10:30] > 0).all()


@settings(max_examples=200, deadline=None)
@given(
    value=st.floats(5e-324, 1.7e308),
    sd=st.floats(0, 1.7e308),
    damping=st.floats(-1e308, 1.7e308),
    damping_sd=st.floats(0, 1.7e308),
    changes=st.sampled_from(["stiffness", "mass", "both"]),
    learns=st.booleans(),
)
def test_no_number_that_a_message_may_hold_fails_or_leaves_the_finite(
    features, value, sd, damping, damping_sd, changes, learns
):
    given_ = features(0, frequency_hz=value, sd=sd, damping=damping, damping_sd=damping_sd)
    twin = begin(changes=changes, nominal=None if learns else NOMINAL, learn_epochs=2)
    states, _, _ = run(twin, [given_] * 4)
    for name in rows.ESTIMATES:
        assert not np.isinf(states[name]).any()
        left_out = np.isnan(states[name][:, 0])
        if name != "damping_ratio":
            assert (states["reasons"][left_out] > 0).all()

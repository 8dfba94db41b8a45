"""Everything that may be wrong with a message has a reason, a sentence with a cure, a count."""

import json

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import HEALTH
from slowtime_services.bus import Sample
from twin_server.collect import Reception, Refusals
from twin_server.settings import AdmissionSettings

NOW_NS = 1_795_000_000_000_000_000
DAY_NS = 86_400 * 10**9


@pytest.fixture
def reception():
    return Reception(AdmissionSettings(), Refusals())


def altered(sample, **fields):
    content = {**json.loads(sample.payload), **fields}
    return sample._replace(payload=json.dumps(content).encode())


def refusals_of(reception):
    return {reason: n for reason, n in reception._refusals.counts.items() if n}


def test_a_sound_message_is_taken_with_its_bytes(reception, features, sample):
    one = sample(features(0))
    arrivals, healths, *_ = reception.read([one], NOW_NS)
    assert arrivals[0].payload == one.payload
    assert arrivals[0].features == features(0)
    assert not healths
    assert not refusals_of(reception)


WRONG = {
    "NaN": ("not_finite", lambda s, f: altered(s(f(0)), slow_time=float("nan"))),
    "infinity": ("not_finite", lambda s, f: altered(s(f(0)), slow_time=float("inf"))),
    "a wrong shape": ("invalid", lambda s, f: altered(s(f(0)), modes={"not": "a list"})),
    "a missing field": ("invalid", lambda s, f: altered(s(f(0)), sequence=None)),
    "a negative sequence": ("invalid", lambda s, f: altered(s(f(0)), sequence=-1)),
    "an unknown field": ("unknown_field", lambda s, f: altered(s(f(0)), colour="red")),
    "not JSON": ("not_json", lambda s, f: s(f(0))._replace(payload=b"\xff\x00 no")),
    "a version to come": ("unknown_version", lambda s, f: altered(s(f(0)), version=99)),
    "another asset's key": (
        "foreign_key",
        lambda s, f: s(f(0))._replace(key="slowtime/v1/lab/other/features"),
    ),
    "a key of nobody": ("unknown_key", lambda s, f: s(f(0))._replace(key="a/b/c")),
    "another stream": (
        "unexpected",
        lambda s, f: s(f(0))._replace(key="slowtime/v1/lab/beam/state"),
    ),
    "100 MB": ("too_large", lambda s, f: s(f(0))._replace(payload=bytes(100 * 2**20))),
    "a sender's clock ahead": (
        "future_clock",
        lambda s, f: s(f(0), sent_ns=NOW_NS + 301 * 10**9),
    ),
    "a sender's clock behind": (
        "stale_clock",
        lambda s, f: s(f(0), sent_ns=NOW_NS - 301 * 10**9),
    ),
    "a sensor in the future": (
        "future_clock",
        lambda s, f: s(f(0, time_base="live", t_ns=NOW_NS + 301 * 10**9)),
    ),
    "a clock that was never set": ("unset_clock", lambda s, f: s(f(0, t_ns=10**9))),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_refused_with_a_reason_and_a_cure(
    case, reception, features, sample, caplog
):
    reason, make = WRONG[case]
    before, after = sample(features(1)), sample(features(2))
    arrivals, *_ = reception.read([before, make(sample, features), after], NOW_NS)
    assert [a.features.sequence for a in arrivals] == [1, 2]
    assert refusals_of(reception) == {reason: 1}
    (said,) = caplog.messages
    assert said.startswith(f"Refused, {reason}: ")
    assert "given" in said or "no key of ours" in said
    assert "llowed" in said or "Send" in said
    assert len(said) < 1000


@pytest.mark.parametrize(
    "how",
    [
        {"replayed": True, "sent_ns": NOW_NS - 400 * DAY_NS},
        {"replayed": False, "sent_ns": None},
        {"replayed": False, "sent_ns": NOW_NS - 299 * 10**9},
    ],
)
def test_a_recording_s_age_says_nothing_about_clocks(how, reception, features, sample):
    old = NOW_NS - 300 * DAY_NS
    live = "live" if how["replayed"] else "recorded"
    arrivals, *_ = reception.read(
        [sample(features(0, time_base=live, t_ns=old), **how)], NOW_NS
    )
    assert len(arrivals) == 1


@pytest.mark.parametrize("waited_s", [0, 301, 4000])
def test_clocks_are_judged_by_when_a_message_came_not_by_how_long_it_waited(
    waited_s, reception, features, sample
):
    came = NOW_NS - waited_s * 10**9
    right = features(0, time_base="live", t_ns=came - 10**9)
    wrong = features(1, time_base="live", t_ns=came + 301 * 10**9)
    messages = [
        sample(message, sent_ns=came - 10**8)._replace(arrived_ns=came)
        for message in (right, wrong)
    ]
    arrivals, *_ = reception.read(messages, NOW_NS)
    assert [one.features.sequence for one in arrivals] == [0]
    assert refusals_of(reception) == {"future_clock": 1}


def test_a_reading_of_any_age_is_taken_and_how_old_it_was_is_noted(reception, features, sample):
    given = [
        sample(features(n, time_base=base, t_ns=NOW_NS - days * DAY_NS), replayed=replayed)
        for n, (base, days, replayed) in enumerate(
            [
                ("live", 29, False),
                ("live", 31, False),
                ("live", 31, True),
                ("recorded", 99, False),
            ]
        )
    ]
    arrivals, *_ = reception.read(given, NOW_NS)
    assert [arrival.age_s / 86_400 for arrival in arrivals] == [0.0, 31.0, 0.0, 0.0]
    assert not refusals_of(reception)


def test_health_is_taken_with_whether_it_was_replayed(reception):
    health = Health(
        site="lab",
        asset="beam",
        boot="b1",
        sequence=3,
        t_ns=1,
        last_sequence=7,
        first_held=0,
        uptime_s=2.0,
    )
    sample = Sample(HEALTH.key("lab", "beam"), encode(health), NOW_NS, True)
    assert reception.read([sample], NOW_NS) == ([], [(health, True)], [], [], [], [], 0)


def test_the_log_does_not_repeat_itself(caplog):
    refusals = Refusals(quiet_s=60.0)
    for _ in range(1000):
        refusals.refuse("duplicate", "again")
    assert refusals.counts["duplicate"] == 1000
    assert len(caplog.messages) == 1


def test_the_log_says_how_many_it_kept_to_itself(caplog):
    refusals = Refusals(quiet_s=0.0)
    refusals._told["duplicate"] = (-1.0, 0)
    refusals._counts["duplicate"] = 41
    refusals.refuse("duplicate", "again")
    assert "(41 more like it meanwhile)" in caplog.messages[0]


def test_an_unknown_reason_is_our_own_fault():
    with pytest.raises(KeyError, match=r"'boredom' is not a valid reason\. Allowed: too_large"):
        Refusals().refuse("boredom", "so what")


def test_senders_whose_clock_is_off_are_counted_since_they_may_be_asked_again(
    reception, features, sample
):
    off = [sample(features(s), sent_ns=NOW_NS + by) for s, by in enumerate((-(10**13), 10**13))]
    right = sample(features(2), sent_ns=NOW_NS)
    received = reception.read([*off, right, right._replace(payload=b"{")], NOW_NS)
    assert [a.features.sequence for a in received.arrivals] == [2]
    assert received.misdated == 2

"""A recorder among peers that state anything: bounded memory, and honest gaps are healed."""

import json
from pathlib import Path

import pytest

import slowtime_services
from slowtime_schemas import streams
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import FEATURES, HEALTH, current_key, parse_key
from slowtime_services.bus import MemoryBus
from slowtime_services.feature_runs import run_and_sequence
from slowtime_services.record import Recorder, retransmission, writer
from slowtime_services.record.retransmission import (
    FURTHEST,
    MOST_BOOTS,
    MOST_GAPS,
    Retransmission,
)
from slowtime_services.replay import read_recording
from tests.state_machines import steps_in

FOLDER = Path(slowtime_services.__file__).parent


def arrives(healer, sequence, asset="beam", boot="b1"):
    payload = {"site": "lab", "asset": asset, "boot": boot, "sequence": sequence}
    healer.note(FEATURES.key("lab", asset), json.dumps(payload).encode())


def states(healer, last, boot="b1"):
    health = Health(
        site="lab", asset="beam", boot=boot, sequence=0, t_ns=1, last_sequence=last,
        first_held=0, uptime_s=1.0,
    )  # fmt: skip
    healer.note(HEALTH.key("lab", "beam"), encode(health))


class Silent(MemoryBus):
    """A bus on which nobody has anything."""

    def __init__(self):
        super().__init__()
        self.asked = []

    def ask(self, key_expression, parameters=None, **limits):
        self.asked.append((key_expression, dict(parameters)))
        return super().ask(key_expression, parameters, **limits)


@pytest.mark.parametrize("last", [2**39, 2**40 - 1, FURTHEST + 1])
def test_an_end_that_is_not_believed_is_no_loss_and_what_follows_is_still_healed(last):
    bus = Silent()
    healer = Retransmission(bus, lambda sample: None, grace_s=0.0)
    arrives(healer, 0)
    states(healer, last)
    assert healer.missing == 0
    arrives(healer, 5)
    assert healer.missing == 4
    healer.heal(at_last=True)
    assert [(p["first"], p["last"]) for _, p in bus.asked] == [("1", "4")]


def test_an_end_far_ahead_of_an_old_backup_is_believed():
    healer = Retransmission(Silent(), lambda sample: None)
    arrives(healer, 0)
    states(healer, 10_000_000)
    assert healer.missing == 10_000_000


def test_an_end_that_was_stated_and_never_came_does_not_hide_later_gaps():
    bus = Silent()
    healer = Retransmission(bus, lambda sample: None, grace_s=0.0, tries=2)
    arrives(healer, 0)
    states(healer, 1_000)
    for _ in range(4):
        healer.heal(at_last=True)
    assert healer.missing == 1_000
    bus.asked.clear()
    for sequence in (1, 2, 3, 6):  # true readings: those were no losses
        arrives(healer, sequence)
    assert healer.missing == 996
    for sequence in range(7, 1_003):
        arrives(healer, sequence)
    arrives(healer, 1_005)
    assert healer.missing == 2 + 2
    healer.heal(at_last=True)
    assert ("1003", "1004") in [(p["first"], p["last"]) for _, p in bus.asked]


@pytest.mark.parametrize("sequence", [2**40, 2**62, 10**18 - 1])
def test_a_sequence_that_jumps_opens_no_gap_and_costs_no_more_than_the_next(sequence):
    healer = Retransmission(Silent(), lambda sample: None)
    with steps_in(FOLDER) as ordinary:
        for n in range(50):
            arrives(healer, n)
    with steps_in(FOLDER) as hostile:
        arrives(healer, sequence)
    assert healer.missing == 0
    assert hostile.count < 3 * ordinary.count / 50


def test_holes_without_end_are_known_up_to_a_number_and_each_costs_the_same():
    healer = Retransmission(Silent(), lambda sample: None, grace_s=0.0)

    def holes(begin, count):
        with steps_in(FOLDER) as steps:
            for n in range(begin, begin + count):
                arrives(healer, 2 * n)
        return steps.count / count

    first, later = holes(0, 200), holes(200, 4_000)
    assert later < 2 * first
    (boots,) = healer._assets.values()
    assert len(boots["b1"].gaps) == MOST_GAPS
    assert healer.missing == 4_199


def test_an_asset_with_many_holes_has_its_turn_among_the_others():
    bus = Silent()
    healer = Retransmission(bus, lambda sample: None, grace_s=-1.0)
    for n in range(100):
        arrives(healer, 2 * n)
    for asset in ("fan", "mast"):
        arrives(healer, 0, asset)
        arrives(healer, 2, asset)
    healer.heal()
    asked = [key.rpartition("/")[2] for key, _ in bus.asked]
    assert asked[:3] == ["beam", "fan", "mast"]
    assert asked.count("beam") == retransmission.MOST_AT_ONCE


def test_boots_without_end_are_known_up_to_a_number():
    healer = Retransmission(Silent(), lambda sample: None)
    for n in range(500):
        arrives(healer, 7, boot=f"b{n}")
    (boots,) = healer._assets.values()
    assert len(boots) == MOST_BOOTS
    assert f"b{499}" in boots


def test_names_as_long_as_a_message_are_not_remembered():
    for n in range(50):
        payload = b'{"version":3,"site":"%s","asset":"a","boot":"b","sequence":1,' % (
            b"x" * 100_000 + b"%d" % n
        )
        assert run_and_sequence(FEATURES.key("lab", "a"), payload) is None
        whole = payload + b'"t_ns":0}'
        assert run_and_sequence(FEATURES.key("lab", "a"), whole) is None


def test_addresses_as_long_as_a_bus_carries_are_nobodys_and_not_remembered():
    before = (
        streams._current_key.cache_info().currsize,
        streams._partition.cache_info().currsize,
    )
    for n in range(20):
        key = FEATURES.key("lab", "beam") + "x" * 60_000 + str(n)
        assert current_key(key) == key
        with pytest.raises(ValueError, match="no key of ours"):
            parse_key(key)
        assert streams.address_of(key) is None
    assert before == (
        streams._current_key.cache_info().currsize,
        streams._partition.cache_info().currsize,
    )


def test_a_recording_of_more_assets_than_a_file_can_number_goes_on_in_another(
    tmp_path, features_of, monkeypatch
):
    monkeypatch.setattr(writer, "MOST_CHANNELS", 10)
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "a.mcap") as recorder:
        for n in range(25):
            (message,) = features_of(1, asset=f"beam-{n}")
            key = FEATURES.key("lab", f"beam-{n}")
            bus.publish(key, encode(message), encoding=FEATURES.encoding)
    paths = recorder.recording.paths
    assert [sum(1 for _ in read_recording(path)) for path in paths] == [10, 10, 5]

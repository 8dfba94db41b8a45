"""The load that `make load` puts on a machine, small: what it counts, it counts rightly."""

import re

import pytest

from benchmarks.processes import load

pytestmark = pytest.mark.system
SMALL = ("--period-s", "2", "--seconds", "12", "--burst-s", "2")


def figure(told: str, what: str) -> float:
    found = re.search(rf"^{what}\D+([\d,.]+)", told, re.MULTILINE)
    assert found, told
    return float(found[1].replace(",", ""))


@pytest.mark.long
def test_assets_of_several_sites_lose_nothing_and_a_tenfold_burst_heals(capsys):
    assert load.main(["--assets", "60", "--sites", "7", *SMALL]) == 0
    told = capsys.readouterr().out
    # One to be let in, twelve seconds of thirty, two of three hundred in place of thirty.
    assert figure(told, "features") == pytest.approx(60 + 10 * 30 + 2 * 300, rel=0.15)
    assert figure(told, "missing in history") == 0
    assert re.search(r"REST.* 0 failed$", told, re.MULTILINE)


@pytest.mark.long
def test_what_is_not_in_history_is_counted(capsys, monkeypatch):
    send = load.Senders.send

    def forgetful(senders, number):
        send(senders, number)
        senders.made[number] += senders.made[number] == 3

    monkeypatch.setattr(load.Senders, "send", forgetful)
    monkeypatch.setattr(load, "PATIENCE_S", 3.0)
    assert load.main(["--assets", "10", "--sites", "2", *SMALL]) == 1
    assert figure(capsys.readouterr().out, "missing in history") > 0

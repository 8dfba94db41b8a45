"""What an operator may declare, and what is refused with advice."""

import pytest
from pydantic import ValidationError

from slowtime_services.outputs import OutputsSettings


def declared(**one):
    return OutputsSettings(outputs={"a": one})


@pytest.mark.parametrize(
    ("one", "said"),
    [
        ({"kind": "influx", "url": "http://db.example:8086", "database": "d"}, "Give https"),
        ({"kind": "influx", "url": "ftp://db", "database": "d"}, "Give https://HOST"),
        ({"kind": "influx", "url": "https://u:p@db", "database": "d"}, "without user"),
        ({"kind": "influx", "url": "http://127.0.0.1:1"}, "either database"),
        (
            {"kind": "influx", "url": "http://127.0.0.1:1", "database": "d", "bucket": "b"},
            "either database",
        ),
        ({"kind": "mqtt", "host": "b.example", "credentials_file": "c"}, "tls = true"),
        ({"kind": "opcua", "host": "0.0.0.0"}, "certificate and key"),
        ({"kind": "opcua", "certificate": "c"}, "Give both"),
        ({"kind": "opcua", "credentials_file": "c"}, "without encryption"),
        ({"kind": "sparkplug", "host": "127.0.0.1", "node": "a/b"}, "pattern"),
        ({"kind": "carrier_pigeon"}, "does not match any of the expected tags"),
    ],
)
def test_what_is_not_safe_or_not_whole_is_refused(one, said):
    with pytest.raises(ValidationError, match=said):
        declared(**one)


def test_databases_begin_at_the_first_state_and_others_at_the_latest():
    found = OutputsSettings(
        outputs={
            "db": {"kind": "influx", "url": "http://127.0.0.1:1", "database": "d"},
            "ua": {"kind": "opcua"},
            "plain": {"kind": "mqtt", "host": "127.0.0.1"},
        }
    ).outputs
    assert [one.begin for one in found.values()] == ["first", "latest", "latest"]

"""Databases that take the line protocol, as they are packaged."""

import json
import signal
import time
import urllib.parse

import httpx
import pytest

from tests.twin_server.serve.outputs.conftest import free_port


class Influx:
    """InfluxDB 1."""

    def __init__(self, program, folder):
        self.port, backup = free_port(), free_port()
        settings = folder / "influxdb.conf"
        settings.write_text(
            f'reporting-disabled = true\nbind-address = "127.0.0.1:{backup}"\n'
            f'[meta]\ndir = "{folder}/meta"\n'
            f'[data]\ndir = "{folder}/data"\nwal-dir = "{folder}/wal"\n'
            f'[http]\nbind-address = "127.0.0.1:{self.port}"\nlog-enabled = false\n'
            "[monitor]\nstore-enabled = false\n"
        )
        command = ["-config", str(settings)]
        self.program = program("influxd", "influxdb", command, self.port)
        self.url = f"http://127.0.0.1:{self.port}"
        asked = {"q": "create database plant"}
        assert httpx.post(f"{self.url}/query", params=asked).status_code == 200
        self.settings = {"kind": "influx", "url": self.url, "database": "plant"}

    def sequences(self):
        """Sequence → stamp [ns], value and its standard deviation."""
        query = "select sequence, frequency_hz, frequency_hz_sd from slowtime_state"
        asked = {"q": query, "db": "plant", "epoch": "ns"}
        try:
            answer = httpx.get(f"{self.url}/query", params=asked, timeout=5)
        except httpx.HTTPError:
            return {}
        told = json.loads(answer.text, parse_int=int)
        (result,) = told["results"]
        rows = result.get("series", [{"values": []}])[0]["values"]
        return {row[1]: (row[0], row[2], row[3]) for row in rows}


class Victoria:
    """VictoriaMetrics, whose stamps are milliseconds."""

    def __init__(self, program, folder):
        self.port = free_port()
        command = [
            f"-httpListenAddr=127.0.0.1:{self.port}", f"-storageDataPath={folder}/victoria",
            "-retentionPeriod=100y",
        ]  # fmt: skip
        self.program = program("victoria-metrics", "victoria-metrics", command, self.port)
        self.url = f"http://127.0.0.1:{self.port}"
        self.settings = {"kind": "influx", "url": self.url, "database": "plant"}

    def sequences(self):
        found: dict[int, dict[str, float]] = {}
        for name in ("sequence", "frequency_hz", "frequency_hz_sd"):
            match = urllib.parse.quote(f"slowtime_state_{name}")
            try:
                text = httpx.get(f"{self.url}/api/v1/export?match[]={match}", timeout=5).text
            except httpx.HTTPError:
                return {}
            for line in text.splitlines():
                told = json.loads(line)
                for stamp, value in zip(told["timestamps"], told["values"], strict=True):
                    found.setdefault(stamp, {})[name] = value
        return {
            int(one["sequence"]): (stamp * 10**6, one["frequency_hz"], one["frequency_hz_sd"])
            for stamp, one in found.items()
            if len(one) == 3
        }


@pytest.fixture(params=[Influx, Victoria])
def database(request, program, tmp_path):
    return request.param(program, tmp_path)


def is_whole(database, server):
    """Whether a database has the history of a server; VictoriaMetrics rounds to 15 digits."""
    found, wanted = database.sequences(), history(server)
    return found.keys() == wanted.keys() and all(
        found[one][0] == wanted[one][0]
        and found[one][1:] == pytest.approx(wanted[one][1:], rel=1e-9)
        for one in wanted
    )


def history(server):
    points = server.get("/api/v1/twins/lab.beam/history", max_points=1_000).json()["points"]
    return {
        one["sequence"]: (
            one["t_ns"], one["frequency_hz"]["value"], one["frequency_hz"]["sd"],
        )
        for one in points
    }  # fmt: skip


def test_nothing_is_missing_after_the_database_and_the_outputs_were_killed(
    beam, grow, database, sending, eventually
):
    quick = database.settings | {"every_s": 0.2, "backoff_s": 0.2, "max_backoff_s": 1.0}
    end = sending(beam.url, db=quick)
    assert eventually(lambda: len(database.sequences()) == 30)
    # VictoriaMetrics keeps what is younger than some seconds in memory only.
    time.sleep(6.0 if isinstance(database, Victoria) else 0.0)
    database.program.kill()
    grow(beam, 40)
    database.program.start()
    assert eventually(lambda: len(database.sequences()) == 40)
    end()
    grow(beam, 50)
    sending(beam.url, db=quick)
    assert eventually(lambda: is_whole(database, beam))
    assert len(history(beam)) == 50


def test_a_history_that_was_estimated_anew_replaces_the_former(
    beam, program, tmp_path, sending, eventually
):
    database = Influx(program, tmp_path)
    sending(beam.url, db=database.settings | {"every_s": 0.2})
    assert eventually(lambda: is_whole(database, beam))
    before = beam.get("/api/v1/twins/lab.beam/history").json()["points"][-1]
    body = {"nominal": {"frequency_hz": 3.1, "damping_ratio": 0.02}}
    assert beam.client.put("/api/v1/twins/lab.beam", json=body).status_code == 200
    after = beam.get("/api/v1/twins/lab.beam/history").json()["points"][-1]
    assert after["stiffness_change"]["value"] != before["stiffness_change"]["value"]
    asked = {"q": "select last(stiffness_change) from slowtime_state", "db": "plant"}

    def last():
        told = httpx.get(f"{database.url}/query", params=asked).json()
        return told["results"][0]["series"][0]["values"][0][1]

    wanted = after["stiffness_change"]["value"]
    assert eventually(lambda: last() == pytest.approx(wanted, rel=1e-12))


def test_a_database_that_hangs_does_not_slow_the_server(
    beam, grow, database, sending, eventually
):
    sending(
        beam.url, db=database.settings | {"every_s": 0.2, "timeout_s": 1.0, "backoff_s": 0.2}
    )
    assert eventually(lambda: len(database.sequences()) == 30)
    database.program.signal(signal.SIGSTOP)
    began_s = time.monotonic()
    grow(beam, 60)
    assert beam.get("/readyz").status_code == 200
    assert time.monotonic() - began_s < 20
    database.program.signal(signal.SIGCONT)
    assert eventually(lambda: is_whole(database, beam))


@pytest.mark.gate
def test_a_refusal_is_said_once_and_keeps_the_position(
    beam, program, tmp_path, sending, eventually, caplog
):
    database = Influx(program, tmp_path)
    wrong = database.settings | {"database": "other", "max_backoff_s": 0.2}
    end = sending(beam.url, db=wrong)
    assert eventually(lambda: "The database refused with 404" in caplog.text)
    time.sleep(1.0)
    end()
    assert caplog.text.count("The database refused with 404") == 1
    sending(beam.url, db=database.settings)
    assert eventually(lambda: len(database.sequences()) == 30)

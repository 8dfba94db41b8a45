"""The client and the server understand each other: every answer, every refusal, every route."""

import itertools
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from slowtime_services.client import AnswerError, Client, UnreachableError

TWIN = "lab.beam"


@pytest.fixture(scope="module")
def client(server):
    return Client(server.url)


def test_a_twin_and_its_history_come_typed(client, server):
    (twin,) = client.twins()
    assert twin == client.twin(TWIN)
    assert (twin.id, twin.slow_time, twin.alive) == (TWIN, 299.0, False)
    history = client.history(TWIN)
    assert [state.sequence for state in history] == list(range(300))
    last = history[-1]
    assert last.stiffness_change == twin.stiffness_change
    assert last.stiffness_change.lo < -0.199 < last.stiffness_change.hi
    assert last.time.isoformat() == "2026-01-01T00:04:59+00:00"
    some = client.history(TWIN, start="slow:10", end="slow:200", max_points=20)
    assert len(some) <= 20
    assert history.bands is None
    assert some.bands is not None
    assert (some.bands.readings, sum(some.bands.count)) == (191, 191)
    assert (some.bands.start.slow_time[0], some.bands.end.slow_time[-1]) == (10.0, 200.0)
    stiffness = some.bands.quantities["stiffness_change"]
    values = [state.stiffness_change.value for state in history[10:201]]
    assert min(stiffness.min) == pytest.approx(min(values))
    assert max(stiffness.max) == pytest.approx(max(values))
    assert (some[0].slow_time, some[-1].slow_time) == (10.0, 200.0)
    assert client.twin(TWIN, at="slow:41.7").slow_time == 41.0


@pytest.mark.long
def test_forecast_events_digest_and_graph_come_typed(client, server):
    forecast = client.forecast(TWIN, horizon=50, points=3, threshold=-0.3)
    assert len(forecast.points) == 3
    assert forecast.crossings[0].threshold == -0.3
    assert forecast.crossings[0].times[1].share == 0.5
    assert sum(forecast.crossings[0].laws.values()) == pytest.approx(1.0, abs=0.05)
    assert len(forecast.crossings[0].cdf.slow_time) == len(
        forecast.crossings[0].cdf.probability
    )
    assert client.digest(TWIN).features == 300
    assert (
        client.digest(TWIN).sha256
        == server.get(f"/api/v1/twins/{TWIN}/history/hash").json()["sha256"]
    )
    assert [event.number for event in client.events(TWIN)] == sorted(
        event["number"] for event in server.get(f"/api/v1/twins/{TWIN}/events").json()["events"]
    )
    assert client.dtdl(site="lab")["digitalTwinsGraph"]["relationships"]
    order = {"load": {"kind": "step", "amplitude": 1.0}, "draws": 4, "duration_s": 2.0}
    with pytest.raises(AnswerError) as refused:
        client.simulate(TWIN, order | {"unheard": 1})
    assert refused.value.status == 422


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_table_is_written_as_the_server_sends_it(client, server, tmp_path, form):
    out = tmp_path / f"beam.{form}"
    written = client.export(TWIN, out, form, end="slow:50")
    sent = server.get(f"/api/v1/twins/{TWIN}/history/export", format=form, end="slow:50")
    assert out.read_bytes() == sent.content
    assert written == len(sent.content)


def test_what_the_server_refuses_is_told_in_its_words(client):
    with pytest.raises(AnswerError, match=r"No twin is called lab\.nobody") as refused:
        client.twin("lab.nobody")
    assert (refused.value.status, refused.value.kind) == (404, "no-such-twin")


def test_twins_are_registered_and_forgotten(serving):
    own = Client(serving().url)
    assert own.ready()
    assert own.register("lab.mast", {"changes": "mass"}).registration["changes"] == "mass"
    assert [twin.id for twin in own.twins()] == ["lab.mast"]
    own.delete("lab.mast")
    assert own.twins() == []


def test_nobody_there_and_no_twin_server_are_told_apart_from_refusals(unused):
    away = Client(f"http://127.0.0.1:{unused}", timeout_s=2)
    assert not away.ready()
    with pytest.raises(UnreachableError, match=r"did not answer.*Give the address"):
        away.twins()
    with pytest.raises(ValueError, match="not a valid address of a server"):
        Client("ftp://127.0.0.1")


def test_the_live_stream_goes_on_where_it_broke_off(serving, ageing, eventually):
    own = serving()
    every = ageing(60)
    own.client.put(f"/api/v1/twins/{TWIN}", json={"changes": "stiffness"})
    own.feed(every[:20])
    assert eventually(lambda: own.count() == 20)
    stream = Client(own.url).live(TWIN)
    first = next(stream)
    assert first.state is not None
    assert first.state.sequence == 19
    own.feed(every[20:40])
    seen = [one for one in itertools.islice(stream, 20) if one.state]
    stream.close()
    own.feed(every[40:])
    assert eventually(lambda: own.count() == 60)
    again = Client(own.url).live(TWIN, last_id=seen[-1].id)
    following = [one for one in itertools.islice(again, 20) if one.state]
    again.close()
    sequences = [one.state.sequence for one in (first, *seen, *following) if one.state]
    assert sequences == list(range(19, sequences[-1] + 1))
    assert sequences[-1] >= 55


@pytest.fixture
def unused():
    with HTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler) as server:
        return server.server_port


def test_a_token_is_not_carried_to_where_a_server_points():
    heard = []

    class Points(BaseHTTPRequestHandler):
        def do_GET(self):
            heard.append((self.path, self.headers.get("Authorization")))
            self.send_response(302)
            self.send_header("Location", "/elsewhere")
            self.end_headers()

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Points) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            with pytest.raises(AnswerError) as refused:
                Client(f"http://127.0.0.1:{server.server_port}", token="secret").twins()
        finally:
            server.shutdown()
            thread.join()
    assert refused.value.status == 302
    assert heard == [("/api/v1/twins", "Bearer secret")]


def test_states_that_follow_one_are_read_without_a_gap(server, client):
    whole = [one.sequence for one in client.history("lab.beam", max_points=1_000)]
    position, read = ":0", []
    while page := client.history_after("lab.beam", position, limit=70):
        read += [one.sequence for one in page]
        position = f"{page[-1].boot}:{page[-1].sequence}"
    assert read == whole
    assert len(read) == 300


@pytest.mark.parametrize(
    ("query", "status", "kind"),
    [
        ({"after": "nobody:3"}, 404, "no-such-boot"),
        ({"after": "b1"}, 422, "not-valid"),
        ({"after": "b1:3", "start": "slow:1"}, 422, "not-valid"),
    ],
)
def test_a_position_that_is_none_is_refused(server, query, status, kind):
    answer = server.get("/api/v1/twins/lab.beam/history", **query)
    assert answer.status_code == status
    assert answer.json()["type"].endswith(kind)

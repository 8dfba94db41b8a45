"""Requests and answers of databases, by a server that answers as it is told."""

import http.server
import threading

import pytest

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import (
    ELEMENTS_EXAMPLE,
    STATE_EXAMPLE,
    RegisteredTwin,
    State,
)
from slowtime_services.outputs import Batch, NotSentError
from slowtime_services.outputs.receivers.influx import InfluxOutput
from slowtime_services.outputs.settings import InfluxSettings

EVENT = EventModel(
    number=3, event_id="5f0c", id="demo.frame", boot="b1", sequence=4, t_ns=17, slow_time=None,
    kind="alarm", severity="alarm", message='Stiffness "j2" fell.', details={},
)  # fmt: skip


class Database:
    """Keeps requests, and answers with what `answers` holds, then with 204."""

    def __init__(self, *answers):
        self.requests: list[tuple[str, dict[str, str], str]] = []
        waiting = list(answers)
        database = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                database.requests.append((self.path, dict(self.headers), body.decode()))
                status, headers, said = waiting.pop(0) if waiting else (204, {}, b"")
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name, value)
                self.send_header("Content-Length", str(len(said)))
                self.end_headers()
                self.wfile.write(said)

            def log_message(self, *_):
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self):
        self._server.shutdown()
        self._server.server_close()


@pytest.fixture
def database():
    made = []

    def start(*answers):
        made.append(Database(*answers))
        return made[-1]

    yield start
    for one in made:
        one.close()


@pytest.fixture
def batch():
    status = {name: None for name in RegisteredTwin.model_fields} | {
        "id": "demo.frame", "valid": True, "reasons": [], "alive": True, "registration": {},
        "aside": 0, "raised": [], "normal": [], "elements": {}, "posterior_to_prior": {},
        "suspects": [], "channels": [], "modes": [],
    }  # fmt: skip
    states = tuple(map(State.model_validate, (STATE_EXAMPLE, ELEMENTS_EXAMPLE)))
    return Batch(RegisteredTwin.model_validate(status), states, (EVENT,))


def output(url, **more):
    made = InfluxOutput("db", InfluxSettings(kind="influx", url=url, **more))
    made.start()
    return made


def test_version_2_is_addressed_by_bucket_and_token(database, batch, tmp_path):
    found, token = database(), tmp_path / "token"
    token.write_text("a token\n")
    made = output(found.url + "/base", bucket="p l", org="lab", token_file=token)
    made.send(batch)
    made.close()
    ((path, headers, body),) = found.requests
    assert path == "/base/api/v2/write?bucket=p+l&org=lab&precision=ns"
    assert headers["Authorization"] == "Token a token"
    parser = pytest.importorskip("line_protocol_parser")
    lines = [parser.parse_line(one) for one in body.split("\n")]
    kinds = [one["measurement"].removeprefix("slowtime_") for one in lines]
    assert kinds == ["state", "state", "element", "element", "mode", "event"]
    assert lines[0]["fields"]["frequency_hz_sd"] == STATE_EXAMPLE["frequency_hz"]["sd"]
    assert lines[0]["time"] == STATE_EXAMPLE["t_ns"]
    assert lines[0]["tags"] == {"site": "demo", "asset": "frame"}
    assert lines[3]["fields"]["change"] == ELEMENTS_EXAMPLE["elements"]["storey2"]["value"]
    assert lines[-1]["tags"]["event"] == "5f0c"
    assert lines[-1]["fields"]["message"] == EVENT.message


@pytest.mark.parametrize("status", [429, 500, 503])
def test_what_passes_is_tried_again_when_the_database_asks_for_it(database, batch, status):
    made = output(database((status, {"Retry-After": "7"}, b"")).url, database="d")
    with pytest.raises(NotSentError) as refused:
        made.send(batch)
    assert (refused.value.wait_s, refused.value.is_refused) == (7.0, False)
    made.close()


@pytest.mark.parametrize("status", [400, 401, 404, 413])
def test_what_does_not_pass_names_the_reason(database, batch, status):
    said = b'{"code": "invalid", "message": "field type conflict"}'
    made = output(database((status, {}, said)).url, database="d")
    with pytest.raises(NotSentError, match=f"refused with {status}: field type conflict") as no:
        made.send(batch)
    assert no.value.is_refused
    made.close()

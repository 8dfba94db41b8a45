"""Receivers on this machine: an HTTP server that may fail, a mail server, an MQTT broker."""

import contextlib
import http.server
import json
import shutil
import socket
import subprocess
import threading
import time
from collections import Counter

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import SMTP, AuthResult

SECRET = "a secret that is long enough"


class Hook:
    """An HTTP server that keeps what it is sent.

    Parameters
    ----------
    answer
        Gives the status of the n-th request, counted from 0.
    before
        Called before each answer, such as to be slow.
    """

    def __init__(self, answer=lambda n: 204, before=lambda: None, headers=()):
        self.requests: list[tuple[str, dict[str, str], bytes, int]] = []
        self.accepted: Counter[str] = Counter()
        self._lock, hook = threading.Lock(), self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                length = int(self.headers["Content-Length"])
                payload = self.rfile.read(length)
                if len(payload) < length:
                    return  # whoever asked has died in the middle of it
                before()
                with hook._lock:
                    status = answer(len(hook.requests))
                    hook.requests.append((self.path, dict(self.headers), payload, status))
                    if 200 <= status < 300:
                        hook.accepted[self.headers["Idempotency-Key"]] += 1
                self.send_response(status)
                for name, value in headers:
                    self.send_header(name, value)
                self.send_header("Content-Length", "0")
                self.end_headers()

            do_GET = do_POST

            def log_message(self, *_):
                pass

        class Server(http.server.ThreadingHTTPServer):
            request_queue_size = 64

            def handle_error(self, *_):
                """A client that is killed is no fault of this server."""

        self._server = Server(("127.0.0.1", 0), Handler)
        self.port = self._server.server_address[1]
        self.url = f"http://127.0.0.1:{self.port}/hook?token=of-the-address"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def told(self):
        return [json.loads(payload) for _, _, payload, _ in self.requests]

    def close(self):
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


@pytest.fixture
def hook():
    """Start HTTP servers, and end them."""
    made = []

    def start(*args, **more):
        made.append(Hook(*args, **more))
        return made[-1]

    yield start
    for one in made:
        one.close()


@pytest.fixture
def secret(tmp_path):
    """Path of a secret."""
    path = tmp_path / "secret"
    path.write_text(SECRET + "\n")
    return path


class Mailbox:
    """What a mail server keeps of its messages; refuses some recipients."""

    def __init__(self):
        self.mails = []

    async def handle_RCPT(self, server, session, envelope, address, options):
        if address.startswith("nobody"):
            return "550 no such user"
        envelope.rcpt_tos.append(address)
        return "250 OK"

    async def handle_DATA(self, server, session, envelope):
        self.mails.append((envelope.rcpt_tos, envelope.content.decode()))
        return "250 OK"


class Encrypted(Controller):
    """Its own check of readiness trusts nobody's authority; it is ready when it listens."""

    def _trigger_server(self):
        self.smtpd = SMTP(self.handler, loop=self.loop)
        self._factory_invoked.set()


@pytest.fixture
def mail_server():
    """Start mail servers on ports of their own, and end them."""
    made = []

    def start(**more):
        box = Mailbox()
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        kind = Encrypted if "ssl_context" in more else Controller
        controller = kind(box, hostname="127.0.0.1", port=port, ready_timeout=60, **more)
        controller.start()
        made.append(controller)
        return box, port

    yield start
    for controller in made:
        controller.stop()


@pytest.fixture
def only_ann():
    """Who may send: ann, with her password."""

    def judge(server, session, envelope, mechanism, data):
        known = (data.login, data.password) == (b"ann", b"of ann")
        return AuthResult(success=known, handled=False)

    return judge


@pytest.fixture
def broker(tmp_path):
    """Start mosquitto; give its port, and a function that gives what a topic has heard."""
    program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    if program is None:
        pytest.skip("no mosquitto: apt install mosquitto")
    client_module = pytest.importorskip("paho.mqtt.client")
    with contextlib.ExitStack() as open_things:

        def start(lines=("allow_anonymous true",)):
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                port = free.getsockname()[1]
            settings = tmp_path / f"mosquitto-{port}.conf"
            settings.write_text("\n".join((f"listener {port} 127.0.0.1", *lines)) + "\n")
            process = subprocess.Popen(
                [program, "-c", str(settings)], stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )  # fmt: skip
            open_things.callback(process.wait, 30)
            open_things.callback(process.terminate)
            deadline = time.monotonic() + 30
            while True:
                with (
                    contextlib.suppress(OSError),
                    socket.create_connection(("127.0.0.1", port)),
                ):
                    return port
                assert time.monotonic() < deadline
                time.sleep(0.02)

        def listen(port, topic, known=None):
            heard, there = [], threading.Event()
            client = client_module.Client(
                client_module.CallbackAPIVersion.VERSION2, protocol=client_module.MQTTv5
            )
            if known:
                client.username_pw_set(*known)
            client.on_message = lambda _c, _u, message: heard.append(message)
            client.on_connect = lambda c, *_: c.subscribe(topic, qos=1)
            client.on_subscribe = lambda *_: there.set()
            client.connect("127.0.0.1", port)
            client.loop_start()
            open_things.callback(client.loop_stop)
            open_things.callback(client.disconnect)
            assert there.wait(30)
            return heard

        yield start, listen

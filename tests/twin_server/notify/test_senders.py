"""Each kind of receiver, sent to over a real socket, and what is said where that fails."""

import email
import hashlib
import hmac
import json
import socket
import ssl
import threading
import time

import pytest
from pydantic import TypeAdapter, ValidationError

from slowtime_schemas.messages import Event
from slowtime_services.credentials import Authority
from tests.twin_server.notify.conftest import SECRET
from twin_server.events.deliveries import Delivery, identity
from twin_server.events.receivers import AlarmSettings, EmailReceiver, Receiver
from twin_server.history.rendering import event_body
from twin_server.notify import NotDeliveredError, WrongReceiverError, message_of, senders_of
from twin_server.notify.mail import mail_of


def message(
    text="Stiffness change below -3 %.", reminder=0, *, t_ns=5, slow_time=7.0, unit="T0",
    **of_settings,
):  # fmt: skip
    event = Event(
        site="lab", asset="beam", boot="b1", sequence=7, t_ns=t_ns, kind="alarm",
        severity="alarm", slow_time=slow_time, message=text,
        details={"quantity": "stiffness_change", "side": "below", "limit": -0.03},
    )  # fmt: skip
    event_id = identity(event.model_dump())
    delivery = Delivery(
        "x@ops", "lab.beam", "ops", event_id, "alarm", "alarm", reminder, 0.0, "waiting", 0, 0,
        0, 0, "", json.dumps(json.loads(event_body(event)) | {"slow_time_unit": unit}),
    )  # fmt: skip
    return message_of(delivery, AlarmSettings(**of_settings))


def sender(**receiver):
    return senders_of(AlarmSettings(receivers={"ops": receiver}))["ops"]


def test_a_webhook_is_signed_over_time_and_body(hook, secret):
    server = hook()
    sent = message(page_url="https://twin.example/")
    sender(kind="webhook", url=server.url, secret_file=secret).send(sent)
    ((path, headers, payload, _),) = server.requests
    assert path == "/hook?token=of-the-address"
    assert headers["Idempotency-Key"] == headers["X-Slowtime-Event"] == sent.event
    stamp = headers["X-Slowtime-Timestamp"]
    assert abs(int(stamp) - time.time()) < 60
    right = hmac.new(SECRET.encode(), f"{stamp}.".encode() + payload, hashlib.sha256)
    assert headers["X-Slowtime-Signature"] == f"v1={right.hexdigest()}"
    (told,) = server.told
    assert (told["twin"], told["kind"], told["sequence"]) == ("lab.beam", "alarm", 7)
    assert told["page"] == "https://twin.example/#lab.beam"
    assert told["details"]["limit"] == -0.03


def test_a_reminder_is_another_message_about_the_same_event():
    first, again = message(), message(reminder=2)
    assert again.key == f"{first.key}-r2"
    assert again.event == first.event


def test_the_same_message_has_the_same_bytes_at_each_attempt():
    assert message().payload == message().payload


@pytest.mark.parametrize("status", [301, 302, 307, 400, 404, 500, 503])
def test_what_is_not_a_success_is_no_delivery_and_no_redirection_is_followed(
    hook, secret, status
):
    elsewhere = hook()
    server = hook(lambda n: status, headers=[("Location", elsewhere.url), ("Retry-After", "7")])
    with pytest.raises(NotDeliveredError, match=f"answered {status}") as failed:
        sender(kind="webhook", url=server.url, secret_file=secret).send(message())
    assert failed.value.wait_s == 7.0
    assert elsewhere.requests == []
    assert "of-the-address" not in str(failed.value)


def test_a_proxy_of_the_environment_is_not_asked(hook, secret, monkeypatch):
    proxy, server = hook(), hook()
    monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{proxy.port}")
    sender(kind="webhook", url=server.url, secret_file=secret).send(message())
    assert (len(proxy.requests), len(server.requests)) == (0, 1)


def test_a_receiver_that_answers_byte_by_byte_is_cut_off(secret):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        over = threading.Event()

        def trickle():
            peer, _ = listening.accept()
            with peer:
                for byte in b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 10_000:
                    if over.wait(0.05):
                        return
                    try:
                        peer.sendall(bytes([byte]))
                    except OSError:
                        return

        thread = threading.Thread(target=trickle)
        thread.start()
        url = f"http://127.0.0.1:{listening.getsockname()[1]}/"
        began = time.monotonic()
        with pytest.raises(NotDeliveredError, match="The receiver: "):
            sender(kind="webhook", url=url, secret_file=secret, timeout_s=0.5).send(message())
        assert time.monotonic() - began < 60
        over.set()
        thread.join()


def test_nobody_there_is_said_in_words(secret):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{taken.getsockname()[1]}/"
        with pytest.raises(NotDeliveredError, match="nothing listens there"):
            sender(kind="webhook", url=url, secret_file=secret).send(message())


def test_a_mail_tells_who_what_and_where_and_can_be_told_from_its_double(mail_server):
    box, port = mail_server()
    post = sender(
        kind="email", host="127.0.0.1", port=port, security="none",
        sender="twin@house.example", to=["ann@house.example", "bob@house.example"],
    )  # fmt: skip
    sent = message("Stiffness is\nlost.", page_url="https://twin.example")
    for _ in range(2):
        assert post.send(sent) == ""
    (to, text), (_, again) = box.mails
    mail = email.message_from_string(text)
    assert to == ["ann@house.example", "bob@house.example"]
    assert mail["Subject"].replace("\r\n", "") == "slowtime alarm: lab.beam: Stiffness is lost."
    assert mail["Message-ID"] == f"<{sent.key}@house.example>"
    assert email.message_from_string(again)["Message-ID"] == mail["Message-ID"]
    assert mail["X-Slowtime-Event"] == sent.event
    assert "https://twin.example/#lab.beam" in mail.get_payload()


@pytest.mark.parametrize(
    ("t_ns", "slow_time", "unit", "lines"),
    [
        (5, 7.0, "T0", ["Slow time: 7 natural periods"]),
        (5, 7.0, None, ["Slow time: 7"]),
        (5, None, None, []),
        (
            1_700_000_000 * 10**9, 12.5, "d",
            ["Time: 2023-11-14 22:13:20 UTC", "Slow time: 12.5 days"],
        ),
        (1_700_000_000 * 10**9, 1.7e9, "s", ["Time: 2023-11-14 22:13:20 UTC"]),
        (1_700_000_000 * 10**9, None, None, ["Time: 2023-11-14 22:13:20 UTC"]),
    ],
)  # fmt: skip
def test_a_mail_gives_slow_time_with_its_unit_and_a_clock_as_a_date(
    t_ns, slow_time, unit, lines
):
    receiver = EmailReceiver(
        kind="email", host="127.0.0.1", security="none", sender="twin@house.example",
        to=("ann@house.example",),
    )  # fmt: skip
    mail = mail_of(message(t_ns=t_ns, slow_time=slow_time, unit=unit), receiver)
    text = mail.get_content()
    assert [line for line in text.splitlines() if "ime: " in line] == lines


def test_of_several_recipients_those_that_are_refused_are_named(mail_server):
    box, port = mail_server()
    told = dict(kind="email", host="127.0.0.1", port=port, security="none", sender="a@b.c")
    some = sender(**told, to=["ann@b.c", "nobody@b.c"])
    assert some.send(message()) == "Refused for nobody@b.c."
    assert [to for to, _ in box.mails] == [["ann@b.c"]]
    with pytest.raises(NotDeliveredError, match="refused all recipients"):
        sender(**told, to=["nobody@b.c"]).send(message())


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Folder with certificate, key and authority of this machine."""
    authority = Authority.open(tmp_path_factory.mktemp("keys"), "lab")
    return authority.issue("server", hosts=("localhost", "127.0.0.1"))


def tls_of(keys):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(keys / "certificate.pem", keys / "key.pem")
    return context


def password(tmp_path, text="ann\nof ann\n"):
    path = tmp_path / "credentials"
    path.write_text(text)
    return path


def test_a_password_travels_after_starttls_and_a_wrong_one_or_authority_is_said(
    mail_server, only_ann, keys, tmp_path
):
    box, port = mail_server(
        tls_context=tls_of(keys), require_starttls=True, authenticator=only_ann,
        auth_required=True,
    )  # fmt: skip
    told = dict(kind="email", host="localhost", port=port, sender="a@b.c", to=["d@b.c"])
    told["credentials_file"] = password(tmp_path)
    sender(**told, ca=keys / "ca.pem").send(message())
    assert len(box.mails) == 1
    with pytest.raises(NotDeliveredError, match="CERTIFICATE_VERIFY_FAILED"):
        sender(**told).send(message())
    password(tmp_path, "ann\nof bob\n")
    with pytest.raises(NotDeliveredError, match="answered 535"):
        sender(**told, ca=keys / "ca.pem").send(message())
    assert len(box.mails) == 1


def test_a_certificate_of_another_name_is_refused(mail_server, tmp_path):
    other = Authority.open(tmp_path, "lab").issue("server", hosts=("elsewhere.example",))
    box, port = mail_server(tls_context=tls_of(other))
    post = sender(
        kind="email", host="localhost", port=port, sender="a@b.c", to=["d@b.c"],
        ca=other / "ca.pem",
    )  # fmt: skip
    with pytest.raises(NotDeliveredError, match="CERTIFICATE_VERIFY_FAILED"):
        post.send(message())
    assert box.mails == []


def test_mail_that_is_encrypted_from_the_first_byte(mail_server, keys):
    box, port = mail_server(ssl_context=tls_of(keys))
    post = sender(
        kind="email", host="localhost", port=port, security="tls", sender="a@b.c",
        to=["d@b.c"], ca=keys / "ca.pem",
    )  # fmt: skip
    post.send(message())
    assert len(box.mails) == 1


def test_mqtt_is_published_on_the_topic_of_the_twin_once_the_broker_has_it(broker):
    start, listen = broker
    port = start()
    heard = listen(port, "house/#")
    sent = message()
    publish = sender(
        kind="mqtt", host="127.0.0.1", port=port, topic="house/{site}/{asset}/{severity}"
    )
    publish.send(sent)
    deadline = time.monotonic() + 30
    while not heard and time.monotonic() < deadline:
        time.sleep(0.01)
    (one,) = heard
    assert (one.topic, one.qos) == ("house/lab/beam/alarm", 1)
    assert one.payload == sent.payload
    labels = dict(one.properties.UserProperty)
    assert labels == {"idempotency-key": sent.key, "slowtime-event": sent.event}


def test_a_broker_that_refuses_is_said_to(broker, tmp_path):
    start, _ = broker
    port = start(["allow_anonymous false"])
    publish = sender(kind="mqtt", host="127.0.0.1", port=port)
    with pytest.raises(NotDeliveredError, match="refused: Not authorized"):
        publish.send(message())
    with socket.create_server(("127.0.0.1", 0)) as silent:
        mute = sender(
            kind="mqtt", host="127.0.0.1", port=silent.getsockname()[1], timeout_s=0.3
        )
        with pytest.raises(NotDeliveredError, match="did not answer in time"):
            mute.send(message())


@pytest.mark.parametrize(
    ("receiver", "says"),
    [
        ({"kind": "webhook", "url": "http://hooks.example/x", "secret_env": "S"}, "over http"),
        ({"kind": "webhook", "url": "file:///etc/passwd", "secret_env": "S"}, "HOST/PATH"),
        ({"kind": "webhook", "url": "https://a@b.example/", "secret_env": "S"}, "without user"),
        ({"kind": "webhook", "url": "https://b.example/"}, "secret_file or secret_env"),
        (
            {"kind": "email", "host": "m.example", "security": "none", "sender": "a@b.c",
             "to": ["a@b.c"], "credentials_file": "x"},
            "without encryption",
        ),
        (
            {"kind": "email", "host": "m.example", "sender": "a@b.c",
             "to": ["a@b.c\r\nBcc: d@e.f"]},
            "pattern",
        ),
        ({"kind": "mqtt", "host": "m", "credentials_file": "x"}, "without encryption"),
        ({"kind": "mqtt", "host": "m", "topic": "a/{twin.__class__}"}, "Allowed in braces"),
        ({"kind": "mqtt", "host": "m", "topic": "a/#"}, "pattern"),
    ],
)  # fmt: skip
def test_a_receiver_that_is_not_safe_or_not_whole_is_refused(receiver, says):
    with pytest.raises(ValidationError, match=says):
        TypeAdapter(Receiver).validate_python(receiver)


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "cannot be read"), ("short", "has 5 bytes.*openssl rand"), (" \n", "has 0 bytes")],
)
def test_a_secret_that_is_missing_or_short_is_named_before_anything_is_sent(
    tmp_path, content, says
):
    path = tmp_path / "secret"
    if content is not None:
        path.write_text(content)
    with pytest.raises(
        WrongReceiverError, match=f"receiver ops cannot be used.*{says}"
    ) as told:
        sender(kind="webhook", url="https://a.example/", secret_file=path)
    assert str(tmp_path) not in str(told.value)


def test_a_file_of_credentials_has_two_lines(tmp_path):
    with pytest.raises(WrongReceiverError, match=r"holds 1 line\(s\)"):
        sender(kind="mqtt", host="127.0.0.1", credentials_file=password(tmp_path, "ann\n"))

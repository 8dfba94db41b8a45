"""Signed heads are kept elsewhere: in a file, at an address, by a time-stamping authority."""

import contextlib
import http.server
import json
import shutil
import subprocess
import threading

import pytest

from slowtime_services.credentials import Signer, make_key
from slowtime_services.credentials.timestamps import TimestampError, stamped
from slowtime_services.ledger import Head, headed, last_head
from twin_server.notify import witnesses
from twin_server.notify.witnesses import HeadWitnesses
from twin_server.settings import LedgerSettings


@pytest.fixture
def heads(tmp_path):
    make_key(tmp_path / "key.pem")
    signer, found = Signer.read(tmp_path / "key.pem"), list[Head]()
    for number in range(3):
        found.append(
            headed("ab" * 32, 1, found[-1] if found else None, 10**18 + number, signer)
        )
    return found


@contextlib.contextmanager
def answering(answer):
    """An HTTP server that answers each POST with a status and a body made of the payload."""
    got = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            payload = self.rfile.read(int(self.headers["Content-Length"]))
            got.append((self.headers["Content-Type"], payload))
            status, body = answer(payload)
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            """Say nothing."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/heads", got
        server.shutdown()
        thread.join()


def told(settings, heads):
    witness = HeadWitnesses(settings)
    for head in heads:
        witness.take(head)
    witness.close()
    return witness


def test_a_file_of_heads_is_only_appended_to_and_read_back(tmp_path, heads):
    path = tmp_path / "elsewhere" / "heads.jsonl"
    settings = LedgerSettings(witness_file=path)
    assert HeadWitnesses(settings).last is None
    for head in heads:
        told(settings, [head])
    lines = [Head.of(json.loads(line)) for line in path.read_text().splitlines()]
    assert lines == heads
    assert HeadWitnesses(settings).last == heads[-1]


def test_a_file_without_a_head_is_refused(tmp_path):
    path = tmp_path / "heads.jsonl"
    for text in ("", "no head\n", '{"number": 1}\n', "[]\n"):
        path.write_text(text)
        with pytest.raises(ValueError, match="holds no head"):
            last_head(path)


@pytest.mark.parametrize(
    "cut", ['{"number": 2, "t_', '{"number": 2, "t_\n', '{"number": 2}\n\n']
)
def test_a_line_that_was_cut_off_is_no_head_and_harms_none(tmp_path, heads, cut):
    """As a volume leaves it that was full while a head was written."""
    path = tmp_path / "heads.jsonl"
    settings = LedgerSettings(witness_file=path)
    told(settings, heads[:1])
    with path.open("a") as file:
        file.write(cut)
    assert HeadWitnesses(settings).last == heads[0]
    told(settings, heads[1:2])
    assert HeadWitnesses(settings).last == heads[1]
    assert Head.of(json.loads(path.read_text().splitlines()[-1])) == heads[1]


def test_an_address_gets_each_head_as_json(heads):
    with answering(lambda _: (200, b"")) as (url, got):
        assert told(LedgerSettings(witness_url=url), heads[:1]).failures == 0
    [(kind, payload)] = got
    assert kind == "application/json"
    assert Head.of(json.loads(payload)) == heads[0]


def test_an_address_that_fails_is_tried_again_with_the_newest_head(heads, monkeypatch):
    monkeypatch.setattr(witnesses, "RETRY_S", 0.05)
    statuses = iter([500, 200, 200, 200])
    with answering(lambda _: (next(statuses), b"")) as (url, got):
        witness = HeadWitnesses(LedgerSettings(witness_url=url))
        witness.take(heads[0])
        for _ in range(100):
            if len(got) >= 2:
                break
            threading.Event().wait(0.05)
        witness.close()
    assert witness.failures == 1
    assert [Head.of(json.loads(payload)) for _, payload in got[:2]] == [heads[0]] * 2


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    """A time-stamping authority made with OpenSSL."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl")
    pytest.importorskip("rfc3161_client", reason="pip install 'slowtime[timestamps]'")
    folder = tmp_path_factory.mktemp("tsa")

    def openssl(*words):
        subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)

    (folder / "tsa.cnf").write_text(
        "[tsa]\ndefault_tsa = own\n[own]\nserial = serial\nsigner_cert = tsa.crt\n"
        "signer_key = tsa.key\nsigner_digest = sha256\n"
        "default_policy = 1.2.3.4.1\ndigests = sha256, sha512\nordering = yes\n"
        "ess_cert_id_chain = no\ness_cert_id_alg = sha256\n"
        "[ext]\nextendedKeyUsage = critical,timeStamping\n"
        "keyUsage = critical,digitalSignature\n"
        "basicConstraints = CA:false\nsubjectKeyIdentifier = hash\n"
        "authorityKeyIdentifier = keyid\n"
    )
    (folder / "serial").write_text("01")
    for name in ("root", "other"):
        openssl(
            "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", f"{name}.key", "-out",
            f"{name}.crt", "-subj", f"/CN={name}", "-days", "30",
        )  # fmt: skip
    openssl(
        "req", "-newkey", "rsa:2048", "-nodes", "-keyout", "tsa.key", "-out", "tsa.csr",
        "-subj", "/CN=tsa",
    )  # fmt: skip
    openssl(
        "x509", "-req", "-in", "tsa.csr", "-CA", "root.crt", "-CAkey", "root.key",
        "-CAcreateserial", "-out", "tsa.crt", "-days", "30", "-extfile", "tsa.cnf",
        "-extensions", "ext",
    )  # fmt: skip

    def answer(request):
        (folder / "query").write_bytes(request)
        openssl("ts", "-reply", "-config", "tsa.cnf", "-queryfile", "query", "-out", "answer")
        return 200, (folder / "answer").read_bytes()

    return folder, answer


def test_an_authority_stamps_heads_and_the_stamp_is_of_that_head_only(
    authority, heads, tmp_path
):
    folder, answer = authority
    kept = tmp_path / "stamps"
    with answering(answer) as (url, got):
        settings = LedgerSettings(timestamp_url=url, timestamp_folder=kept)
        assert told(settings, heads[:1]).failures == 0
    assert got[0][0] == "application/timestamp-query"
    assert last_head(kept / "head-1.json") == heads[0]
    stamp = (kept / "head-1.tsr").read_bytes()
    assert stamped(heads[0].hashed, stamp, folder / "root.crt").serial == 2
    with pytest.raises(TimestampError, match="not one of this head"):
        stamped(heads[1].hashed, stamp, folder / "root.crt")
    with pytest.raises(TimestampError, match="not one of this head"):
        stamped(heads[0].hashed, stamp, folder / "other.crt")
    with pytest.raises(TimestampError, match="no answer of RFC 3161"):
        stamped(heads[0].hashed, b"nonsense", folder / "root.crt")


def test_an_answer_to_another_question_is_not_kept(authority, heads, tmp_path):
    _, answer = authority
    first = []

    def replayed(request):
        first.append(answer(request))
        return first[0]

    with answering(replayed) as (url, _):
        settings = LedgerSettings(timestamp_url=url, timestamp_folder=tmp_path)
        assert told(settings, heads[:1]).failures == 0
        assert told(settings, heads[1:2]).failures == 1
    assert not (tmp_path / "head-2.tsr").exists()

"""Who may read an OPC UA server with a certificate: clients that encrypt, with the password."""

import asyncio
import datetime

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import NameOID

from slowtime_services.outputs.settings import OpcUaSettings
from tests.twin_server.serve.outputs.conftest import free_port

asyncua = pytest.importorskip("asyncua")


def certificate(folder, name, uri):
    """Paths of a certificate of its own and of its key (PEM)."""
    key = rsa.generate_private_key(65537, 2048)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now, day = datetime.datetime.now(datetime.UTC), datetime.timedelta(days=1)
    names = x509.SubjectAlternativeName([x509.UniformResourceIdentifier(uri)])
    made = (
        x509.CertificateBuilder()
        .subject_name(subject).issuer_name(subject).public_key(key.public_key())
        .serial_number(1).not_valid_before(now - day).not_valid_after(now + day)
        .add_extension(names, critical=False).sign(key, hashes.SHA256())
    )  # fmt: skip
    paths = folder / f"{name}.pem", folder / f"{name}_key.pem"
    paths[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    paths[1].write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    return paths


def test_encryption_and_the_password_are_needed(tmp_path):
    from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

    from slowtime_services.outputs.receivers.opc_ua import NAMESPACE, OpcUaOutput

    server, key = certificate(tmp_path, "server", "urn:freeopcua:python:server")
    own = certificate(tmp_path, "client", "urn:example.org:FreeOpcUa:opcua-asyncio")
    known = tmp_path / "credentials"
    known.write_text("ann\nher word\n")
    port = free_port()
    output = OpcUaOutput(
        "a",
        OpcUaSettings(
            kind="opcua", port=port, certificate=server, key=key, credentials_file=known
        ),
    )

    async def index(user, password, *, is_secure=True):
        client = asyncua.Client(f"opc.tcp://127.0.0.1:{port}/slowtime/", timeout=60)
        client.set_user(user)
        client.set_password(password)
        if is_secure:
            await client.set_security(SecurityPolicyBasic256Sha256, *map(str, own))
        async with client:
            return await client.get_namespace_index(NAMESPACE)

    output.start()
    try:
        assert asyncio.run(index("ann", "her word")) == 2
        for user, password in (("ann", "another"), ("", "")):
            with pytest.raises(asyncua.ua.uaerrors.BadUserAccessDenied):
                asyncio.run(index(user, password))
        with pytest.raises(asyncua.ua.UaError, match="No matching endpoints"):
            asyncio.run(index("ann", "her word", is_secure=False))
    finally:
        output.close()

"""A small certificate authority for one site, kept in a folder.

Keys are P-256; certificates of the authority last ten years, all others a year unless told
otherwise. A private key is written with mode 0600 into a folder of mode 0700, and never read
by anybody but its process. The authority's own is needed only to issue: keep it off the
machines at the site.
"""

import contextlib
import dataclasses
import datetime
import ipaddress
import json
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from .access import access_control
from .roles import ROLES, common_name

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

KEY, CERTIFICATE, TRUSTED, ACCESS = "key.pem", "certificate.pem", "ca.pem", "access.json"
LEDGER = "issued.json"
MOST_HOSTS, LONGEST_HOST = 64, 253
"""Hosts of a certificate [1], and characters of each (RFC 1035, 2.3.4): a certificate is sent
with each connection, before anything is known of who asks."""
TEN_YEARS = datetime.timedelta(days=3652)
SLACK = datetime.timedelta(hours=1)
"""Clocks of a site differ; a certificate is valid from so long before it was made."""


class WrongAuthorityError(ValueError):
    """A folder that holds no authority, or another site's."""


@dataclasses.dataclass(frozen=True, slots=True)
class Issued:
    """One certificate in the ledger."""

    role: str
    site: str
    asset: str | None
    name: str
    expires: str
    hosts: tuple[str, ...] = ()
    withdrawn: bool = False

    @property
    def folder(self) -> str:
        """Where its files are, beside the authority's."""
        return self.role if self.asset is None else f"{self.role}-{self.asset}"

    def left(self, now: datetime.datetime) -> datetime.timedelta:
        """Remaining validity."""
        return datetime.datetime.fromisoformat(self.expires) - now


class Authority:
    """The authority of a site.

    Parameters
    ----------
    home
        Folder that holds ``authority/`` and, beside it, a folder for each credential.
    """

    def __init__(self, home: Path, site: str, issued: Sequence[Issued]) -> None:
        self.home, self.site, self._issued = home, site, list(issued)

    @classmethod
    def open(cls, home: Path, site: str | None = None) -> Self:
        """Open the authority in `home`; make it, if there is none and `site` is given.

        Raises
        ------
        WrongAuthorityError
            If there is none, or one of another site.
        """
        ledger = home / "authority" / LEDGER
        if not ledger.exists():
            if site is None:
                raise WrongAuthorityError(
                    f"{home} holds no authority. Make one with slowtime keys make SITE "
                    f"--out {home}."
                )
            return cls._create(home, site)
        kept = json.loads(ledger.read_text())
        if site not in (None, kept["site"]):
            raise WrongAuthorityError(
                f"{home} is the authority of {kept['site']}, and {site} was asked for. Give "
                "each site a folder of its own."
            )
        issued = [
            Issued(**entry | {"hosts": tuple(entry["hosts"])}) for entry in kept["issued"]
        ]
        return cls(home, kept["site"], issued)

    @classmethod
    def _create(cls, home: Path, site: str) -> Self:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes
        from cryptography.hazmat.primitives.asymmetric import ec

        key = ec.generate_private_key(ec.SECP256R1())
        name = _subject(f"slowtime authority of {site}"[:64])
        certificate = (
            _certificate_builder(
                name, name, key.public_key(), secrets.randbits(159) | 1, TEN_YEARS
            )
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_certificates=True), critical=True)
            .add_extension(
                x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False
            )
            .sign(key, hashes.SHA256())
        )
        with _folder(home / "authority") as folder:
            _write(folder / KEY, _private(key))
            _write(folder / CERTIFICATE, _public(certificate))
        authority = cls(home, site, ())
        authority._keep()
        return authority

    @property
    def issued(self) -> tuple[Issued, ...]:
        """All certificates ever issued, oldest first."""
        return tuple(self._issued)

    @property
    def valid(self) -> tuple[Issued, ...]:
        """Those that are neither withdrawn nor expired."""
        now = _now()
        return tuple(i for i in self._issued if not i.withdrawn and i.left(now) > SLACK * 0)

    def has(self, role: str, asset: str | None = None) -> bool:
        """Whether a valid certificate of this kind exists."""
        return any((i.role, i.asset) == (role, asset) for i in self.valid)

    def issue(
        self,
        role: str,
        asset: str | None = None,
        *,
        hosts: Sequence[str] = (),
        lasts: datetime.timedelta = datetime.timedelta(days=365),
        from_now: datetime.timedelta = datetime.timedelta(0),
    ) -> Path:
        """Make a credential; earlier ones stay valid until withdrawn.

        Parameters
        ----------
        role
            A word of `ROLES`; an edge is one of an `asset`.
        hosts
            Names and addresses at which others connect to it.
        lasts
            For how long it is valid.
        from_now
            When that begins; for certificates of the past, and of the future.

        Returns
        -------
        The folder with ``ca.pem``, ``certificate.pem`` and ``key.pem``.
        """
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes
        from cryptography.hazmat.primitives.asymmetric import ec

        if role not in ROLES:
            raise ValueError(f"{role!r} is not a valid role. Allowed: {', '.join(ROLES)}.")
        if (asset is None) == (role == "edge"):
            raise ValueError(f"An edge has an asset, others have none; given {role}, {asset}.")
        _check_hosts(hosts)
        own_key, own = self._own_certificate()
        key, serial = ec.generate_private_key(ec.SECP256R1()), secrets.randbits(159) | 1
        name = common_name(role, self.site, asset, serial)
        builder = (
            _certificate_builder(
                _subject(name), own.subject, key.public_key(), serial, lasts, from_now
            )
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(), critical=True)
            .add_extension(_purposes(role), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(own_key.public_key()),
                critical=False,
            )
            .add_extension(x509.SubjectAlternativeName([*map(_host, hosts or [name])]), False)
        )
        certificate = builder.sign(own_key, hashes.SHA256())
        expires = certificate.not_valid_after_utc.isoformat()
        entry = Issued(role, self.site, asset, name, expires, tuple(hosts))
        self._issued.append(entry)
        with _folder(self.home / entry.folder) as folder:
            _write(folder / TRUSTED, _public(own))
            _write(folder / CERTIFICATE, _public(certificate))
            _write(folder / KEY, _private(key))
        self._keep()
        return folder

    def withdraw(self, role: str, asset: str | None = None) -> int:
        """Withdraw all such certificates; return their number.

        The router refuses them from when it is next started with its new ``access.json``.
        """
        found = [i for i in self.valid if (i.role, i.asset) == (role, asset)]
        self._issued = [
            dataclasses.replace(i, withdrawn=True) if i in found else i for i in self._issued
        ]
        if found:
            shutil.rmtree(self.home / found[0].folder, ignore_errors=True)
        self._keep()
        return len(found)

    def renew(
        self, within: datetime.timedelta, lasts: datetime.timedelta = datetime.timedelta(365)
    ) -> list[Issued]:
        """Issue again, for the same hosts, what expires `within` a time; return them."""
        newest = {(i.role, i.asset): i for i in self._issued if not i.withdrawn}
        due = [i for i in newest.values() if i.left(_now()) <= within]
        for old in due:
            self.issue(old.role, old.asset, hosts=old.hosts, lasts=lasts)
        return self._issued[-len(due) :] if due else []

    def _own_certificate(self) -> "tuple[EllipticCurvePrivateKey, x509.Certificate]":
        from cryptography import x509
        from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        folder = self.home / "authority"
        key = load_pem_private_key((folder / KEY).read_bytes(), None)
        assert isinstance(key, EllipticCurvePrivateKey)
        return key, x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())

    def _keep(self) -> None:
        """Write the ledger, and the router's settings that follow from it."""
        ledger = {"site": self.site, "issued": [dataclasses.asdict(i) for i in self._issued]}
        _write(self.home / "authority" / LEDGER, _json(ledger))
        if (router := self.home / "router").is_dir():
            _write(router / ACCESS, _json(access_control(self.valid)))


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


def _subject(name: str) -> "x509.Name":
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _certificate_builder(
    subject: "x509.Name",
    issuer: "x509.Name",
    key: Any,
    serial: int,
    lasts: datetime.timedelta,
    from_now: datetime.timedelta = datetime.timedelta(0),
) -> "x509.CertificateBuilder":
    from cryptography import x509

    begins = _now() + from_now
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(serial)
        .not_valid_before(begins - SLACK)
        .not_valid_after(begins + lasts)
    )


def _usage(*, signs_certificates: bool = False) -> "x509.KeyUsage":
    from cryptography import x509

    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _purposes(role: str) -> "x509.ExtendedKeyUsage":
    from cryptography import x509
    from cryptography.x509.oid import ExtendedKeyUsageOID as Purpose

    listens = role in ("router", "server")
    return x509.ExtendedKeyUsage(
        [Purpose.CLIENT_AUTH, *([Purpose.SERVER_AUTH] if listens else [])]
    )


def _host(host: str) -> "x509.GeneralName":
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host) if ":" not in host else x509.UniformResourceIdentifier(host)


def _check_hosts(hosts: Sequence[str]) -> None:
    longest = max(map(len, hosts), default=0)
    if len(hosts) > MOST_HOSTS or longest > LONGEST_HOST:
        raise ValueError(
            f"A certificate for {len(hosts)} hosts was asked for, with names of up to "
            f"{longest} characters. Allowed: {MOST_HOSTS} hosts, of up to {LONGEST_HOST} "
            "characters. Give the addresses at which this computer is reached, or one name "
            "for all of them."
        )


def _private(key: "EllipticCurvePrivateKey") -> bytes:
    from cryptography.hazmat.primitives import serialization as ser

    return key.private_bytes(ser.Encoding.PEM, ser.PrivateFormat.PKCS8, ser.NoEncryption())


def _public(certificate: "x509.Certificate") -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding

    return certificate.public_bytes(Encoding.PEM)


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode()


@contextlib.contextmanager
def _folder(path: Path) -> Iterator[Path]:
    path.mkdir(parents=True, exist_ok=True, mode=0o700)
    path.chmod(0o700)
    yield path


def _write(path: Path, content: bytes) -> None:
    """Write a file with owner-only access, whole or not at all."""
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)

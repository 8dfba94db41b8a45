"""A credential's folder → settings of Zenoh; an unsafe folder is refused."""

import dataclasses
import datetime
import ipaddress
import json
import logging
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from slowtime_services.operating_system import access_of_others

from .access import in_both_versions
from .authority import ACCESS, CERTIFICATE, KEY, TRUSTED
from .roles import common_name

logger = logging.getLogger(__name__)

TLS = "transport/link/tls"
SOON = datetime.timedelta(days=30)
ENCRYPTED = ("tls/", "quic/")
OF_ONE_MACHINE = ("unixsock-stream/", "unixpipe/", "vsock/", "serial/")


class CredentialsError(ValueError):
    """A credential that is not there, not whole, expired, or readable by others."""


class NotNowError(CredentialsError):
    """A certificate that is expired, or not yet valid."""


@dataclasses.dataclass(frozen=True, slots=True)
class Credentials:
    """A folder made by `slowtime keys`, of one process."""

    folder: Path
    name: str
    expires: datetime.datetime

    @classmethod
    def read(cls, folder: Path, *, at_any_time: bool = False) -> Self:
        """Read a folder; with `at_any_time`, an invalid date is only logged.

        Raises
        ------
        CredentialsError
            If a file is missing or not what it should be, others may read the key, or the
            certificate is not valid now.
        """
        from cryptography import x509
        from cryptography.x509.oid import NameOID

        missing = [n for n in (TRUSTED, CERTIFICATE, KEY) if not (folder / n).is_file()]
        if missing:
            raise CredentialsError(
                f"{folder} has no {', '.join(missing)}. Give a folder that `slowtime keys` "
                "made, such as keys/server."
            )
        if access_of_others(folder / KEY):
            mode = stat.S_IMODE((folder / KEY).stat().st_mode)
            raise CredentialsError(
                f"{folder / KEY} holds a secret, but other users of this computer can "
                f"read it (permissions {mode:04o}; must be 0600). Run: chmod 600 "
                f"{folder / KEY}. If somebody may have read it, revoke the certificate "
                "with `slowtime keys withdraw` and issue a new one."
            )
        try:
            certificate = x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())
        except ValueError as error:
            raise CredentialsError(
                f"{folder / CERTIFICATE} is not a valid certificate: {error}. "
                "Have it issued again."
            ) from error
        names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        found = cls(
            folder, str(names[0].value) if names else "", certificate.not_valid_after_utc
        )
        try:
            found._check_time(certificate.not_valid_before_utc)
        except NotNowError as error:
            if not at_any_time:
                raise
            logger.error("%s", error)
        return found

    def _check_time(self, begins: datetime.datetime) -> None:
        now = datetime.datetime.now(datetime.UTC)
        if now >= self.expires:
            raise NotNowError(
                f"The certificate in {self.folder} expired on {self.expires:%Y-%m-%d %H:%M} "
                "UTC. Run `slowtime keys renew` on the computer where the keys were made, and "
                "copy the renewed folder here."
            )
        if now < begins:
            raise NotNowError(
                f"The certificate in {self.folder} is not valid yet: it starts at "
                f"{begins:%Y-%m-%d %H:%M} UTC, but the clock of this computer says "
                f"{now:%Y-%m-%d %H:%M} UTC. Correct the clock. If it is right, the "
                "certificate was issued on a computer whose clock was ahead: issue it "
                "again."
            )
        if self.expires - now < SOON:
            logger.warning(
                "The certificate in %s expires in %d days. Renew it: slowtime keys renew.",
                self.folder,
                (self.expires - now).days,
            )

    def check_is_of_edge(self, site: str, asset: str) -> None:
        """Refuse another asset's credential, with which a router would drop every message.

        Raises
        ------
        CredentialsError
            If it is not that of the edge agent of this asset.
        """
        own = common_name("edge", site, asset, 0).rpartition(":")[0]
        if self.name.rpartition(":")[0] != own:
            raise CredentialsError(
                f"{self.folder} is the credential of {self.name or 'nobody'}, and this is the "
                f"edge agent of {site}.{asset}. Give the folder keys/edge-{asset}, or correct "
                "--site and --asset."
            )

    def client_options(self) -> dict[str, Any]:
        """Return settings of Zenoh for a process that connects."""
        return {
            f"{TLS}/root_ca_certificate": str(self.folder / TRUSTED),
            f"{TLS}/enable_mtls": True,
            f"{TLS}/connect_private_key": str(self.folder / KEY),
            f"{TLS}/connect_certificate": str(self.folder / CERTIFICATE),
            f"{TLS}/verify_name_on_connect": True,
            f"{TLS}/close_link_on_expiration": True,
        }

    def router_options(self) -> dict[str, Any]:
        """Return settings of Zenoh for a router: who may connect, and the rights of each.

        Raises
        ------
        CredentialsError
            If the folder is not a router's.
        """
        path = self.folder / ACCESS
        if not path.is_file():
            raise CredentialsError(
                f"{self.folder} has no {ACCESS}, which says who may do what. Give a router's "
                "folder, such as keys/router."
            )
        return self.client_options() | {
            f"{TLS}/listen_private_key": str(self.folder / KEY),
            f"{TLS}/listen_certificate": str(self.folder / CERTIFICATE),
            "access_control": in_both_versions(json.loads(path.read_text())),
        }


def options_for(
    credentials: Path | None,
    endpoints: Sequence[str],
    more: Mapping[str, Any] | None = None,
    *,
    at_any_time: bool = False,
) -> dict[str, Any]:
    """Return settings of Zenoh for a process that connects, with credentials or without.

    An edge goes on listening and keeps its features `at_any_time`: its clock may be wrong, and
    an expired certificate is no reason to lose what it was put there to hear.

    Raises
    ------
    CredentialsError
        If there are credentials and an endpoint that does not ask for them.
    """
    if credentials is None:
        return dict(more or {})
    check_encrypted(endpoints)
    found = Credentials.read(credentials, at_any_time=at_any_time)
    return found.client_options() | dict(more or {})


def check_encrypted(endpoints: Sequence[str]) -> None:
    """Refuse endpoints at which credentials would be of no use."""
    bare = [e for e in endpoints if not e.startswith(ENCRYPTED)]
    if bare:
        raise CredentialsError(
            f"Credentials were given, and {', '.join(bare)} is not encrypted. Give an endpoint "
            "such as tls/127.0.0.1:7447, and the router its own credentials."
        )


def reachable_from_elsewhere(endpoints: Sequence[str]) -> list[str]:
    """Those at which other machines may connect, in the clear.

    Examples
    --------
    >>> reachable_from_elsewhere(["tcp/127.0.0.1:7447", "tcp/[::1]:1", "tls/0.0.0.0:7447"])
    []
    >>> reachable_from_elsewhere(["tcp/0.0.0.0:7447", "udp/[::]:7447"])
    ['tcp/0.0.0.0:7447', 'udp/[::]:7447']
    """
    return [
        e
        for e in endpoints
        if not e.startswith((*ENCRYPTED, *OF_ONE_MACHINE)) and not _loopback(e)
    ]


def _loopback(endpoint: str) -> bool:
    host = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"

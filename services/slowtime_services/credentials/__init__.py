"""Certificates of a site in; TLS settings and access control of the bus out."""

from .access import access_control
from .authority import Authority, Issued, WrongAuthorityError
from .credential_folder import Credentials, CredentialsError, NotNowError, options_for
from .roles import ROLES, Role, common_name
from .signing import Signer, fingerprint, is_signed, make_key, public_key

__all__ = [
    "ROLES",
    "Authority",
    "Credentials",
    "CredentialsError",
    "Issued",
    "NotNowError",
    "Role",
    "Signer",
    "WrongAuthorityError",
    "access_control",
    "common_name",
    "fingerprint",
    "is_signed",
    "make_key",
    "options_for",
    "public_key",
]

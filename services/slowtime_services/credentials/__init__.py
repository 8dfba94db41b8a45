"""Who may speak on the bus: a site's own certificates in, TLS and access control out."""

from .access import access_control
from .authority import Authority, Issued, WrongAuthorityError
from .folder import Credentials, CredentialsError, NotNowError, options_for
from .roles import ROLES, Role, common_name

__all__ = [
    "ROLES",
    "Authority",
    "Credentials",
    "CredentialsError",
    "Issued",
    "NotNowError",
    "Role",
    "WrongAuthorityError",
    "access_control",
    "common_name",
    "options_for",
]

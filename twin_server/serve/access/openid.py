"""JWTs of an OpenID provider: signed by a key it publishes, for this server, not expired.

Only asymmetric signatures are let in, whatever a token says of itself. Keys come from a file,
or from an address that is asked at most twice a minute, however many unknown keys are named.
"""

import hashlib
import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from slowtime_services.documents.json_documents import read_json
from slowtime_services.outbound.connections import fetch
from slowtime_services.reasons import reason_of
from twin_server.identity.principals import Principal, Scope
from twin_server.identity.tokens import RefusedTokenError, WrongTokenFileError
from twin_server.settings import OpenIdSettings

if TYPE_CHECKING:
    import jwt

logger = logging.getLogger(__name__)

LARGEST = 2**20
"""Bytes that are read of a document of the provider, at most."""

FETCH_S = 5.0
"""Longest wait for the provider [s]; those who present tokens wait meanwhile."""

REMEMBERED = 2_000
"""Verified tokens that are remembered, the newest."""

REMEMBERED_S = 60.0
"""Time for which a verified token is remembered [s]."""

KEYS_LAST_S = 600.0
"""Age at which the keys of the provider are fetched again [s]."""

PAUSE_S = 30.0


class OpenId:
    """Verifies the tokens of one OpenID provider.

    Raises
    ------
    WrongTokenFileError
        If PyJWT is not installed, or the keys cannot be had from a file.
    """

    def __init__(self, settings: OpenIdSettings, now: Callable[[], float] = time.time) -> None:
        try:
            import jwt
        except ImportError as error:
            raise WrongTokenFileError(
                "Tokens of an OpenID provider need PyJWT. Install it: pip install "
                "'slowtime[openid]'."
            ) from error
        self._jwt, self._settings, self._now = jwt, settings, now
        self._lock = threading.Lock()
        self._keys: dict[str, jwt.PyJWK] = {}
        self._asked_at = -1e18
        self._known: OrderedDict[bytes, tuple[Principal, float]] = OrderedDict()
        if not settings.jwks.startswith("https://"):
            self._ask()

    def verify(self, text: str) -> Principal:
        """Return the principal of a JWT; may wait for the provider, so not for the event loop.

        Raises
        ------
        RefusedTokenError
            If it is not one of this provider for this server, or not valid now.
        """
        digest = hashlib.sha256(text.encode()).digest()
        known = self._known.get(digest)
        if known is not None and self._now() < known[1]:
            return known[0]
        principal = self._verified(text)
        self._known[digest] = (principal, min(principal.until, self._now() + REMEMBERED_S))
        while len(self._known) > REMEMBERED:
            self._known.popitem(last=False)
        return principal

    def _verified(self, text: str) -> Principal:
        settings = self._settings
        try:
            header = self._jwt.get_unverified_header(text)
            claims: dict[str, Any] = self._jwt.decode(
                text,
                self._key(header.get("kid")),
                algorithms=list(settings.algorithms),
                audience=settings.audience,
                issuer=settings.issuer,
                leeway=settings.leeway_s,
                options={"require": ["exp", "iss", "aud", "sub"]},
            )
        except self._jwt.ExpiredSignatureError:
            raise RefusedTokenError("It is expired.") from None
        except self._jwt.PyJWTError as error:
            raise RefusedTokenError(f"It is not valid: {type(error).__name__}.") from None
        return self._principal(claims)

    def _principal(self, claims: dict[str, Any]) -> Principal:
        word, sites = (
            claims.get(self._settings.scope_claim),
            claims.get(self._settings.sites_claim),
        )
        if isinstance(sites, str):
            sites = sites.split()
        if not isinstance(word, str) or not isinstance(sites, list) or not sites:
            raise RefusedTokenError(
                f"It lacks the claims {self._settings.scope_claim} (viewer, operator or admin) "
                f"and {self._settings.sites_claim} (names of sites, or *)."
            )
        try:
            scope = Scope.of(word)
        except ValueError as error:
            raise RefusedTokenError(str(error)) from None
        of = None if "*" in sites else frozenset(str(site) for site in sites)
        until = float(claims["exp"]) + self._settings.leeway_s
        name = f"{str(claims['sub'])[:80]} of {self._settings.issuer}"
        return Principal(name, scope, of, until, lambda: self._now() < until)

    def _key(self, kid: Any) -> "jwt.PyJWK":
        with self._lock:
            age = self._now() - self._asked_at
            if age > KEYS_LAST_S or (str(kid) not in self._keys and age > PAUSE_S):
                self._ask()
            if kid is None and len(self._keys) == 1:
                return next(iter(self._keys.values()))
            if (key := self._keys.get(str(kid))) is None:
                raise RefusedTokenError(
                    "It is signed by a key that its provider does not name."
                )
            return key

    def _ask(self) -> None:
        self._asked_at = self._now()
        try:
            found = self._jwt.PyJWKSet.from_dict(read_json(self._read()))
        except (OSError, ValueError, self._jwt.PyJWTError) as error:
            said = (
                f"The keys of {self._settings.issuer} cannot be had from {self._settings.jwks}"
            )
            if not self._keys and not self._settings.jwks.startswith("https://"):
                raise WrongTokenFileError(f"{said}: {reason_of(error)}") from error
            logger.error("%s: %s Those known before are used.", said, reason_of(error))
            return
        self._keys = {str(key.key_id): key for key in found.keys}

    def _read(self) -> bytes:
        where = self._settings.jwks
        if not where.startswith("https://"):
            with open(where, "rb") as file:
                return file.read(LARGEST)
        return fetch(where, FETCH_S, LARGEST)

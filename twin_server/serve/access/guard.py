"""ASGI middleware that authenticates and authorizes each request before it is read."""

import asyncio
import ipaddress
import logging
import math
import re
import time
from collections.abc import Callable
from http.cookies import CookieError, SimpleCookie
from typing import Any, Self

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from twin_server.identity.principals import EVERYBODY, KEY, NOBODY, Principal
from twin_server.identity.tokens import LONGEST, RefusedTokenError, TokenFile
from twin_server.serve.http.problems import MEDIA_TYPE, problem
from twin_server.settings import TwinSettings

from .openid import OpenId
from .policy import UNKNOWN, Reach, Rule, find
from .rates import Rate

logger = logging.getLogger(__name__)

COOKIE = "slowtime_token"
SAFE = ("GET", "HEAD", "OPTIONS")
HEADERS = [
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"SAMEORIGIN"),
]


class NotSecuredError(ValueError):
    """Settings under which strangers could ask, or listen in."""


class _Refused(Exception):
    def __init__(self, status: int, slug: str, detail: str, **headers: str) -> None:
        super().__init__(detail)
        self.status, self.slug, self.detail, self.headers = status, slug, detail, headers


def check_secured(settings: TwinSettings) -> None:
    """Refuse to listen beyond this machine without encryption and authentication.

    Raises
    ------
    NotSecuredError
        Naming what is missing, and what to do.
    """
    access = settings.access
    if is_loopback(settings.host) or access.published_on_loopback:
        return
    if settings.shards.index is not None and settings.shards.key:
        return  # it answers its front only, which knows the secret
    missing = []
    if settings.tls is None and not access.behind_proxy:
        missing.append(
            "encryption (--tls-certificate with --tls-key, or --behind-proxy where a proxy "
            "before it does that)"
        )
    if not access.required:
        missing.append("authentication (--tokens, made by `slowtime tokens add`, or openid)")
    if missing:
        raise NotSecuredError(
            f"At {settings.host} other machines reach this server, and it has no "
            f"{' and no '.join(missing)}. Give both, or listen at 127.0.0.1."
        )


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address.

    Examples
    --------
    >>> [is_loopback(h) for h in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "", "::", "a.b")]
    [True, True, True, False, False, False, False]
    """
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def guarded(settings: TwinSettings) -> "Guard":
    """Wrap the application in the access control that the settings demand.

    Raises
    ------
    NotSecuredError, WrongTokenFileError
        If the settings do not make one.
    """
    check_secured(settings)
    access = settings.access
    tokens = TokenFile(access.tokens) if access.tokens is not None else None
    if tokens is not None:
        tokens.check()
    if settings.access.published_on_loopback and not is_loopback(settings.host):
        logger.warning(
            "Listening at %s without authentication: this is safe only if the port is "
            "published on loopback alone, as in docker-compose.yml.",
            settings.host,
        )
    return Guard(settings, tokens, OpenId(access.openid) if access.openid else None)


class Guard:
    """ASGI application around another one, which it is given by `around`."""

    def __init__(
        self,
        settings: TwinSettings,
        tokens: TokenFile | None,
        openid: OpenId | None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        access = settings.access
        self._tokens, self._openid = tokens, openid
        self._required = tokens is not None or openid is not None
        self._hosts = {"localhost", *(host.lower() for host in access.hosts)}
        self._rate = Rate(access.requests_per_s, access.burst, now)
        self._failures = Rate(access.failures_per_s, access.failures_burst, now)

    def around(self, app: ASGIApp) -> Self:
        """Stand before `app`."""
        self._app = app
        return self

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a problem document."""
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def careful(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *HEADERS]
            await send(message)

        try:
            scope[KEY] = await self._admitted(scope)
        except _Refused as refused:
            await _answer(refused, scope, careful)
            return
        await self._app(scope, receive, careful)

    async def _admitted(self, scope: Scope) -> Principal:
        headers = _headers(scope)
        if scope["method"] not in SAFE:
            _check_from_here(headers)
        rule, twin_id = find(scope["method"], scope["path"])
        if not self._required:
            self._check_host(headers)
            return EVERYBODY
        address = str((scope.get("client") or ("",))[0])
        if rule.reach is Reach.OPEN:
            self._count(self._rate, f"address {address}")
            return NOBODY
        principal = await self._who(headers, scope, address)
        self._count(self._rate, principal.name)
        _check_may(principal, rule, twin_id)
        return principal

    async def _who(self, headers: dict[str, str], scope: Scope, address: str) -> Principal:
        text, of_cookie = _token(headers)
        if text is None:
            self._count(self._rate, f"address {address}")
            raise _Refused(
                401,
                "no-token",
                "A token is needed. Give it in the header Authorization: Bearer TOKEN. An "
                "admin makes one with `slowtime tokens add`.",
                **{"WWW-Authenticate": 'Bearer realm="slowtime"'},
            )
        if of_cookie and scope["method"] not in SAFE:
            _check_same_site(headers)
        try:
            if len(text) > LONGEST:
                raise RefusedTokenError("It is too long.")
            if self._tokens is not None and (
                self._openid is None or text.startswith("slowtime_")
            ):
                return self._tokens.verify(text)
            assert self._openid is not None
            return await asyncio.to_thread(self._openid.verify, text)
        except RefusedTokenError as error:
            # Counted after the check, so that one caller cannot block others of its address.
            self._count(self._failures, address)
            raise _Refused(
                401,
                "token-refused",
                f"The token is refused. {error} Ask an admin for a new one: `slowtime "
                "tokens add`.",
                **{"WWW-Authenticate": 'Bearer realm="slowtime", error="invalid_token"'},
            ) from None

    def _check_host(self, headers: dict[str, str]) -> None:
        """Refuse a page of elsewhere that had its own name point at this machine."""
        given = headers.get("host", "")
        host = _host(given)
        if host in self._hosts or is_loopback(host):
            return
        raise _Refused(
            421,
            "unknown-host",
            f"{given[:80]!r} was asked for, and a server without tokens answers to its own "
            "machine only, as http://127.0.0.1. Set access.hosts for other names of it, or "
            "access.tokens to know who asks.",
        )

    def _count(self, rate: Rate, caller: str) -> None:
        if wait := rate.wait(caller):
            raise _too_many(wait)


def _too_many(wait: float) -> _Refused:
    return _Refused(
        429,
        "too-many-requests",
        f"Too many requests at once. Wait {math.ceil(wait)} s, and ask less often; the live "
        "stream tells what is new without being asked.",
        **{"Retry-After": str(math.ceil(wait))},
    )


def _check_may(principal: Principal, rule: Rule, twin_id: str | None) -> None:
    if principal.scope < rule.scope:
        what = "what no rule is for" if rule is UNKNOWN else "this"
        raise _Refused(
            403,
            "scope-too-small",
            f"The token's scope is {principal.scope.word}, and {what} wants {rule.scope.word}. "
            "Ask an admin for a token that may.",
        )
    everywhere = principal.sites is None
    there = twin_id is not None and principal.sees(twin_id)
    if (rule.reach is Reach.ALL and not everywhere) or (rule.reach is Reach.TWIN and not there):
        sites = ", ".join(sorted(principal.sites or ())) or "no site"
        raise _Refused(
            403,
            "site-out-of-reach",
            f"The token reaches {sites[:200]}, and this is about "
            f"{'all sites' if rule.reach is Reach.ALL else 'another site'}. Ask an admin for a "
            "token that does.",
        )


def _check_same_site(headers: dict[str, str]) -> None:
    """Refuse requests with a cookie that another site's page made a browser send."""
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    same = origin is not None and origin.partition("://")[2] == headers.get("host")
    if site not in ("same-origin", "none") and not (site is None and same):
        raise _Refused(
            403,
            "from-another-page",
            "A cookie is good for this server's own page only. Give the token in the header "
            "Authorization: Bearer TOKEN.",
        )


def _check_from_here(headers: dict[str, str]) -> None:
    """Refuse requests that another site's page made a browser send, with a token or without.

    A browser says from where a request comes (``Sec-Fetch-Site``, ``Origin``), and no page can
    keep it from that; programs say neither.
    """
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    given = None
    if site is not None and site.strip().lower() not in ("same-origin", "same-site", "none"):
        given = f"Sec-Fetch-Site: {site[:80]!r}"
    elif (
        site is None
        and origin is not None
        and _host(origin.partition("://")[2]) != _host(headers.get("host", ""))
    ):
        given = f"Origin: {origin[:80]!r}"
    if given is not None:
        raise _Refused(
            403,
            "from-another-site",
            f"A request that changes something came from a page of another site ({given}). "
            "Allowed: this server's own page, and programs, which give neither Origin nor "
            "Sec-Fetch-Site. Ask from there.",
        )


def _host(authority: str) -> str:
    """Return the host of an authority, without its port.

    Examples
    --------
    >>> [_host(a) for a in ("127.0.0.1:8000", "[::1]:8000", "Tower.example", "")]
    ['127.0.0.1', '::1', 'tower.example', '']
    """
    return re.sub(r":\d*$", "", authority).strip("[]").lower()


def _headers(scope: Scope) -> dict[str, str]:
    return {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}


def _token(headers: dict[str, str]) -> tuple[str | None, bool]:
    """Find the token of a request, and whether it came in a cookie."""
    kind, _, text = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer" and text.strip():
        return text.strip(), False
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return None, False
    return (cookie.value, True) if cookie is not None and cookie.value else (None, False)


async def _answer(refused: _Refused, scope: Scope, send: Send) -> None:
    _, body = problem(refused.status, refused.slug, refused.detail, scope["path"][:300])
    headers: list[Any] = [
        (b"content-type", MEDIA_TYPE.encode()),
        (b"content-length", str(len(body)).encode()),
        (b"cache-control", b"no-store"),
        *((name.lower().encode(), value.encode()) for name, value in refused.headers.items()),
    ]
    await send({"type": "http.response.start", "status": refused.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})

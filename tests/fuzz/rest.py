"""Requests that the OpenAPI document allows, and that it does not: never our fault."""

import asyncio
import warnings
from collections import Counter
from typing import Any
from urllib.parse import quote

import httpx
from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings
from hypothesis import strategies as st


def requests(document: dict[str, Any]) -> "st.SearchStrategy[Any]":
    """Requests of any operation, made by schemathesis, half of them against the document."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import schemathesis
        from schemathesis import GenerationMode

        schema = schemathesis.openapi.from_dict(document)
        operations: list[Any] = [found.ok() for found in schema.get_all_operations()]  # type: ignore[union-attr]
    return st.one_of(
        *(o.as_strategy(generation_mode=GenerationMode.POSITIVE) for o in operations),
        *(o.as_strategy(generation_mode=GenerationMode.NEGATIVE) for o in operations),
    )


def run(
    guard: Any, document: dict[str, Any], cases: int, number: int, headers: dict[str, str]
) -> Counter[str]:
    """Send `cases` requests; how many answers of each status. Fails on any of 5xx."""
    counts: Counter[str] = Counter()
    loop = asyncio.new_event_loop()
    client = httpx.AsyncClient(
        transport=httpx.ASGITransport(guard, raise_app_exceptions=False),
        base_url="http://127.0.0.1",
    )

    @seed(number)
    @settings(
        max_examples=cases,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
    )
    @given(requests(document))
    def send(case: Any) -> None:
        found = _request(case, headers)
        if found is None:
            counts["not HTTP"] += 1
            return
        answer = loop.run_until_complete(client.send(client.build_request(**found)))
        counts[f"{answer.status_code // 100}xx"] += 1
        assert answer.status_code < 500, (found, answer.text[:500])
        if answer.status_code >= 400:
            assert answer.headers["content-type"] == "application/problem+json", found

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            send()
        finally:
            loop.run_until_complete(client.aclose())
            loop.close()
    return counts


def _request(case: Any, headers: dict[str, str]) -> dict[str, Any] | None:
    """What httpx sends for a case; None where no client could."""
    path = case.path
    for name, value in (case.path_parameters or {}).items():
        if name == "twin_id" and len(str(value)) % 2:  # else hardly any is about one there is
            value = "lab.beam-1"
        path = path.replace(f"{{{name}}}", quote(str(value), safe=""))
    given_headers = {str(name): str(value) for name, value in (case.headers or {}).items()}
    body = case.body
    more: dict[str, Any] = {}
    if type(body).__name__ != "NotSet" and body is not None:
        more = {"content": body} if isinstance(body, bytes) else {"json": body}
    try:
        query = {str(k): v for k, v in (case.query or {}).items()}
        found = {
            "method": str(case.method),
            "url": path,
            "params": query,
            "headers": {**given_headers, **headers},
            **more,
        }
        httpx.Request(**{**found, "url": f"http://127.0.0.1{path}"})
    except (UnicodeError, ValueError, TypeError, httpx.InvalidURL):
        return None
    return found

"""Reports a trace span for each HTTP request."""

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from slowtime_services.tracing import SpanTraces

from .access.policy import find


class Traced:
    """ASGI application around another one that reports a trace span for each answer."""

    def __init__(self, app: ASGIApp, traces: SpanTraces) -> None:
        self._app, self._traces = app, traces

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, within a span; a stream has none, for it has no end."""
        rule, twin_id = find(scope.get("method", ""), scope.get("path", ""))
        if scope["type"] != "http" or rule.path.endswith("/live"):
            await self._app(scope, receive, send)
            return
        headers = {k.decode("latin-1"): v.decode("latin-1") for k, v in scope["headers"]}
        with self._traces.answering(scope["method"], rule.path, twin_id, headers) as span:

            async def telling(message: Message) -> None:
                if message["type"] == "http.response.start":
                    span.set_attribute("http.response.status_code", message["status"])
                await send(message)

            await self._app(scope, receive, telling)

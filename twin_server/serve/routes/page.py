"""Routes of the page, of its assets and of the messages of its languages."""

import gzip
import hashlib
import json
import mimetypes
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import plotly
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from slowtime_services.reports import VIEWER
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.web_bundle import bundled

WEB = Path(__file__).parents[1] / "web"
MESSAGES = WEB / "messages"
NAME = "page.own_name"
"""Message of each catalogue that gives the language's own name."""
PLOTLY = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"
FIRST = "app.js"
"""The module that the page begins with."""
FOR_GOOD = "public, max-age=31536000, immutable"
"""For what another name is given to as soon as it changes."""
A_DAY = "public, max-age=86400"
ASKED_ANEW = "no-cache"
"""May be kept, but is asked for each time: the answer is short if nothing has changed."""


@dataclass(frozen=True)
class PageFile:
    """A file of the page, held in memory as it is and packed once it has been asked for.

    Parameters
    ----------
    name
        Its file name, which tells its type.
    source
        Its bytes, or the file with them.
    caching
        How long browsers may keep it.
    """

    name: str
    source: bytes | Path
    caching: str = ASKED_ANEW

    @cached_property
    def content(self) -> bytes:
        """As it is."""
        return self.source.read_bytes() if isinstance(self.source, Path) else self.source

    @cached_property
    def packed(self) -> bytes:
        """By gzip, which every browser reads."""
        return gzip.compress(self.content, mtime=0)

    @cached_property
    def tag(self) -> str:
        """A name of this content."""
        return f'"{hashlib.sha256(self.content).hexdigest()[:24]}"'

    def answer(self, request: Request) -> Response:
        """Give it, packed where the browser reads that, or say that it has not changed."""
        kind = mimetypes.guess_type(self.name)[0] or "application/octet-stream"
        headers = {"Cache-Control": self.caching, "ETag": self.tag, "Vary": "Accept-Encoding"}
        if request.headers.get("if-none-match") == self.tag:
            return Response(status_code=304, headers=headers)
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(self.content, headers=headers, media_type=kind)
        headers["Content-Encoding"] = "gzip"
        return Response(self.packed, headers=headers, media_type=kind)


def languages_of(folder: Path) -> dict[str, str]:
    """Read the tag of each catalogue of messages in `folder` → the language's own name."""
    paths = sorted(folder.glob("*.json"))
    return {path.stem: json.loads(path.read_text(encoding="utf-8"))[NAME] for path in paths}


def assets_of_page() -> dict[str, PageFile]:
    """Read the page and all that it needs; its modules also as one script."""
    paths = [*(path for path in WEB.iterdir() if path.is_file()), VIEWER]
    found = {path.name: PageFile(path.name, path) for path in paths}
    modules = {name: one.content.decode() for name, one in found.items() if name[-3:] == ".js"}
    script = bundled(modules, FIRST)
    found[script.name] = PageFile(script.name, script.text.encode(), FOR_GOOD)
    index = (
        found["index.html"]
        .content.decode()
        .replace(f"/assets/{FIRST}", f"/assets/{script.name}")
    )
    found["index.html"] = PageFile("index.html", index.encode())
    found[PLOTLY.name] = PageFile(PLOTLY.name, PLOTLY, A_DAY)
    return found


def routes() -> APIRouter:
    """Make the routes of the page and of its assets."""
    api = APIRouter(include_in_schema=False)
    files = assets_of_page()
    languages = json.dumps(languages_of(MESSAGES), ensure_ascii=False).encode()
    messages = {path.name: PageFile(path.name, path) for path in MESSAGES.glob("*.json")}
    messages["languages.json"] = PageFile("languages.json", languages)

    @api.get("/")
    def index(request: Request) -> Response:
        return files["index.html"].answer(request)

    @api.get("/assets/messages/{name}")
    def message(name: str, request: Request) -> Response:
        return _found(messages, name, "/assets/messages/").answer(request)

    @api.get("/assets/{name}")
    def asset(name: str, request: Request) -> Response:
        return _found(files, name, "/assets/").answer(request)

    return api


def _found(assets: dict[str, PageFile], name: str, folder: str) -> PageFile:
    if name not in assets:
        raise ProblemError(
            404,
            "no-such-address",
            f"{folder}{name:.80} was asked for. Allowed: {', '.join(sorted(assets))}.",
        )
    return assets[name]

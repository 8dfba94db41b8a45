"""Routes of the page, of its assets and of the messages of its languages."""

import json
from pathlib import Path

import plotly
from fastapi import APIRouter
from starlette.responses import FileResponse, JSONResponse

from slowtime_services.reports import VIEWER
from twin_server.serve.http.problems import ProblemError

WEB = Path(__file__).parents[1] / "web"
MESSAGES = WEB / "messages"
NAME = "page.own_name"
"""Message of each catalogue that gives the language's own name."""
PLOTLY = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"


def languages_of(folder: Path) -> dict[str, str]:
    """Read the tag of each catalogue of messages in `folder` → the language's own name."""
    paths = sorted(folder.glob("*.json"))
    return {path.stem: json.loads(path.read_text(encoding="utf-8"))[NAME] for path in paths}


def routes() -> APIRouter:
    """Make the routes of the page and of its assets."""
    api = APIRouter(include_in_schema=False)
    files = {path.name: path for path in WEB.iterdir() if path.is_file()}
    catalogues = {path.name: path for path in MESSAGES.glob("*.json")}
    languages = languages_of(MESSAGES)
    files |= {path.name: path for path in (PLOTLY, VIEWER)}

    @api.get("/")
    def index() -> FileResponse:
        return FileResponse(files["index.html"], headers={"Cache-Control": "no-cache"})

    @api.get("/assets/messages/languages.json")
    def offered() -> JSONResponse:
        return JSONResponse(languages, headers={"Cache-Control": "no-cache"})

    @api.get("/assets/messages/{name}")
    def messages(name: str) -> FileResponse:
        if name not in catalogues:
            raise ProblemError(
                404,
                "no-such-address",
                f"/assets/messages/{name:.80} was asked for. Allowed: "
                f"{', '.join(sorted(catalogues))}.",
            )
        return FileResponse(catalogues[name], headers={"Cache-Control": "no-cache"})

    @api.get("/assets/{name}")
    def asset(name: str) -> FileResponse:
        if name not in files:
            raise ProblemError(
                404,
                "no-such-address",
                f"/assets/{name:.80} was asked for. Allowed: {', '.join(sorted(files))}.",
            )
        lasting = name == PLOTLY.name
        caching = "public, max-age=86400" if lasting else "no-cache"
        return FileResponse(files[name], headers={"Cache-Control": caching})

    return api

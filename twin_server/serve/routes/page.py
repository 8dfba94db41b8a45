"""Routes of the page and of its assets."""

from pathlib import Path

import plotly
from fastapi import APIRouter
from starlette.responses import FileResponse

from slowtime_services.reports import VIEWER
from twin_server.serve.http.problems import ProblemError

WEB = Path(__file__).parents[1] / "web"
PLOTLY = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"


def routes() -> APIRouter:
    """Make the routes of the page and of its assets."""
    api = APIRouter(include_in_schema=False)
    files = {path.name: path for path in WEB.iterdir()}
    files |= {path.name: path for path in (PLOTLY, VIEWER)}

    @api.get("/")
    def index() -> FileResponse:
        return FileResponse(files["index.html"], headers={"Cache-Control": "no-cache"})

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

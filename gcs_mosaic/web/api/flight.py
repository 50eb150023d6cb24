"""Of the flight as a whole."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from aiohttp import web

from gcs_mosaic.web.api.common import BASE, VIEW, answer, in_thread


def add_routes(app: web.Application) -> None:
    app.router.add_get(BASE, about)


async def about(request: web.Request) -> web.StreamResponse:
    """GET: the API's version, the program's, and what the flight has come to."""
    table = await in_thread(request, request.app[VIEW].table)
    return answer({"api": 1, "program": _program(), "revision": table.revision, "frames": len(table.frames)})


def _program() -> str:
    try:
        return version("gcs-mosaic")
    except PackageNotFoundError:  # from a folder that was never installed
        return "unknown"

"""Of the flight as a whole."""

from __future__ import annotations

import json
import logging
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.api.common import BASE, VIEW, answer, in_thread
from gcs_mosaic.web.api.notes import told_anew

logger = logging.getLogger(__name__)

DESCRIPTIONS = Path(__file__).parent / "openapi"


def add_routes(app: web.Application) -> None:
    app.router.add_get(BASE, about)
    app.router.add_get(f"{BASE}/absent", absent)
    app.router.add_get(f"{BASE}/openapi.json", description)


async def about(request: web.Request) -> web.StreamResponse:
    """GET: the API's version, the program's, and what the flight has come to."""
    table = await in_thread(request, request.app[VIEW].table)
    return answer({"api": 1, "program": _program(), "revision": table.revision, "frames": len(table.frames)})


async def absent(request: web.Request) -> web.StreamResponse:
    """GET: shots that are not on the map, why, and where they should be."""
    try:
        shots = await in_thread(request, _absent, request.app[VIEW])
    except UsageError:
        logger.info("no ledger can be read", exc_info=True)
        shots = []
    return told_anew(request, {"absent": shots})


async def description(request: web.Request) -> web.StreamResponse:
    """GET: this API, as OpenAPI 3.1."""
    return told_anew(request, await in_thread(request, openapi))


def openapi() -> dict[str, Any]:
    """The files beside this one, as one document."""
    document: dict[str, Any] = {
        "openapi": "3.1.0",
        "info": {"title": "gcs-mosaic", "version": "1", "description": "Canvas places are those of an island."},
        "servers": [{"url": BASE}],
        "paths": {},
        "components": {"schemas": {}},
    }
    for path in sorted(DESCRIPTIONS.glob("*.json")):
        part = json.loads(path.read_text("utf-8"))
        document["paths"] |= part["paths"]
        document["components"]["schemas"] |= part.get("components", {}).get("schemas", {})
    return document


def _absent(view: FlightView) -> list[dict[str, Any]]:
    """Raises UsageError."""
    from gcs_mosaic.views.absent import absent_shots  # it loads what paints, which a page that nobody asks does without

    return [
        {
            "name": one.name.encode("utf-8", "replace").decode(),
            "state": one.state,
            "reason": one.reason,
            "island": one.island,
            "place": None if one.place is None else [round(value, 1) for value in one.place],
        }
        for one in absent_shots(view)
    ]


def _program() -> str:
    try:
        return version("gcs-mosaic")
    except PackageNotFoundError:  # from a folder that was never installed
        return "unknown"

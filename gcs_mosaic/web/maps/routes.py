"""All of the map's routes."""

from __future__ import annotations

from aiohttp import web

from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.access import MAPS
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.api.notes import NOTES
from gcs_mosaic.web.api.operations import add_operations
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.maps import atak, kml, qgis, wms, wmts, xyz
from gcs_mosaic.web.maps.common import ADDRESS, CORS, MAP
from gcs_mosaic.web.maps.served_map import ServedMap
from gcs_mosaic.web.maps.underlay import underlay_of
from gcs_mosaic.web.settings import WebSettings

PROTOCOLS = (xyz, wms, wmts, atak, kml, qgis)  # modules with OPERATIONS


def add_maps(app: web.Application, view: FlightView, feed: Feed, settings: WebSettings, address: HttpAddress) -> None:
    """Show the flight on other maps; after `add_api`, whose notes hold the anchors. Raises UsageError."""
    app[MAP] = ServedMap(view, app[NOTES], feed, underlay_of(settings.underlay))
    app[ADDRESS], app[CORS] = address, settings.cors
    feed.before_telling(app[MAP].forget)
    app.on_cleanup.append(_end)
    if settings.cors:
        app.on_response_prepare.append(let_other_sites_read)
    wms.keep_turns(app)
    for protocol in PROTOCOLS:
        add_operations(app, protocol.OPERATIONS)


async def let_other_sites_read(request: web.Request, response: web.StreamResponse) -> None:
    """Signal handler: pages of other sites may use the map, and nothing else."""
    if request.path.startswith(MAPS):
        response.headers["Access-Control-Allow-Origin"] = "*"
        response.headers["Cross-Origin-Resource-Policy"] = "cross-origin"


async def _end(app: web.Application) -> None:
    app[MAP].close()

"""For ATAK and WinTAK: a map source in MOBAC's XML, which they show as an overlay, and a data package with it and the finds."""

from __future__ import annotations

import io
import uuid
import zipfile
from collections.abc import Sequence
from xml.sax.saxutils import escape, quoteattr

from aiohttp import web

from gcs_mosaic.geotiles.pyramid import OVERZOOM
from gcs_mosaic.notes.anchors.anchoring import geo_place
from gcs_mosaic.notes.finds.exports import as_kml
from gcs_mosaic.notes.finds.finds import Find, placed
from gcs_mosaic.notes.ground.binding import GroundFollower, GroundPlace
from gcs_mosaic.notes.ground.places import GeoPlace
from gcs_mosaic.web.api.notes import NOTES
from gcs_mosaic.web.api.operations import Media, Reply
from gcs_mosaic.web.maps.addresses import MOBAC_NAME, MapAddresses, addresses_for
from gcs_mosaic.web.maps.common import (
    MAP,
    LookQuery,
    MapOperations,
    document,
    map_now,
)
from gcs_mosaic.web.maps.served_map import MapNow

REFRESH_MS = (
    5000  # ATAK takes `tileUpdate` as an interval in milliseconds since 4.4; WinTAK and older ones do not look at it
)
MOST_LEVELS = (0, 22)  # without an anchor
OURS = uuid.UUID("6c1b8f0e-5f0b-4c39-9a53-8a5a0f7f5c11")  # of names of flights
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # of files in the package, so that it differs only where they do


OPERATIONS = MapOperations()


@OPERATIONS.of_map(f"{MOBAC_NAME}", Reply("The document.", Media(("application/xml",)), tagged=True), query=LookQuery)
async def source(request: web.Request) -> web.StreamResponse:
    """A map source for ATAK and WinTAK (MOBAC's XML), under a name that ATAK takes for an overlay's."""
    now = await map_now(request)
    text = mobac(now, addresses_for(request, now.flight))
    return document(request, text, "application/xml", MOBAC_NAME)


@OPERATIONS.of_map("gcs-mosaic.zip", Reply("The package.", Media(("application/zip",))))
async def package(request: web.Request) -> web.StreamResponse:
    """A data package for ATAK: the map source and the finds, where the map shows them."""
    now, notes = await map_now(request), request.app[NOTES]
    finds = await notes.run(notes.finds.all)
    addresses = addresses_for(request, now.flight)
    data = await request.app[MAP].work(lambda: data_package(now, addresses, finds_kml(now, finds, notes.follower)))
    headers = {"Content-Disposition": f'attachment; filename="{now.flight}.zip"'}
    return web.Response(body=data, content_type="application/zip", headers=headers)


def mobac(now: MapNow, addresses: MapAddresses) -> str:
    """A custom map source; its name tells the flight, since devices keep tiles by it."""
    coarsest, finest = now.pyramid.levels or MOST_LEVELS
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<customMapSource>\n'
        f"  <name>gcs-mosaic {escape(now.flight)}</name>\n"
        f"  <minZoom>{coarsest}</minZoom>\n  <maxZoom>{min(finest + OVERZOOM, MOST_LEVELS[1])}</maxZoom>\n"
        f"  <tileType>png</tileType>\n  <tileUpdate>{REFRESH_MS}</tileUpdate>\n"
        f"  <url>{escape(addresses.mobac_tiles)}</url>\n"
        "  <backgroundColor>#00000000</backgroundColor>\n</customMapSource>\n"
    )


def finds_kml(now: MapNow, finds: Sequence[Find], follower: GroundFollower) -> str:
    """The finds by the anchors that are shown, so that they lie on the map as it is there."""
    anchors = {one.id: one.anchor for one in now.pyramid.islands}

    def shown(place: GroundPlace) -> GeoPlace | None:
        anchor = anchors.get(place.island)
        return None if anchor is None else geo_place(anchor, place.x, place.y)

    return as_kml(placed(finds, follower, shown), now.title)


def data_package(now: MapNow, addresses: MapAddresses, finds: str) -> bytes:
    """A zip file with the finds and the map source. The same flight has the same `uid`, so that a newer one replaces it."""
    contents = {"finds.kml": finds, MOBAC_NAME: mobac(now, addresses)}
    parameters = {
        "uid": str(uuid.uuid5(OURS, now.flight)),
        "name": f"gcs-mosaic {now.flight}",
        "onReceiveImport": "true",
    }
    manifest = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<MissionPackageManifest version="2">\n<Configuration>'
        + "".join(f"<Parameter name={quoteattr(name)} value={quoteattr(value)}/>" for name, value in parameters.items())
        + "</Configuration>\n<Contents>"
        + "".join(f'<Content ignore="false" zipEntry={quoteattr(name)}/>' for name in contents)
        + "</Contents>\n</MissionPackageManifest>\n"
    )
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {"MANIFEST/manifest.xml": manifest, **contents}.items():
            archive.writestr(zipfile.ZipInfo(name, LONG_AGO), text, zipfile.ZIP_DEFLATED)
    return packed.getvalue()

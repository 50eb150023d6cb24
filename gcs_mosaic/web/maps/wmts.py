"""WMTS 1.0.0, by key-value pairs and by RESTful addresses: the XYZ tiles under the standard's names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated
from xml.sax.saxutils import escape, quoteattr

from aiohttp import web

from gcs_mosaic.geo.mercator import HALF_WORLD_M, resolution_m
from gcs_mosaic.geotiles.pyramid import OVERZOOM
from gcs_mosaic.web.api.operations import Media, Reply
from gcs_mosaic.web.maps.addresses import WMS_LAYER, MapAddresses, addresses_for
from gcs_mosaic.web.maps.common import (
    NOTHING,
    PICTURES,
    LookQuery,
    MapOperations,
    about,
    document,
    look_of,
    map_now,
    tile_of,
)
from gcs_mosaic.web.maps.pictures import MEDIA_TYPES
from gcs_mosaic.web.maps.served_map import MapNow
from gcs_mosaic.web.maps.wms_request import FORMATS, lower_names

XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
OWS = "http://www.opengis.net/ows/1.1"
SPACES = f'xmlns="http://www.opengis.net/wmts/1.0" xmlns:ows="{OWS}" xmlns:xlink="http://www.w3.org/1999/xlink"'
MATRICES = "GoogleMapsCompatible"
PIXEL_M = 0.00028  # of the standard's screen
LEVELS = 25  # matrices that are told
DOCUMENT = Media(("application/xml",))
REPORT = Reply("An ExceptionReport.", DOCUMENT)
OPERATIONS = MapOperations()


@dataclass(frozen=True, slots=True, kw_only=True)
class WmtsQuery(LookQuery):
    """As the standard has it."""

    Request: Annotated[str | None, "GetCapabilities or GetTile; GoogleMapsCompatible"] = None


@OPERATIONS.of_map("wmts/1.0.0/WMTSCapabilities.xml", Reply("The document.", DOCUMENT, tagged=True), query=LookQuery)
async def by_address(request: web.Request) -> web.StreamResponse:
    """WMTS 1.0.0 by addresses: the capabilities."""
    now = await map_now(request)
    return document(request, capabilities(now, addresses_for(request, now.flight)), "application/xml")


@OPERATIONS.of_map(
    "wmts",
    Reply("Capabilities or a tile.", Media((*PICTURES.types, *DOCUMENT.types)), tagged=True),
    query=WmtsQuery,
    failures={**NOTHING, 400: REPORT, 501: REPORT},
)
async def by_pairs(request: web.Request) -> web.StreamResponse:
    """WMTS 1.0.0 by key-value pairs: GetCapabilities and GetTile; what cannot be answered is told as an ExceptionReport."""
    now = await map_now(request)
    asked = lower_names(request.query)
    wanted = asked.get("request", "").lower()
    if wanted == "getcapabilities":
        return document(request, capabilities(now, addresses_for(request, now.flight)), "application/xml")
    if wanted != "gettile":
        return fault("OperationNotSupported", "request", "GetCapabilities and GetTile are what can be asked for.")
    if asked.get("layer", WMS_LAYER) != WMS_LAYER:
        return fault("InvalidParameterValue", "layer", f"There is one layer: {WMS_LAYER}.")
    if asked.get("tilematrixset", MATRICES) != MATRICES:
        return fault("InvalidParameterValue", "tilematrixset", f"There is one set of matrices: {MATRICES}.")
    suffix = FORMATS.get(asked.get("format", "image/png").lower())
    if suffix is None:
        return fault("InvalidParameterValue", "format", f"format is to be one of {', '.join(FORMATS)}.")
    place = [whole(asked.get(name, "")) for name in ("tilematrix", "tilecol", "tilerow")]
    level, column, row = place
    if level is None or column is None or row is None:
        return fault("MissingParameterValue", "tilematrix", "tilematrix, tilecol and tilerow are to be whole numbers.")
    if level >= LEVELS or max(column, row) >= 1 << level:
        return fault("TileOutOfRange", "tilerow", "There is no such tile.")
    return await tile_of(request, level, column, row, look_of(request, suffix))


def whole(text: str) -> int | None:
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 9 else None


def fault(code: str, locator: str, said: str) -> web.Response:
    """As the standard has it, with its status."""
    text = (
        f'{XML}<ows:ExceptionReport xmlns:ows="{OWS}" version="1.1.0"><ows:Exception exceptionCode="{code}" '
        f'locator="{locator}"><ows:ExceptionText>{escape(said)}</ows:ExceptionText></ows:Exception></ows:ExceptionReport>\n'
    )
    status = 501 if code == "OperationNotSupported" else 400
    return web.Response(status=status, text=text, content_type="application/xml")


def capabilities(now: MapNow, addresses: MapAddresses) -> str:
    """The service, its layer and the matrices."""
    pairs = addresses.of("wmts")
    pairs = f"{pairs}&" if "?" in pairs else f"{pairs}?"
    operations = "".join(
        f'<ows:Operation name="{name}"><ows:DCP><ows:HTTP><ows:Get xlink:href={quoteattr(pairs)}>'
        '<ows:Constraint name="GetEncoding"><ows:AllowedValues><ows:Value>KVP</ows:Value></ows:AllowedValues>'
        "</ows:Constraint></ows:Get></ows:HTTP></ows:DCP></ows:Operation>"
        for name in ("GetCapabilities", "GetTile")
    )
    return (
        f'{XML}<Capabilities {SPACES} version="1.0.0"><ows:ServiceIdentification><ows:Title>gcs-mosaic: '
        f"{escape(now.title)}</ows:Title><ows:Abstract>{escape(about(now))}</ows:Abstract>"
        "<ows:ServiceType>OGC WMTS</ows:ServiceType><ows:ServiceTypeVersion>1.0.0</ows:ServiceTypeVersion>"
        f"</ows:ServiceIdentification><ows:OperationsMetadata>{operations}</ows:OperationsMetadata>"
        f"<Contents>{_layer(now, addresses)}{_matrices()}</Contents>"
        f"<ServiceMetadataURL xlink:href={quoteattr(addresses.wmts)}/></Capabilities>\n"
    )


def _layer(now: MapNow, addresses: MapAddresses) -> str:
    bounds = now.pyramid.bounds
    box = ""
    if bounds is not None:
        west, south, east, north = bounds
        corners = f"<ows:LowerCorner>{west!r} {south!r}</ows:LowerCorner><ows:UpperCorner>{east!r} {north!r}</ows:UpperCorner>"
        box = f"<ows:WGS84BoundingBox>{corners}</ows:WGS84BoundingBox>"
    resources = "".join(
        f'<ResourceURL format="{MEDIA_TYPES[suffix]}" resourceType="tile" template='
        f"{quoteattr(addresses.of('{TileMatrix}/{TileCol}/{TileRow}.' + suffix))}/>"
        for suffix in MEDIA_TYPES
    )
    formats = "".join(f"<Format>{kind}</Format>" for kind in MEDIA_TYPES.values())
    return (
        f"<Layer><ows:Title>{escape(now.title)}</ows:Title><ows:Abstract>{escape(about(now))}</ows:Abstract>{box}"
        f'<ows:Identifier>{WMS_LAYER}</ows:Identifier><Style isDefault="true"><ows:Identifier>default</ows:Identifier></Style>'
        f"{formats}<TileMatrixSetLink><TileMatrixSet>{MATRICES}</TileMatrixSet>{_limits(now)}</TileMatrixSetLink>{resources}</Layer>"
    )


def _limits(now: MapNow) -> str:
    """Which tiles of each matrix may show something."""
    levels = now.pyramid.levels
    if levels is None:
        return ""
    told = []
    for level in range(levels[0], min(levels[1] + OVERZOOM, LEVELS - 1) + 1):
        columns, rows = zip(*now.pyramid.corner_tiles(level), strict=True)
        told.append(
            f"<TileMatrixLimits><TileMatrix>{level}</TileMatrix><MinTileRow>{min(rows)}</MinTileRow>"
            f"<MaxTileRow>{max(rows)}</MaxTileRow><MinTileCol>{min(columns)}</MinTileCol>"
            f"<MaxTileCol>{max(columns)}</MaxTileCol></TileMatrixLimits>"
        )
    return f"<TileMatrixSetLimits>{''.join(told)}</TileMatrixSetLimits>"


def _matrices() -> str:
    matrices = "".join(
        f"<TileMatrix><ows:Identifier>{level}</ows:Identifier>"
        f"<ScaleDenominator>{resolution_m(level) / PIXEL_M!r}</ScaleDenominator>"
        f"<TopLeftCorner>{-HALF_WORLD_M!r} {HALF_WORLD_M!r}</TopLeftCorner><TileWidth>256</TileWidth>"
        f"<TileHeight>256</TileHeight><MatrixWidth>{1 << level}</MatrixWidth>"
        f"<MatrixHeight>{1 << level}</MatrixHeight></TileMatrix>"
        for level in range(LEVELS)
    )
    return (
        f"<TileMatrixSet><ows:Identifier>{MATRICES}</ows:Identifier>"
        "<ows:SupportedCRS>urn:ogc:def:crs:EPSG::3857</ows:SupportedCRS>"
        f"<WellKnownScaleSet>urn:ogc:def:wkss:OGC:1.0:{MATRICES}</WellKnownScaleSet>{matrices}</TileMatrixSet>"
    )

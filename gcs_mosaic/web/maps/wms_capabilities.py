"""What a WMS says of itself, and of what it refuses. Without a DOCTYPE, which programs would look for on the internet."""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

from gcs_mosaic.geotiles.earth_islands import Bounds
from gcs_mosaic.web.maps.addresses import WMS_LAYER, MapAddresses
from gcs_mosaic.web.maps.common import about
from gcs_mosaic.web.maps.served_map import MapNow
from gcs_mosaic.web.maps.wms_request import DEGREES, MERCATOR, TOLD_SIDE, Version, WmsFault

XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
XLINK = 'xmlns:xlink="http://www.w3.org/1999/xlink"'
MEDIA = {"1.1.1": "application/vnd.ogc.wms_xml", "1.3.0": "text/xml"}
FAULTS = {"1.1.1": "application/vnd.ogc.se_xml", "1.3.0": "text/xml"}
PICTURES = "<Format>image/png</Format><Format>image/jpeg</Format><Format>image/webp</Format>"


def capabilities(now: MapNow, addresses: MapAddresses, version: Version) -> tuple[str, str]:
    """The document and its media type."""
    return (_of_1_1_1 if version == "1.1.1" else _of_1_3_0)(now, addresses), MEDIA[version]


def fault_document(fault: WmsFault) -> tuple[str, str]:
    """The document and its media type."""
    code = "" if fault.code is None else f" code={quoteattr(fault.code)}"
    space = ' xmlns="http://www.opengis.net/ogc"' if fault.version == "1.3.0" else ""
    text = (
        f'{XML}<ServiceExceptionReport version="{fault.version}"{space}>'
        f"<ServiceException{code}>{escape(fault.said)}</ServiceException></ServiceExceptionReport>\n"
    )
    return text, FAULTS[fault.version]


def _of_1_1_1(now: MapNow, addresses: MapAddresses) -> str:
    bounds = now.pyramid.bounds
    return (
        f'{XML}<WMT_MS_Capabilities version="1.1.1"><Service><Name>OGC:WMS</Name>{_service(now, addresses)}</Service>'
        f"<Capability><Request>{_requests(addresses, '1.1.1')}</Request>"
        f"<Exception><Format>{FAULTS['1.1.1']}</Format></Exception>"
        f'<Layer queryable="0" opaque="0">{_layer_head(now)}{_systems("SRS")}'
        f"{'' if bounds is None else _latitudes_1_1_1(bounds)}{_boxes(now, 'SRS')}</Layer>"
        "</Capability></WMT_MS_Capabilities>\n"
    )


def _of_1_3_0(now: MapNow, addresses: MapAddresses) -> str:
    bounds = now.pyramid.bounds
    limits = f"<LayerLimit>1</LayerLimit><MaxWidth>{TOLD_SIDE}</MaxWidth><MaxHeight>{TOLD_SIDE}</MaxHeight>"
    return (
        f'{XML}<WMS_Capabilities version="1.3.0" xmlns="http://www.opengis.net/wms" {XLINK}>'
        f"<Service><Name>WMS</Name>{_service(now, addresses)}{limits}</Service>"
        f"<Capability><Request>{_requests(addresses, '1.3.0')}</Request><Exception><Format>XML</Format></Exception>"
        f'<Layer queryable="0" opaque="0">{_layer_head(now)}{_systems("CRS")}'
        f"{'' if bounds is None else _latitudes_1_3_0(bounds)}{_boxes(now, 'CRS')}</Layer>"
        "</Capability></WMS_Capabilities>\n"
    )


def _service(now: MapNow, addresses: MapAddresses) -> str:
    return (
        f"<Title>gcs-mosaic: {escape(now.title)}</Title><Abstract>{escape(about(now))}</Abstract>{_resource(addresses)}"
    )


def _layer_head(now: MapNow) -> str:
    return f"<Name>{WMS_LAYER}</Name><Title>{escape(now.title)}</Title><Abstract>{escape(about(now))}</Abstract>"


def _requests(addresses: MapAddresses, version: Version) -> str:
    way = f"<DCPType><HTTP><Get>{_resource(addresses)}</Get></HTTP></DCPType>"
    about_itself = f"<GetCapabilities><Format>{MEDIA[version]}</Format>{way}</GetCapabilities>"
    return f"{about_itself}<GetMap>{PICTURES}{way}</GetMap>"


def _resource(addresses: MapAddresses) -> str:
    """What parameters are added to."""
    base = addresses.wms
    whole = f"{base}&" if "?" in base else f"{base}?"
    return f'<OnlineResource {XLINK} xlink:type="simple" xlink:href={quoteattr(whole)}/>'


def _systems(element: str) -> str:
    names = (*MERCATOR[:1], *DEGREES) if element == "CRS" else (MERCATOR[0], DEGREES[0])
    return "".join(f"<{element}>{name}</{element}>" for name in names)


def _latitudes_1_1_1(bounds: Bounds) -> str:
    west, south, east, north = bounds
    return f'<LatLonBoundingBox minx="{west!r}" miny="{south!r}" maxx="{east!r}" maxy="{north!r}"/>'


def _latitudes_1_3_0(bounds: Bounds) -> str:
    west, south, east, north = (max(min(edge, 180.0), -180.0) for edge in bounds)
    return (
        f"<EX_GeographicBoundingBox><westBoundLongitude>{west!r}</westBoundLongitude>"
        f"<eastBoundLongitude>{east!r}</eastBoundLongitude><southBoundLatitude>{south!r}</southBoundLatitude>"
        f"<northBoundLatitude>{north!r}</northBoundLatitude></EX_GeographicBoundingBox>"
    )


def _boxes(now: MapNow, system: str) -> str:
    """The bounds in each reference system; of EPSG:4326 latitudes come first in 1.3.0."""
    degrees, metres = now.pyramid.bounds, now.pyramid.mercator_bounds
    if degrees is None or metres is None:
        return ""
    west, south, east, north = degrees
    turned = (south, west, north, east) if system == "CRS" else degrees
    boxes = {MERCATOR[0]: metres, DEGREES[0]: turned} | ({DEGREES[1]: degrees} if system == "CRS" else {})
    return "".join(
        f'<BoundingBox {system}="{name}" minx="{box[0]!r}" miny="{box[1]!r}" maxx="{box[2]!r}" maxy="{box[3]!r}"/>'
        for name, box in boxes.items()
    )

"""A QGIS project with the map: as XYZ tiles, as WMS, and its extent."""

from __future__ import annotations

from urllib.parse import quote
from xml.sax.saxutils import escape, quoteattr

from aiohttp import web

from gcs_mosaic.geo.mercator import HALF_WORLD_M
from gcs_mosaic.web.api.operations import Media, Reply
from gcs_mosaic.web.maps.addresses import WMS_LAYER, MapAddresses, addresses_for
from gcs_mosaic.web.maps.common import MapOperations, about, document, map_now
from gcs_mosaic.web.maps.served_map import MapNow

REFRESH_MS = 5000
VERSION = "3.22.0"  # of the project; newer ones take it over
SYSTEM = (
    "<spatialrefsys><authid>EPSG:3857</authid><srsid>3857</srsid><srid>3857</srid>"
    "<description>WGS 84 / Pseudo-Mercator</description></spatialrefsys>"
)
IN_ONE_SYSTEM = (  # or the project's own is not read
    '<properties><SpatialRefSys><ProjectionsEnabled type="int">1</ProjectionsEnabled></SpatialRefSys></properties>'
)
WHOLE = (-HALF_WORLD_M, -HALF_WORLD_M, HALF_WORLD_M, HALF_WORLD_M)


OPERATIONS = MapOperations()


@OPERATIONS.of_map("gcs-mosaic.qgs", Reply("The document.", Media(("application/x-qgis-project",)), tagged=True))
async def project(request: web.Request) -> web.StreamResponse:
    """A project for QGIS."""
    now = await map_now(request)
    text = as_project(now, addresses_for(request, now.flight))
    return document(request, text, "application/x-qgis-project", "gcs-mosaic.qgs")


def as_project(now: MapNow, addresses: MapAddresses) -> str:
    """The XML of a .qgs file. The WMS layer is there but not shown: it is the same picture, for prints.

    QGIS takes names of layers of more than ten letters only, and gives others new ones, which the tree does not know.
    """
    layers = (
        ("gcs_mosaic_xyz", f"{now.title} (XYZ)", _xyz(now, addresses), True),
        ("gcs_mosaic_wms", f"{now.title} (WMS)", _wms(addresses), False),
    )
    tree = "".join(
        f'<layer-tree-layer id="{id_}" name={quoteattr(name)} providerKey="wms" source={quoteattr(source)} '
        f'checked="{"Qt::Checked" if is_shown else "Qt::Unchecked"}" expanded="0"/>'
        for id_, name, source, is_shown in layers
    )
    told = "".join(_layer(id_, name, source) for id_, name, source, _ in layers)
    return (
        "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
        f'<qgis version="{VERSION}" projectname={quoteattr(now.title)}><title>{escape(now.title)}</title>'
        f"{IN_ONE_SYSTEM}<projectCrs>{SYSTEM}</projectCrs><layer-tree-group>{tree}</layer-tree-group>"
        f'<mapcanvas name="theMapCanvas"><units>meters</units>{_extent(now)}<destinationsrs>{SYSTEM}</destinationsrs></mapcanvas>'
        f"<projectlayers>{told}</projectlayers><projectMetadata><abstract>{escape(about(now))}</abstract></projectMetadata>"
        "</qgis>\n"
    )


def _xyz(now: MapNow, addresses: MapAddresses) -> str:
    """In QGIS's words; the address is quoted but for what stands in for numbers.

    From level 0 on: of a view coarser than the first level QGIS asks for all tiles of that level, a million for a continent.
    """
    _, finest = now.pyramid.levels or (0, 22)
    return f"type=xyz&zmin=0&zmax={finest}&url={quote(addresses.xyz, safe='')}&crs=EPSG:3857"


def _wms(addresses: MapAddresses) -> str:
    where = quote(addresses.wms, safe="")
    return f"contextualWMSLegend=0&crs=EPSG:3857&dpiMode=7&format=image/png&layers={WMS_LAYER}&styles&url={where}"


def _layer(id_: str, name: str, source: str) -> str:
    refresh = f'autoRefreshEnabled="1" autoRefreshMode="ReloadData" autoRefreshTime="{REFRESH_MS}"'
    return (
        f'<maplayer type="raster" {refresh}><id>{id_}</id><datasource>{escape(source)}</datasource>'
        f"<layername>{escape(name)}</layername><srs>{SYSTEM}</srs><provider>wms</provider></maplayer>"
    )


def _extent(now: MapNow) -> str:
    west, south, east, north = now.pyramid.mercator_bounds or WHOLE
    return f"<extent><xmin>{west!r}</xmin><ymin>{south!r}</ymin><xmax>{east!r}</xmax><ymax>{north!r}</ymax></extent>"

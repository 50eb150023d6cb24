"""Addresses of the map for other programs: whole ones, and with the token where they need it."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import quote, urlencode

from aiohttp import web

from gcs_mosaic.web.access import MAPS
from gcs_mosaic.web.address import split_host, url_of
from gcs_mosaic.web.choosing import ACCESS

WMS_LAYER = "mosaic"
MOBAC_NAME = "grg_gcs-mosaic.xml"  # ATAK takes a source of this name as an overlay that can be switched
ATAK_IMPORT = "tak://com.atakmap.app/import?url="


@dataclass(frozen=True, slots=True)
class MapAddresses:
    """`root`: of the server, http://HOST:PORT/; `token`: None where none is needed. `underlay`: with the team's map below."""

    root: str
    flight: str
    token: str | None = None
    underlay: bool = False

    def of(self, path: str, **query: str) -> str:
        """The address of something of the map; names in braces stay as they are."""
        asked = query | ({"token": self.token} if self.token else {}) | ({"underlay": "1"} if self.underlay else {})
        address = f"{self.root}{MAPS.lstrip('/')}{self.flight}/{path}"
        return f"{address}?{urlencode(asked)}" if asked else address

    @property
    def xyz(self) -> str:
        return self.of("{z}/{x}/{y}.png")

    @property
    def mobac_tiles(self) -> str:
        """As MOBAC writes them."""
        return self.of("{$z}/{$x}/{$y}.png")

    @property
    def wms(self) -> str:
        return self.of("wms")

    @property
    def wmts(self) -> str:
        return self.of("wmts/1.0.0/WMTSCapabilities.xml")

    @property
    def tilejson(self) -> str:
        return self.of("tilejson.json")

    @property
    def kml(self) -> str:
        return self.of("map.kml")

    @property
    def mobac(self) -> str:
        return self.of(MOBAC_NAME)

    @property
    def atak_import(self) -> str:
        """Opened or scanned on a device with ATAK, it asks and takes over the map."""
        return ATAK_IMPORT + quote(self.mobac, safe="")

    @property
    def data_package(self) -> str:
        return self.of("gcs-mosaic.zip")

    @property
    def qgis(self) -> str:
        return self.of("gcs-mosaic.qgs")


def addresses_for(request: web.Request, flight: str) -> MapAddresses:
    """As whoever asks has reached this server, with the token if its own address had it."""
    host, port = split_host(request.host) or ("", None)
    fallback = 443 if request.secure else 80
    access = request.app[ACCESS]
    return MapAddresses(
        root=url_of(host, port or fallback, secure=request.secure),
        flight=flight,
        token=access.token if "token" in request.query else None,
        underlay=request.query.get("underlay") == "1",
    )

"""How other programs get to show the map: their addresses, and as codes to scan."""

from __future__ import annotations

import io
import ipaddress
from dataclasses import replace
from typing import Any, Literal

from aiohttp import web

from gcs_mosaic.geo.mercator import FINEST_LEVEL
from gcs_mosaic.web.address import HttpAddress, is_number, split_host, url_of
from gcs_mosaic.web.api.common import BASE, in_thread, missing
from gcs_mosaic.web.api.notes import told_anew
from gcs_mosaic.web.choosing import ACCESS
from gcs_mosaic.web.invitation import invitation
from gcs_mosaic.web.maps.addresses import MapAddresses
from gcs_mosaic.web.maps.common import ADDRESS, CORS, MAP, TILE
from gcs_mosaic.web.maps.pictures import MapLook, encoded
from gcs_mosaic.web.maps.served_map import MapNow
from gcs_mosaic.web.maps.underlay import Underlay
from gcs_mosaic.web.tile_answer import tile_answer

NAMES = ("xyz", "wms", "wmts", "tilejson", "kml", "mobac", "atak_import", "data_package", "qgis")
BASE_MAPS = ("xyz", "wms")  # of programs that show no other map beside it
Reach = Literal["network", "loopback", "nowhere"]


def add_routes(app: web.Application) -> None:
    app.router.add_get(f"{BASE}/maps", maps)
    app.router.add_get(f"{BASE}/maps/codes/{{name:[a-z_]{{1,20}}}}.svg", code)
    app.router.add_get(f"{BASE}/underlay/{TILE}", underlay_tile)


async def maps(request: web.Request) -> web.StreamResponse:
    """GET: whether others can reach the map, its addresses for them, and what is shown."""
    now = await request.app[MAP].now()
    reach, addresses = await in_thread(request, reached, request, now)
    underlay = request.app[MAP].underlay
    over = replace(addresses, underlay=True) if underlay is not None else None
    return told_anew(
        request,
        {
            "flight": now.flight,
            "revision": now.token,
            "reach": reach,
            "needs_token": addresses.token is not None,
            "is_local": is_refused_by_qgroundcontrol(addresses.root),
            "cors": request.app[CORS],
            "addresses": {name: getattr(addresses, name) for name in NAMES},
            "over_underlay": over and {name: getattr(over, name) for name in BASE_MAPS},
            "underlay": underlay and await in_thread(request, where_it_lies, underlay),
            **shown(now),
        },
    )


async def code(request: web.Request) -> web.StreamResponse:
    """GET: one of the addresses as a QR code (SVG)."""
    name = request.match_info["name"]
    if name not in NAMES:
        raise missing(f"There are codes of {', '.join(NAMES)}.")
    _, addresses = await in_thread(request, reached, request, await request.app[MAP].now())
    drawn = await in_thread(request, as_svg, getattr(addresses, name))
    return web.Response(text=drawn, content_type="image/svg+xml")


async def underlay_tile(request: web.Request) -> web.StreamResponse:
    """GET: a tile of the team's own map alone; transparent where it has none."""
    served = request.app[MAP]
    if served.underlay is None:
        raise missing("The settings name no map: web: {underlay: FILE}.")
    level, x, y = (int(request.match_info[name]) for name in ("z", "x", "y"))
    if level > FINEST_LEVEL or max(x, y) >= 1 << level:
        raise missing("There is no such tile.")
    data = await served.work(jpeg_of, served.underlay, level, x, y)
    return tile_answer(request, data, "image/jpeg")


def jpeg_of(underlay: Underlay, level: int, x: int, y: int) -> bytes | None:
    """A tile of it."""
    picture = underlay.tile(level, x, y)
    return None if picture is None else encoded(picture, MapLook("jpg")).data


def where_it_lies(underlay: Underlay) -> dict[str, Any] | None:
    """Its bounds and levels, if they can be told."""
    found = underlay.extent
    return None if found is None else {"bounds": list(found.bounds), "minzoom": found.minzoom, "maxzoom": found.maxzoom}


def reached(request: web.Request, now: MapNow) -> tuple[Reach, MapAddresses]:
    """Where others find the map: as whoever asks has found it, if that is over the network, else as this machine is found."""
    access, address = request.app[ACCESS], request.app[ADDRESS]
    host, port = split_host(request.host) or ("127.0.0.1", None)
    port = port or (443 if request.secure else 80)
    here = MapAddresses(url_of(host, port, secure=request.secure), now.flight, access.token)
    if not HttpAddress(host, port).is_loopback:
        return "network", here
    invited = invitation(address, port, access, secure=request.secure)
    if invited is not None and invited.pages:
        return "network", replace(here, root=invited.pages[0])
    return "loopback" if invited is None else "nowhere", replace(here, token=None)


def is_refused_by_qgroundcontrol(root: str) -> bool:
    """Whether it is an address of this machine alone, or of a network without a router."""
    host = (split_host(root.partition("://")[2].rstrip("/")) or ("", None))[0]
    if not is_number(host):
        return host == "localhost"
    number = ipaddress.ip_address(host)
    return number.is_loopback or number.is_link_local


def shown(now: MapNow) -> dict[str, Any]:
    """The islands that are shown, and those that are not."""
    islands = [
        {"island": one.id, "error_m": one.error_m, "minzoom": one.levels[0], "maxzoom": one.levels[1]}
        for one in now.pyramid.islands
    ]
    bounds = now.pyramid.bounds
    return {
        "islands": islands,
        "unanchored": list(now.unanchored),
        "error_m": now.error_m,
        "bounds": None if bounds is None else list(bounds),
    }


def as_svg(text: str) -> str:
    """A QR code, dark on light with its quiet border."""
    import segno  # only where it is shown

    drawn = io.BytesIO()
    segno.make(text, error="l", micro=False).save(drawn, kind="svg", scale=4, border=4, light="#fff", xmldecl=False)
    return drawn.getvalue().decode()

"""How other programs get to show the map: their addresses, and as codes to scan."""

from __future__ import annotations

import io
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from aiohttp import web

from gcs_mosaic.geo.mercator import FINEST_LEVEL
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.web.address import HttpAddress, is_number, split_host, url_of
from gcs_mosaic.web.api.common import BASE, in_thread, missing, told_anew
from gcs_mosaic.web.api.operations import Media, Operations, Reply
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


OPERATIONS = Operations()
Bounds = Annotated[tuple[float, float, float, float], "west, south, east, north, in degrees"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnderlayAnswer:
    """Where the map lies that the settings name as underlay."""

    bounds: Annotated[Bounds, "west, south, east, north, in degrees, of what there is at its finest level"]
    minzoom: int
    maxzoom: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownIsland:
    """An island that other programs show."""

    island: int
    error_m: Annotated[float, "how far off its worst corner may be (95 %)"]
    minzoom: int
    maxzoom: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MapsForOthersAnswer:
    """How other programs show the map."""

    flight: Annotated[str, "its name in addresses"]
    revision: Annotated[str, "another one whenever something looks different"]
    reach: Annotated[
        Reach,
        "who can reach the addresses: others on the network; this machine alone; this machine, because it is on no network",
    ]
    needs_token: bool
    is_local: Annotated[
        bool, "QGroundControl refuses addresses of this machine alone, and of networks without a router"
    ]
    cors: Annotated[bool, "whether pages of other sites may show the map"]
    addresses: Annotated[dict[str, str], f"by {', '.join(NAMES)}"]
    over_underlay: Annotated[dict[str, str] | None, "those of base maps, if the settings name an underlay"]
    underlay: Annotated[UnderlayAnswer | None, "if the settings name one, and it can be told where it lies"]
    islands: Sequence[ShownIsland]
    unanchored: Annotated[Sequence[int], "islands that are shown nowhere else"]
    error_m: Annotated[float | None, "how far off the worst corner of what is shown may be (95 %)"]
    bounds: Bounds | None


@OPERATIONS.add(
    "GET",
    f"{BASE}/maps",
    Reply("The map for other programs.", MapsForOthersAnswer, tagged=True),
    failures={503: "The notes, which hold the anchors, cannot be read now."},
)
async def maps(request: web.Request) -> web.StreamResponse:
    """How other programs show the map: whether they can reach it, addresses, and what is shown."""
    now, served = await request.app[MAP].now(), request.app[MAP]
    reach, addresses = await in_thread(request, reached, request, now)
    over = replace(addresses, underlay=True) if served.underlay is not None else None
    told = MapsForOthersAnswer(
        flight=now.flight,
        revision=now.token,
        reach=reach,
        needs_token=addresses.token is not None,
        is_local=is_refused_by_qgroundcontrol(addresses.root),
        cors=request.app[CORS],
        addresses={name: getattr(addresses, name) for name in NAMES},
        over_underlay=None if over is None else {name: getattr(over, name) for name in BASE_MAPS},
        underlay=await in_thread(request, where_it_lies, served.underlay),
        islands=[shown(one) for one in now.pyramid.islands],
        unanchored=now.unanchored,
        error_m=now.error_m,
        bounds=now.pyramid.bounds,
    )
    return told_anew(request, told)


@OPERATIONS.add(
    "GET",
    f"{BASE}/maps/codes/{{name:[a-z_]{{1,20}}}}.svg",
    Reply("The code.", Media(("image/svg+xml",))),
    about={"name": "One of the names of `addresses`."},
    failures={404: "There is no such address.", 503: "The notes, which hold the anchors, cannot be read now."},
)
async def code(request: web.Request) -> web.StreamResponse:
    """An address as a QR code."""
    name = request.match_info["name"]
    if name not in NAMES:
        raise missing(f"There are codes of {', '.join(NAMES)}.")
    _, addresses = await in_thread(request, reached, request, await request.app[MAP].now())
    drawn = await in_thread(request, as_svg, getattr(addresses, name))
    return web.Response(text=drawn, content_type="image/svg+xml")


@OPERATIONS.add(
    "GET",
    f"{BASE}/underlay/{TILE}",
    Reply("The tile.", Media(("image/jpeg", "image/png")), tagged=True),
    failures={404: "The settings name no underlay, or nothing of that number."},
)
async def underlay_tile(request: web.Request) -> web.StreamResponse:
    """An XYZ tile of 256 px (EPSG:3857) of the map that the settings name as underlay, alone; transparent where it has none."""
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


def where_it_lies(underlay: Underlay | None) -> UnderlayAnswer | None:
    """Its bounds and levels, if there is one and they can be told."""
    found = None if underlay is None else underlay.extent
    if found is None:
        return None
    return UnderlayAnswer(bounds=found.bounds, minzoom=found.minzoom, maxzoom=found.maxzoom)


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


def shown(one: EarthIsland) -> ShownIsland:
    """An island with how exactly it lies."""
    return ShownIsland(island=one.id, error_m=one.error_m, minzoom=one.levels[0], maxzoom=one.levels[1])


def as_svg(text: str) -> str:
    """A QR code, dark on light with its quiet border."""
    import segno  # only where it is shown

    drawn = io.BytesIO()
    segno.make(text, error="l", micro=False).save(drawn, kind="svg", scale=4, border=4, light="#fff", xmldecl=False)
    return drawn.getvalue().decode()

"""WMS as Mission Planner and QGIS ask, in their own words and order; and what is refused in the protocol's way."""

from __future__ import annotations

import asyncio
import contextlib
import math
from urllib.parse import quote
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from gcs_mosaic.geo.mercator import mercator
from gcs_mosaic.geotiles.picture_grid import PictureGrid
from gcs_mosaic.stitch.arrays import AnyImage
from gcs_mosaic.web.maps import wms as module
from gcs_mosaic.web.maps.wms_request import MOST_PIXELS, TOLD_SIDE, MapRequest, WmsFault, map_request
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight, laid_at, picture_of
from tests.web.test_notes_api import Writer

WMS = f"/maps/{FLIGHT}/wms"
# As Mission Planner's WMSProvider.cs and FlightPlanner.cs put them together.
MP_TILE = (
    "VERSION=1.1.1&REQUEST=GetMap&SERVICE=WMS{layers}&styles=&bbox={box}"
    "&width=256&height=256&srs=EPSG:4326&format=image/png"
)
MP_CAPABILITIES = "version=1.1.0&Request=GetCapabilities&service=WMS"
MP = {"User-Agent": "MissionPlanner", "Accept": "*/*", "Accept-Encoding": "gzip, deflate"}
QGIS = (
    "SERVICE=WMS&VERSION=1.3.0&REQUEST=GetMap&BBOX={box}&CRS={crs}&WIDTH={width}&HEIGHT={height}&LAYERS=mosaic&STYLES="
    "&FORMAT=image/png&DPI=96&MAP_RESOLUTION=96&FORMAT_OPTIONS=dpi:96&TRANSPARENT=TRUE"
)
SPACE = "{http://www.opengis.net/wms}"
OGC = "{http://www.opengis.net/ogc}"


def gmap_box(level: int, x: int, y: int) -> str:
    """As GMap.NET's Mercator tells a tile's corners, in .NET's shortest digits."""

    def corner(column: float, row: float) -> tuple[float, float]:
        size = 256 << level
        longitude = 360 * (column / size - 0.5)
        return longitude, 90 - 360 * math.atan(math.exp(-(0.5 - row / size) * 2 * math.pi)) / math.pi

    (west, south), (east, north) = corner(x * 256, (y + 1) * 256), corner((x + 1) * 256, y * 256)
    return ",".join(repr(value) for value in (west, south, east, north))


def fault_of(data: bytes) -> tuple[str | None, str]:
    report = ElementTree.fromstring(data)
    assert report.tag in ("ServiceExceptionReport", f"{OGC}ServiceExceptionReport")
    (told,) = list(report)
    return told.get("code"), told.text or ""


def seen(client: Writer, query: str) -> AnyImage:
    answer, data = client.ask(f"{WMS}?{query}")
    assert (answer.status, answer.headers["Content-Type"]) == (200, "image/png"), data
    return picture_of(data)


@pytest.mark.long
@pytest.mark.parametrize("layers", ["", "&layers=mosaic"])
def test_mission_planner_gets_the_tile_that_it_shows(pinned: Writer, flight: AnchoredFlight, layers: str) -> None:
    for level in range(flight.laid.levels[1] - 4, min(flight.laid.levels[1] + 2, 22) + 1):
        place = laid_at(flight.laid, level, 50.0, 80.0)
        asked = MP_TILE.format(layers=layers, box=gmap_box(level, *place))
        answer, data = pinned.ask(f"{WMS}?{asked}", **{**MP, "Host": pinned.netloc})
        assert (answer.status, answer.headers["Content-Type"]) == (200, "image/png")
        tile = picture_of(pinned.ask(f"/maps/{FLIGHT}/{level}/{place[0]}/{place[1]}.png")[1])
        shown = picture_of(data)
        assert shown[..., 3].min() == 255  # opaque where it does not say TRANSPARENT
        is_there = tile[..., 3] == 255
        assert (shown[is_there] == tile[is_there]).all()
        assert (shown[tile[..., 3] == 0] == 255).all()


def test_mission_planner_understands_what_the_service_says_of_itself(pinned: Writer) -> None:
    """It wants this root without a namespace, one GetMap, PNG and EPSG:4326; a DOCTYPE would send it to the internet."""
    answer, data = pinned.ask(f"{WMS}?{MP_CAPABILITIES}", **{**MP, "Host": pinned.netloc})
    assert (answer.status, b"<!DOCTYPE" in data) == (200, False)
    root = ElementTree.fromstring(data)
    assert (root.tag, root.get("version")) == ("WMT_MS_Capabilities", "1.1.1")
    (get_map,) = root.findall(".//GetMap")
    assert "image/png" in [one.text for one in get_map.findall("Format")]
    assert "EPSG:4326" in [one.text for one in root.findall(".//SRS")]
    # One layer and none within it: then it asks nobody which.
    assert [one.text for one in root.findall(".//Layer/Name")] == ["mosaic"]
    assert root.findall(".//Layer/Layer") == []


def test_qgis_gets_each_reference_system_with_its_order_of_axes(pinned: Writer, flight: AnchoredFlight) -> None:
    west, south, east, north = flight.laid.bounds
    (left, bottom), (right, top) = (mercator(np.array(one)).tolist() for one in ((west, south), (east, north)))
    boxes = {
        "CRS:84": (west, south, east, north),
        "EPSG:4326": (south, west, north, east),
        "EPSG:3857": (left, bottom, right, top),
    }
    for crs, box in boxes.items():
        query = QGIS.format(box=",".join(map(repr, box)), crs=quote(crs), width=401, height=303)
        shown = seen(pinned, query)
        assert shown.shape == (303, 401, 4)
        plane = "mercator" if crs == "EPSG:3857" else "degrees"
        bounds = boxes["EPSG:3857"] if plane == "mercator" else boxes["CRS:84"]
        grid = PictureGrid("mercator" if plane == "mercator" else "degrees", bounds, 401, 303)
        places = grid.places(np.arange(401.0) + 0.5, np.arange(303.0) + 0.5)
        truth = flight.colour_at(places[..., 0], places[..., 1])
        inside = shown[..., 3] == 255
        assert 0.2 < inside.mean() < 0.9  # a turned rectangle in its bounds
        assert np.abs(shown[..., :3].astype(float) - truth)[inside].mean() < 1.5


def test_older_words_for_the_same(pinned: Writer, flight: AnchoredFlight) -> None:
    west, south, east, north = flight.laid.bounds
    box = f"{west},{south},{east},{north}"
    common = f"width=300&height=200&bbox={box}&transparent=true&format=image%2Fpng"
    one = seen(pinned, f"service=WMS&version=1.1.1&request=GetMap&layers=mosaic&styles=&srs=EPSG:4326&{common}")
    other = seen(pinned, f"REQUEST=map&WMTVER=1.0.0&SRS=epsg:4326&{common}")
    assert (one == other).all()


def test_a_service_of_1_3_0_says_what_qgis_reads(pinned: Writer, flight: AnchoredFlight) -> None:
    for query in ("SERVICE=WMS&REQUEST=GetCapabilities", "service=WMS&request=GetCapabilities&version=1.3.0"):
        root = ElementTree.fromstring(pinned.ask(f"{WMS}?{query}")[1])
        assert (root.tag, root.get("version")) == (f"{SPACE}WMS_Capabilities", "1.3.0")
    systems = [one.text for one in root.iter(f"{SPACE}CRS")]
    assert systems == ["EPSG:3857", "EPSG:4326", "CRS:84"]
    boxes = {
        one.get("CRS"): [float(one.get(edge) or 0) for edge in ("minx", "miny")]
        for one in root.iter(f"{SPACE}BoundingBox")
    }
    west, south, _, _ = flight.laid.bounds
    assert boxes["EPSG:4326"] == pytest.approx([south, west], abs=1e-6)
    assert boxes["CRS:84"] == pytest.approx([west, south], abs=1e-6)
    where = root.find(f".//{SPACE}GetMap//{SPACE}OnlineResource")
    assert where is not None
    assert where.get("{http://www.w3.org/1999/xlink}href") == f"http://{pinned.netloc}{WMS}?"
    assert [one.text for one in root.iter(f"{SPACE}MaxWidth")] == [str(TOLD_SIDE)]


def test_without_an_anchor_there_is_a_layer_without_bounds_that_says_how_to_set_one(client: Writer) -> None:
    for query in (MP_CAPABILITIES, "REQUEST=GetCapabilities"):
        text = client.ask(f"{WMS}?{query}")[1].decode()
        assert "BoundingBox" not in text
        assert "Set two pins on the page" in text
        assert "<Name>mosaic</Name>" in text
    shown = seen(client, QGIS.format(box="6.9,44.4,7.1,44.6", crs="CRS:84", width=300, height=300))
    assert not shown.any()


def test_a_colour_behind_the_map_and_other_formats(pinned: Writer, flight: AnchoredFlight) -> None:
    west, south, east, north = flight.laid.bounds
    head = f"VERSION=1.1.1&REQUEST=GetMap&SRS=EPSG:4326&BBOX={west},{south},{east},{north}&WIDTH=300&HEIGHT=200"
    shown = seen(pinned, f"{head}&FORMAT=image/png&BGCOLOR=0x102030")
    assert shown[0, 0].tolist() == [0x30, 0x20, 0x10, 255]
    answer, data = pinned.ask(f"{WMS}?{head}&FORMAT=image/jpeg&TRANSPARENT=TRUE")
    assert answer.headers["Content-Type"] == "image/jpeg"
    assert picture_of(data)[0, 0].min() > 250
    assert pinned.ask(f"{WMS}?{head}&FORMAT=image/webp")[0].headers["Content-Type"] == "image/webp"
    etag = pinned.ask(f"{WMS}?{head}")[0].headers["ETag"]
    assert pinned.status(f"{WMS}?{head}", **{"If-None-Match": etag}) == 304


GOOD = {
    "VERSION": "1.1.1",
    "REQUEST": "GetMap",
    "LAYERS": "mosaic",
    "SRS": "EPSG:4326",
    "BBOX": "6.9,44.4,7.1,44.6",
    "WIDTH": "300",
    "HEIGHT": "300",
    "FORMAT": "image/png",
}
GOOD_IN_LOWER = {name.lower(): value for name, value in GOOD.items()}
BAD = [
    ({"LAYERS": "roads"}, "LayerNotDefined"),
    ({"LAYERS": "mosaic,roads"}, "LayerNotDefined"),
    ({"STYLES": "night"}, "StyleNotDefined"),
    ({"SRS": "EPSG:31467"}, "InvalidSRS"),
    ({"SRS": ""}, "InvalidSRS"),
    ({"FORMAT": "image/tiff"}, "InvalidFormat"),
    ({"REQUEST": "GetFeatureInfo"}, "OperationNotSupported"),
    ({"REQUEST": ""}, "OperationNotSupported"),
    ({"WIDTH": "0"}, None),
    ({"WIDTH": "4097"}, None),
    ({"WIDTH": "4096", "HEIGHT": "4096"}, None),
    ({"WIDTH": "4096", "HEIGHT": "2049"}, None),
    ({"HEIGHT": "99999999999999999999"}, None),
    ({"HEIGHT": "-3"}, None),
    ({"HEIGHT": "٣"}, None),
    ({"WIDTH": "3e2"}, None),
    ({"BBOX": "7.1,44.4,6.9,44.6"}, None),
    ({"BBOX": "6.9,44.6,7.1,44.4"}, None),
    ({"BBOX": "6.9,44.4,6.9,44.6"}, None),
    ({"BBOX": "6.9,44.4,7.1"}, None),
    ({"BBOX": "nan,44.4,7.1,44.6"}, None),
    ({"BBOX": "-1e300,-1e300,1e300,1e300"}, None),
    ({"BBOX": "somewhere"}, None),
    ({"BBOX": "0,0,1e-320,1e-320"}, None),
    ({"BBOX": "7,44.5,7.0000000000000009,44.500000000000007", "HEIGHT": "4096"}, None),
    ({"BBOX": "999999999,0,999999999.0000001,1"}, None),
    ({"BGCOLOR": "red"}, None),
]


@pytest.mark.parametrize(("change", "code"), BAD, ids=str)
def test_what_cannot_be_answered_is_refused_as_the_protocol_does(
    pinned: Writer, change: dict[str, str], code: str | None
) -> None:
    asked = {**GOOD, **change}
    query = "&".join(f"{name}={quote(value)}" for name, value in asked.items())
    answer, data = pinned.ask(f"{WMS}?{query}")
    assert (answer.status, answer.headers.get_content_type()) == (200, "application/vnd.ogc.se_xml")
    found, said = fault_of(data)
    assert (found, said[-1]) == (code, ".")
    newer = "&".join(
        f"{'CRS' if name == 'SRS' else name}={quote(value)}" for name, value in {**asked, "VERSION": "1.3.0"}.items()
    )
    answer, data = pinned.ask(f"{WMS}?{newer}")
    if "BBOX" not in change or change["BBOX"].count(",") != 3:  # the other order of axes
        assert answer.headers.get_content_type() == "text/xml"
        assert fault_of(data)[0] == (code if code != "InvalidSRS" else "InvalidCRS")


def test_boxes_of_the_whole_world_and_of_a_grain_of_sand_cost_little(pinned: Writer, flight: AnchoredFlight) -> None:
    west, south, _, _ = flight.laid.bounds
    for box in (
        "-180,-90,180,90",
        "-1e9,-1e9,1e9,1e9",
        f"{west},{south},{west + 1e-9},{south + 1e-9}",
        f"{west},-80,{west + 1e-7},80",
        f"-180,{south},180,{south + 1e-7}",
    ):
        query = "&".join(f"{name}={quote(value)}" for name, value in {**GOOD, "BBOX": box}.items())
        answer, _ = pinned.ask(f"{WMS}?{query}")
        assert answer.headers["Content-Type"] == "image/png"


@pytest.mark.long
def test_a_large_picture_is_the_same_as_its_parts(pinned: Writer, flight: AnchoredFlight) -> None:
    west, south, east, north = flight.laid.bounds
    (left, bottom), (right, top) = (mercator(np.array(one)).tolist() for one in ((west, south), (east, north)))
    whole = seen(pinned, QGIS.format(box=f"{left},{bottom},{right},{top}", crs="EPSG:3857", width=1400, height=1100))
    middle = (left + right) / 2
    half = seen(pinned, QGIS.format(box=f"{left},{bottom},{middle},{top}", crs="EPSG:3857", width=700, height=1100))
    off = np.abs(whole[:, :700].astype(int) - half)
    assert off.max() <= 3
    assert off.mean() < 0.02
    small = cv2.resize(whole, (350, 275), interpolation=cv2.INTER_AREA)
    assert small[..., 3].max() == 255


def test_a_picture_of_a_large_screen_is_given_but_none_that_takes_too_long(
    pinned: Writer, flight: AnchoredFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of 4096 x 4096 took 28 s, and any number of them could be asked for."""
    assert MOST_PIXELS > 3840 * 2160
    box = ",".join(map(str, flight.laid.bounds))
    query = "&".join(f"{name}={value}" for name, value in {**GOOD, "BBOX": box, "WIDTH": "1200"}.items())
    assert seen(pinned, query).shape[:2] == (300, 1200)
    monkeypatch.setattr(module, "LONGEST_S", -1.0)
    assert "takes more than" in fault_of(pinned.ask(f"{WMS}?{query}")[1])[1]


def test_few_wait_for_a_large_picture_and_small_ones_for_nobody() -> None:
    async def asked() -> None:
        large = module.LargePictures()
        many, few = (map_request({**GOOD_IN_LOWER, "width": side, "height": side}) for side in ("2000", "1000"))
        async with contextlib.AsyncExitStack() as making:
            await making.enter_async_context(large.turn(many))
            waiting = [asyncio.create_task(enter(large, many)) for _ in range(module.MOST_WAITING - 1)]
            await asyncio.sleep(0)
            with pytest.raises(WmsFault, match="being made"):
                await enter(large, many)
            await enter(large, few)
        await asyncio.gather(*waiting)
        assert large.waiting == 0

    async def enter(large: module.LargePictures, one: MapRequest) -> None:
        async with large.turn(one):
            pass

    asyncio.run(asked())


def test_a_box_near_a_tile_s_is_no_tile() -> None:
    tile = module.corners_in_plane(PictureGrid("degrees", (0, 0, 1, 1), 256, 256), 19, 270000, 180000)
    grid = PictureGrid("degrees", tile, 256, 256)
    assert module.tile_in(grid) == (19, 270000, 180000)
    west, south, east, north = tile
    off = (east - west) * 0.01
    assert module.tile_in(PictureGrid("degrees", (west + off, south, east + off, north), 256, 256)) is None
    assert module.tile_in(PictureGrid("degrees", tile, 256, 255)) is None
    assert module.tile_in(PictureGrid("degrees", (-180, -90, 180, 90), 256, 256)) is None
    corners = module.corners_in_plane(PictureGrid("mercator", (0, 0, 1, 1), 256, 256), 5, 31, 3)
    assert module.tile_in(PictureGrid("mercator", corners, 256, 256)) == (5, 31, 3)

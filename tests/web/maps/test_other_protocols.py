"""WMTS, the map source and the data package for ATAK, the tree for Google Earth, the project for QGIS."""

from __future__ import annotations

import io
import json
import re
import time
import zipfile
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import numpy as np
import pytest

from gcs_mosaic.geotiles.pyramid import GeoPyramid
from gcs_mosaic.web.maps.addresses import ATAK_IMPORT, MapAddresses
from gcs_mosaic.web.maps.kml import as_start
from gcs_mosaic.web.maps.served_map import MapNow
from gcs_mosaic.web.maps.wmts import OWS
from tests.geotiles.ground import anchor, island
from tests.sure import sure
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight, laid_at, picture_of
from tests.web.test_notes_api import Writer

BASE = f"/maps/{FLIGHT}"
WMTS = "{http://www.opengis.net/wmts/1.0}"
KML = "{http://www.opengis.net/kml/2.2}"


def xml_of(client: Writer, path: str) -> ElementTree.Element:
    answer, data = client.ask(path)
    assert answer.status == 200, data
    return ElementTree.fromstring(data)


def path_of(address: str | None) -> str:
    """What is asked of this server."""
    parts = urlsplit(address or "")
    return f"{parts.path}?{parts.query}" if parts.query else parts.path


def test_wmts_tiles_by_pairs_and_by_address_are_the_xyz_tiles(pinned: Writer, flight: AnchoredFlight) -> None:
    level = flight.laid.levels[1]
    column, row = laid_at(flight.laid, level)
    tile = pinned.ask(f"{BASE}/{level}/{column}/{row}.png")[1]
    root = xml_of(pinned, f"{BASE}/wmts/1.0.0/WMTSCapabilities.xml")
    (template,) = [one.get("template") for one in root.iter(f"{WMTS}ResourceURL") if one.get("format") == "image/png"]
    filled = sure(template).replace("{TileMatrix}", str(level)).replace("{TileCol}", str(column))
    assert pinned.ask(path_of(filled.replace("{TileRow}", str(row))))[1] == tile
    pairs = (
        "Service=WMTS&Request=GetTile&Version=1.0.0&Layer=mosaic&Style=default&TileMatrixSet=GoogleMapsCompatible"
        f"&TileMatrix={level}&TileCol={column}&TileRow={row}&Format=image/png"
    )
    assert pinned.ask(f"{BASE}/wmts?{pairs}")[1] == tile
    by_pairs = pinned.ask(f"{BASE}/wmts?SERVICE=WMTS&REQUEST=GetCapabilities")[1]
    assert by_pairs == pinned.ask(f"{BASE}/wmts/1.0.0/WMTSCapabilities.xml")[1]
    limits = {sure(one.findtext(f"{WMTS}TileMatrix")): one for one in root.iter(f"{WMTS}TileMatrixLimits")}
    told = {name: int(sure(limits[str(level)].findtext(f"{WMTS}{name}"))) for name in ("MinTileRow", "MaxTileRow")}
    assert told["MinTileRow"] <= row <= told["MaxTileRow"]
    matrices = {sure(one.findtext(f"{{{OWS}}}Identifier")): one for one in root.iter(f"{WMTS}TileMatrix") if len(one)}
    assert float(sure(matrices["0"].findtext(f"{WMTS}ScaleDenominator"))) == pytest.approx(559082264.0287178)


@pytest.mark.parametrize(
    ("change", "status", "code"),
    [
        ("Request=GetFeatureInfo", 501, "OperationNotSupported"),
        ("Layer=roads", 400, "InvalidParameterValue"),
        ("TileMatrixSet=EPSG:31467", 400, "InvalidParameterValue"),
        ("Format=image/tiff", 400, "InvalidParameterValue"),
        ("TileMatrix=x", 400, "MissingParameterValue"),
        ("TileMatrix=40", 400, "TileOutOfRange"),
        ("TileCol=9999999", 400, "TileOutOfRange"),
        ("TileRow=-1", 400, "MissingParameterValue"),
    ],
)
def test_wmts_refuses_as_the_standard_says(pinned: Writer, change: str, status: int, code: str) -> None:
    asked = {
        **{"Request": "GetTile", "Layer": "mosaic", "TileMatrixSet": "GoogleMapsCompatible", "Format": "image/png"},
        **{"TileMatrix": "3", "TileCol": "1", "TileRow": "1"},
    }
    name, _, value = change.partition("=")
    query = "&".join(f"{key}={asked_for}" for key, asked_for in {**asked, name: value}.items())
    answer, data = pinned.ask(f"{BASE}/wmts?{query}")
    report = ElementTree.fromstring(data)
    assert answer.status == status
    assert sure(report.find(f"{{{OWS}}}Exception")).get("exceptionCode") == code


def test_atak_gets_a_source_that_leads_to_the_tiles(pinned: Writer, flight: AnchoredFlight) -> None:
    answer, data = pinned.ask(f"{BASE}/grg_gcs-mosaic.xml")
    assert "grg_gcs-mosaic.xml" in answer.headers["Content-Disposition"]
    root = ElementTree.fromstring(data)
    assert root.tag == "customMapSource"
    assert sure(root.findtext("name")).endswith(FLIGHT)  # tiles of another flight are kept under another name
    coarsest, finest = (int(sure(root.findtext(name))) for name in ("minZoom", "maxZoom"))
    assert (coarsest, flight.laid.levels[1] <= finest <= 22) == (flight.laid.levels[0], True)
    assert int(sure(root.findtext("tileUpdate"))) == 5000
    level = flight.laid.levels[1]
    column, row = laid_at(flight.laid, level)
    filled = sure(root.findtext("url")).replace("{$z}", str(level)).replace("{$x}", str(column))
    assert picture_of(pinned.ask(path_of(filled.replace("{$y}", str(row))))[1]).any()


def test_a_data_package_holds_the_source_and_the_finds_where_the_map_shows_them(
    pinned: Writer, flight: AnchoredFlight
) -> None:
    pinned.send("POST", "/finds", {"island": 0, "x": 100.0, "y": 50.0, "label": "a <tent> & more", "who": "Kim"})
    answer, data = pinned.ask(f"{BASE}/gcs-mosaic.zip")
    assert answer.headers["Content-Type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        texts = {name: archive.read(name).decode() for name in archive.namelist()}
    manifest = ElementTree.fromstring(texts["MANIFEST/manifest.xml"])
    assert (manifest.tag, manifest.get("version")) == ("MissionPackageManifest", "2")
    assert {one.get("name") for one in manifest.iter("Parameter")} >= {"uid", "name"}
    listed = {sure(one.get("zipEntry")) for one in manifest.iter("Content")}
    assert listed == texts.keys() - {"MANIFEST/manifest.xml"} == {"finds.kml", "grg_gcs-mosaic.xml"}
    place = sure(ElementTree.fromstring(texts["finds.kml"]).findtext(f".//{KML}coordinates"))
    truth = flight.truth.places(np.array([100.0, 50.0])).tolist()
    assert [float(one) for one in place.split(",")] == pytest.approx(truth, abs=1e-7)
    assert "a &lt;tent&gt; &amp; more" in texts["finds.kml"]
    assert pinned.ask(f"{BASE}/gcs-mosaic.zip")[1] == data


def test_google_earth_finds_its_way_from_the_link_to_the_finest_tiles(pinned: Writer, flight: AnchoredFlight) -> None:
    """Down the tree by the regions, to the tile that shows a place."""
    longitude, latitude = flight.truth.places(np.array([100.0, 50.0])).tolist()
    document = xml_of(pinned, f"{BASE}/map.kml")
    assert abs(float(sure(document.findtext(f".//{KML}LookAt/{KML}longitude"))) - longitude) < 0.01
    depth, order = 0, -1
    while True:
        overlay = document.find(f".//{KML}GroundOverlay")
        if overlay is not None:
            assert int(sure(overlay.findtext(f"{KML}drawOrder"))) > order
            order = int(sure(overlay.findtext(f"{KML}drawOrder")))
            assert contains(sure(overlay.find(f"{KML}LatLonBox")), longitude, latitude)
        links = list(document.iter(f"{KML}NetworkLink"))
        if not links:
            break
        (there,) = [one for one in links if contains(sure(one.find(f".//{KML}LatLonAltBox")), longitude, latitude)]
        document, depth = xml_of(pinned, path_of(there.findtext(f".//{KML}href"))), depth + 1
    assert order == flight.laid.levels[1]
    assert depth > 5
    icon = sure(document.find(f".//{KML}Icon"))
    assert icon.findtext(f"{KML}refreshMode") == "onInterval"
    assert picture_of(pinned.ask(path_of(icon.findtext(f"{KML}href")))[1]).any()
    assert pinned.ask(f"{BASE}/kml/25/0/0.kml")[1].count(b"<") == 5  # nothing


def contains(box: ElementTree.Element, longitude: float, latitude: float) -> bool:
    west, south, east, north = (
        float(sure(box.findtext(f"{KML}{side}"))) for side in ("west", "south", "east", "north")
    )
    return west <= longitude < east and south < latitude <= north


def test_qgis_gets_a_project_with_both_layers_and_the_extent(pinned: Writer, flight: AnchoredFlight) -> None:
    root = xml_of(pinned, f"{BASE}/gcs-mosaic.qgs")
    assert root.tag == "qgis"
    sources = [sure(one.findtext("datasource")) for one in root.iter("maplayer")]
    xyz = unquote(sure(re.search("url=([^&]+)", sources[0]))[1])
    assert xyz == f"http://{pinned.netloc}{BASE}/{{z}}/{{x}}/{{y}}.png"
    assert f"zmax={flight.laid.levels[1]}" in sources[0]
    assert "layers=mosaic" in sources[1]
    extent = [float(sure(root.findtext(f".//extent/{name}"))) for name in ("xmin", "ymin", "xmax", "ymax")]
    assert extent == pytest.approx(flight.laid.mercator_bounds, abs=0.01)
    drawn = [one.get("id") for one in root.iter("layer-tree-layer")]
    assert drawn == [one.findtext("id") for one in root.iter("maplayer")]


def test_without_an_anchor_each_answers_empty_and_says_how_to_set_one(client: Writer) -> None:
    for path in ("wmts/1.0.0/WMTSCapabilities.xml", "map.kml", "gcs-mosaic.qgs"):
        assert "Set two pins on the page" in client.ask(f"{BASE}/{path}")[1].decode(), path
    assert "BoundingBox" not in client.ask(f"{BASE}/wmts/1.0.0/WMTSCapabilities.xml")[1].decode()
    assert xml_of(client, f"{BASE}/map.kml").findall(f".//{KML}NetworkLink") == []
    assert xml_of(client, f"{BASE}/grg_gcs-mosaic.xml").findtext("minZoom") == "0"
    assert xml_of(client, f"{BASE}/kml/3/1/1.kml").findall(f".//{KML}GroundOverlay") == []


def test_what_is_known_is_not_sent_again(pinned: Writer) -> None:
    for path in ("wms?REQUEST=GetCapabilities", "wmts/1.0.0/WMTSCapabilities.xml", "map.kml", "tilejson.json"):
        etag = pinned.ask(f"{BASE}/{path}")[0].headers["ETag"]
        assert pinned.status(f"{BASE}/{path}", **{"If-None-Match": etag}) == 304


def test_addresses_have_the_token_where_it_is_needed_and_an_import_link_is_quoted() -> None:
    needed = MapAddresses("http://192.168.1.5:8470/", "f-1", "secret", underlay=True)
    assert needed.xyz == "http://192.168.1.5:8470/maps/f-1/{z}/{x}/{y}.png?token=secret&underlay=1"
    assert needed.mobac_tiles.startswith("http://192.168.1.5:8470/maps/f-1/{$z}/{$x}/{$y}.png?")
    link = needed.atak_import
    assert link.startswith(ATAK_IMPORT)
    assert unquote(link.removeprefix(ATAK_IMPORT)) == needed.mobac
    assert "&" not in link.removeprefix(ATAK_IMPORT)
    assert MapAddresses("http://[fd00::5]:8470/", "f-1").wms == "http://[fd00::5]:8470/maps/f-1/wms"


@pytest.mark.long
@pytest.mark.parametrize("name", ["a <b> & 'c' \"d\"", "großer Flug ]]>", "no \ufffd control"])
def test_names_of_flights_do_no_harm(pinned: Writer, flight: AnchoredFlight, name: str) -> None:
    path = flight.root / "mosaic.json"
    document = json.loads(path.read_text("utf-8"))
    told = {"flight": name.replace("\ufffd", "\x00"), "revision": document["revision"] + 1}
    path.write_text(json.dumps(document | told), "utf-8")
    time.sleep(1.1)
    for what in ("map.kml", "gcs-mosaic.qgs", "wmts", "wms"):
        root = xml_of(pinned, f"{BASE}/{what}?REQUEST=GetCapabilities")
        assert name in "".join(root.itertext())


@pytest.mark.parametrize("longitude", [180.0, -7.0, -173.0])
def test_the_tree_of_google_earth_begins_beside_the_islands_alone(longitude: float) -> None:
    """Not with all that lies between them: that would be up to a hundred thousand links and more."""
    far = island(id=1, laid=anchor(longitude=longitude, latitude=-44.5))
    now = MapNow("small", "small", 1, 1, GeoPyramid((island(), far), lambda *_: None), ())
    told = ElementTree.fromstring(as_start(now, MapAddresses("http://127.0.0.1/", "small")))
    boxes = [
        [float(sure(box.findtext(f"{KML}{side}"))) for side in ("west", "south", "east", "north")]
        for box in told.iter(f"{KML}LatLonAltBox")
    ]
    assert 9 <= len(boxes) <= 40
    for at, latitude in ((7.0, 44.5), (longitude, -44.5)):
        assert any(west <= at <= east and south <= latitude <= north for west, south, east, north in boxes)

"""The map on earth as files, read by the programs that others read them with; each ground point is where the pins say."""

from __future__ import annotations

import json
import shutil
import sqlite3
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import rasterio
from pmtiles.reader import MmapSource, Reader
from pykml.factory import KML_ElementMaker  # noqa: F401  (its schema parser needs the package's data)
from pykml.parser import Schema, fromstring
from rio_cogeo.cogeo import cog_validate

from gcs_mosaic.cli.main import main
from gcs_mosaic.export.earth_map import earth_map
from gcs_mosaic.export.kmz import export_kmz
from gcs_mosaic.geo.mercator import places_of_mercator
from gcs_mosaic.geotiles.canvas_tiles import tiles_at_rest
from gcs_mosaic.geotiles.picture_grid import grid_of_tile
from gcs_mosaic.geotiles.pyramid import GeoPyramid
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from tests.factories import frame
from tests.geotiles.ground import anchor
from tests.notes.written_pins import write_pins
from tests.sure import sure
from tests.tiers import thorough
from tests.web.maps.anchored_flight import PINNED, AnchoredFlight
from tests.web.maps.marked_flight import MARKS, MarkedFlight, mark_in, opened, worst_px

Export = Callable[..., Path]
KML = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture(scope="module", params=[44.5, thorough(-67.0)], ids=["44.5 N", "67 S"])
def flight(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> AnchoredFlight:
    root = tmp_path_factory.mktemp("flight") / "small"
    root.mkdir()
    made = MarkedFlight(root, anchor(gsd_m=0.1, turned_deg=-52.0, latitude=request.param))
    write_pins(root, [(x, y, *made.truth.places(np.array([x, y])).tolist()) for x, y in PINNED])
    return made


@pytest.fixture
def export(flight: AnchoredFlight, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Export:
    def run(format_name: str, *options: str, to: str = "file") -> Path:
        target = tmp_path / to
        code = main(["export", str(flight.root), "--format", format_name, "--to", str(target), *options])
        out, err = capsys.readouterr()
        assert code == 0, err
        assert f"written to {target}" in out
        return target

    return run


@pytest.mark.parametrize("crs", ["EPSG:3857", "utm"])
@pytest.mark.parametrize("format_name", ["geotiff", "cog"])
def test_a_tiff_with_coordinates(flight: AnchoredFlight, export: Export, format_name: str, crs: str) -> None:
    target = export(format_name, "--crs", crs, to="map.tif")
    with opened(str(target)) as dataset:
        north = flight.truth.plane.latitude_deg > 0
        assert dataset.crs.to_epsg() == (3857 if crs != "utm" else 32632 if north else 32732)
        assert dataset.count == 4
        assert [one.name for one in dataset.colorinterp] == ["red", "green", "blue", "alpha"]
        assert dataset.block_shapes[0] == (512, 512)
        assert dataset.overviews(1)
        assert worst_px(dataset, flight) < 1.0
        tags = dataset.tags()
        assert tags["FLIGHT"] == "small"
        assert tags["FLOWN"] == "1970-01-01T00:00:01Z"
        assert float(tags["ERROR_M"]) >= 0
        assert json.loads(tags["ISLANDS"])[0]["anchor"] == "pins"
    for overview in range(2):
        with rasterio.open(str(target), overview_level=overview) as dataset:
            if max(dataset.shape) > 300:
                assert worst_px(dataset, flight) < 1.0


@pytest.mark.long
@pytest.mark.parametrize("crs", ["EPSG:3857", thorough("utm")])
def test_a_cog_is_one(export: Export, crs: str) -> None:
    is_one, errors, warnings = cog_validate(str(export("cog", "--crs", crs, to="map.tif")), strict=True, quiet=True)
    assert is_one, errors
    assert not warnings


@pytest.mark.long
def test_a_tiff_s_pixels_are_those_of_the_tiles(flight: AnchoredFlight, export: Export) -> None:
    with opened(str(export("geotiff", to="map.tif"))) as dataset:
        whole, transform = dataset.read(), dataset.transform
    pyramid = GeoPyramid((flight.laid,), tiles_at_rest(flight.root))
    level = flight.laid.levels[1]
    differences = []
    for x, y in pyramid.tiles(level):
        west, _, _, north = grid_of_tile(level, x, y).bounds
        column, row = round((west - transform.c) / transform.a), round((north - transform.f) / transform.e)
        tile = pyramid.tile(level, x, y)
        if tile is None or min(column, row) < 0:
            continue
        part = np.moveaxis(whole[:, row : row + 256, column : column + 256], 0, 2)
        if part.shape == tile.shape:
            differences.append(np.abs(part.astype(int) - tile[..., [2, 1, 0, 3]]).mean())
    assert differences
    assert max(differences) < 0.1


@pytest.mark.long
def test_mbtiles(flight: AnchoredFlight, export: Export) -> None:
    target = export("mbtiles", to="map.mbtiles")
    with opened(str(target)) as dataset:
        assert dataset.crs.to_epsg() == 3857
        assert worst_px(dataset, flight) < 1.0
    file = sqlite3.connect(target)
    about = dict(file.execute("SELECT name, value FROM metadata").fetchall())
    assert {"name", "format", "bounds", "minzoom", "maxzoom", "type", "description"} <= set(about)
    assert about["format"] == "png"
    assert json.loads(about["gcs_mosaic"])["islands"][0]["frames"] == 9
    assert file.execute("PRAGMA application_id").fetchone() == (0x4D504258,)
    assert file.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone() == flight.laid.levels
    file.close()


@pytest.mark.long
def test_pmtiles(flight: AnchoredFlight, export: Export) -> None:
    """By its own reader: each tile is the pyramid's."""
    target = export("pmtiles", "--tiles", "webp", to="map.pmtiles")
    pyramid = GeoPyramid((flight.laid,), tiles_at_rest(flight.root))
    with target.open("rb") as file:
        reader = Reader(MmapSource(file))
        header = reader.header()
        assert (header["min_zoom"], header["max_zoom"]) == flight.laid.levels
        assert np.allclose(
            [header[name] / 1e7 for name in ("min_lon_e7", "min_lat_e7")], flight.laid.bounds[:2], atol=1e-6
        )
        assert reader.metadata()["flight"] == "small"
        for level in range(flight.laid.levels[0], flight.laid.levels[1] + 1):
            for x, y in pyramid.tiles(level):
                wanted, there = pyramid.tile(level, x, y), reader.get(level, x, y)
                assert (wanted is None) == (there is None)
                if wanted is not None:
                    picture = sure(cv2.imdecode(np.frombuffer(there, np.uint8), cv2.IMREAD_UNCHANGED))
                    seen = wanted[..., 3] == 255
                    off = np.abs(picture[seen][:, :3].astype(int) - wanted[seen][:, :3])
                    assert off.sum() < 3 * max(off.size, 1000), "a few pixels at a border may be off by what WebP loses"


@pytest.mark.thorough
@pytest.mark.long
def test_pmtiles_by_gdal(flight: AnchoredFlight, export: Export) -> None:
    """GDAL reads PMTiles of vector tiles alone; the same tiles in MBTiles stand for the place of each pixel."""
    with export("pmtiles", to="map.pmtiles").open("rb") as file:
        archive = Reader(MmapSource(file))
        rows = sqlite3.connect(export("mbtiles", to="map.mbtiles"))
        for z, x, row, data in rows.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles"):
            assert archive.get(z, x, (1 << z) - 1 - row) == data
        rows.close()


@pytest.mark.long
def test_a_folder_of_tiles(flight: AnchoredFlight, export: Export) -> None:
    folder = export("xyz", "--tiles", "jpg", to="tiles")
    told = json.loads((folder / "tiles.json").read_text())
    assert (told["minzoom"], told["maxzoom"]) == flight.laid.levels
    pyramid = GeoPyramid((flight.laid,), tiles_at_rest(flight.root))
    expected = {(z, *at) for z in range(told["minzoom"], told["maxzoom"] + 1) for at in pyramid.tiles(z)}
    written = {tuple(map(int, path.with_suffix("").parts[-3:])) for path in folder.rglob("*.jpg")}
    assert written
    assert written <= expected
    assert all(pyramid.tile(*place) is None for place in expected - written)


@pytest.mark.long
@pytest.mark.parametrize("side", [4096, 300], ids=["one picture", "a tree"])
def test_a_kmz(flight: AnchoredFlight, export: Export, monkeypatch: pytest.MonkeyPatch, side: int) -> None:
    """Against the schema; each mark is found where the finest pictures say."""
    monkeypatch.setattr("gcs_mosaic.export.kmz.ONE_PICTURE_PX", side)
    with zipfile.ZipFile(export("kmz", to="map.kmz")) as archive:
        assert archive.namelist()[0] == "doc.kml"
        documents = {name: archive.read(name) for name in archive.namelist() if name.endswith(".kml")}
        overlays: list[ElementTree.Element] = []
        for text in documents.values():
            Schema("ogckml22.xsd").assertValid(fromstring(text))
            root = ElementTree.fromstring(text)
            for link in root.iter(f"{KML}href"):
                assert link.text in archive.namelist()
            overlays += root.iter(f"{KML}GroundOverlay")
        assert (len(overlays) == 1) == (side == 4096)
        pictures = [(box_of(one), picture_of(archive, one)) for one in overlays]
    finest = min(east - west for (west, _, east, _), _ in pictures)
    places = flight.truth.places(MARKS)
    found = 0
    for (west, south, east, north), picture in pictures:
        if east - west > 1.01 * finest:
            continue
        high, wide = picture.shape[:2]
        for longitude, latitude in places.tolist():
            column, row = (longitude - west) / (east - west) * wide, (north - latitude) / (north - south) * high
            if 20 < column < wide - 20 and 20 < row < high - 20:
                assert mark_near(picture, column, row) < 1.0
                found += 1
    assert found >= len(MARKS) - 3


def box_of(overlay: ElementTree.Element) -> tuple[float, ...]:
    box = sure(overlay.find(f"{KML}LatLonBox"))
    return tuple(float(sure(box.find(f"{KML}{side}")).text or "") for side in ("west", "south", "east", "north"))


def picture_of(archive: zipfile.ZipFile, overlay: ElementTree.Element) -> np.ndarray:
    name = sure(overlay.find(f"{KML}Icon/{KML}href")).text or ""
    return sure(cv2.imdecode(np.frombuffer(archive.read(name), np.uint8), cv2.IMREAD_UNCHANGED))


def mark_near(picture: np.ndarray, column: float, row: float, around: int = 14) -> float:
    left, top = int(column) - around, int(row) - around
    x, y = mark_in(picture[top : top + 2 * around + 1, left : left + 2 * around + 1, 0])
    return float(np.hypot(x + left - column, y + top - row))


def test_geojson(flight: AnchoredFlight, export: Export) -> None:
    told = json.loads(export("geojson", to="map.geojson").read_text())
    assert told["gcs_mosaic"]["islands"][0]["anchor"] == "pins"
    (footprint,) = (one for one in told["features"] if one["properties"]["is"] == "footprint")
    assert footprint["properties"]["frame"] == "a.jpg"
    ring = np.array(footprint["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    canvas = flight.truth.canvas(ring)
    assert np.allclose(np.abs(canvas).max(axis=0), [650, 500], atol=1)
    area = ((ring[:-1, 0] * ring[1:, 1]) - (ring[1:, 0] * ring[:-1, 1])).sum()
    assert area > 0, "counterclockwise, as RFC 7946 wants it"


@pytest.mark.long
def test_a_cut_out(flight: AnchoredFlight, export: Export) -> None:
    west, south, east, north = flight.laid.bounds
    box = (west, south, (west + east) / 2, (south + north) / 2)
    with opened(str(export("geotiff", "--box", *map(repr, box), to="map.tif"))) as dataset:
        low, high = places_of_mercator(np.array([dataset.bounds[:2], dataset.bounds[2:]]))
        assert np.allclose([*low, *high], box, atol=1e-6)
    with opened(str(export("mbtiles", "--box", *map(repr, box), to="map.mbtiles"))) as dataset:
        assert dataset.bounds.right < flight.laid.mercator_bounds[2]


@pytest.mark.long
def test_a_coarser_level(flight: AnchoredFlight, export: Export) -> None:
    finest = flight.laid.levels[1]
    with opened(str(export("geotiff", "--zoom", str(finest - 1), to="a.tif"))) as coarse:
        with opened(str(export("geotiff", to="b.tif"))) as fine:
            assert coarse.transform.a == pytest.approx(2 * fine.transform.a)
        assert worst_px(coarse, flight) < 1.0


@pytest.mark.parametrize("kind", ["finds-geojson", "finds-csv", "finds-kml"])
def test_finds_have_coordinates(flight: AnchoredFlight, export: Export, kind: str) -> None:
    assert export(kind, to=f"finds.{kind[6:]}").exists()


@pytest.fixture
def refused(flight: AnchoredFlight, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def run(*options: str, root: Path = flight.root, to: str = "file") -> str:
        code = main(["export", str(root), "--to", str(tmp_path / to), *options])
        assert code == 2
        assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
        return capsys.readouterr().err

    return run


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--format", "geotiff", "--crs", "EPSG:27700"), "EPSG:27700 is not written: give EPSG:3857"),
        (("--format", "geotiff", "--island", "7"), "There is no island 7"),
        (("--format", "geotiff", "--zoom", "40"), "on earth this map has the levels"),
        (("--format", "mbtiles", "--zoom", "-3"), "on earth this map has the levels"),
        (("--format", "kmz", "--zoom", "60"), "on earth this map has the levels"),
        (("--format", "cog", "--box", "1", "2", "3", "4"), "--box lies beside the map, which reaches from"),
        (("--format", "cog", "--box", "44", "7", "43", "8"), "is no box: give west, south, east and north"),
        (("--format", "cog", "--box", "nan", "7", "43", "8"), "is no box"),
        (("--format", "cog", "--box", "7", "44"), "--box: expected 4 arguments"),
        (("--format", "cog", "--tiles", "png"), "--format cog knows no --tiles: mbtiles, pmtiles, xyz do"),
        (("--format", "png", "--box", "1", "2", "3", "4"), "--format png knows no --box"),
        (("--format", "kmz", "--bands"), "--format kmz knows no --bands: geotiff, cog do"),
        (("--format", "cog", "--no-gains"), "give --bands too"),
        (("--format", "mbtiles", "--tiles", "gif"), "invalid choice: 'gif'"),
    ],
)
def test_what_cannot_be_is_told_in_a_sentence(refused: Callable[..., str], options: tuple[str, ...], told: str) -> None:
    said = refused(*options)
    assert told in said
    assert said.count("\n") == 1


def test_a_target_that_is_there(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    assert "is a folder; give a file" in refused("--format", "mbtiles", to="there")
    (tmp_path / "there" / "other.txt").write_text("x")
    assert "is there already, and is left as it is" in refused("--format", "xyz", to="there")
    assert [path.name for path in (tmp_path / "there").iterdir()] == ["other.txt"]
    assert "cannot be written" in refused("--format", "pmtiles", to="no/where")


@pytest.mark.long
@pytest.mark.parametrize(
    "format_name", ["geotiff", "kmz", "geojson", *map(thorough, ("cog", "mbtiles", "pmtiles", "xyz"))]
)
def test_without_an_anchor(
    flight: AnchoredFlight, refused: Callable[..., str], tmp_path_factory: pytest.TempPathFactory, format_name: str
) -> None:
    root = tmp_path_factory.mktemp("loose") / "small"
    root.mkdir()
    AnchoredFlight(root, drawn=flight.root)
    said = refused("--format", format_name, root=root)
    assert "has no anchor, and so no longitude: set two pins or more on its page" in said
    assert said.count("\n") == 1
    assert not (root / "notes.sqlite").exists()
    assert main(["export", str(root), "--format", "png"]) == 0


@pytest.mark.long
def test_pins_that_lay_no_map_are_said_to_be_what_is_wrong(
    flight: AnchoredFlight, refused: Callable[..., str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Who has set four pins was told to set two."""
    root = tmp_path_factory.mktemp("near") / "small"
    root.mkdir()
    laid = AnchoredFlight(root, drawn=flight.root)
    near = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])
    write_pins(root, np.concatenate([near, laid.truth.places(near)], axis=1).tolist())
    said = refused("--format", "geotiff", root=root)
    assert "has no anchor, and so no longitude. The pins' coordinates lie within 0 m, which with their errors" in said
    assert said.endswith("(sigma). The formats png, tiff and placements need no anchor.\n")
    assert "two pins" not in said


@pytest.fixture(scope="module")
def across(tmp_path_factory: pytest.TempPathFactory) -> AnchoredFlight:
    """A flight over the 180th meridian."""
    root = tmp_path_factory.mktemp("across") / "small"
    root.mkdir()
    made = MarkedFlight(root, anchor(gsd_m=0.1, turned_deg=-52.0, longitude=180.0, latitude=-17.0))
    write_pins(root, [(x, y, *made.truth.places(np.array([x, y])).tolist()) for x, y in PINNED])
    return made


def exported(flight: AnchoredFlight, target: Path, *options: str) -> Path:
    assert main(["export", str(flight.root), "--to", str(target), *options]) == 0
    return target


@pytest.mark.long
def test_over_the_180th_meridian_a_tiff_lies_in_its_own_zone(across: AnchoredFlight, tmp_path: Path) -> None:
    with opened(str(exported(across, tmp_path / "map.tif", "--format", "geotiff", "--crs", "utm"))) as dataset:
        assert dataset.crs.to_epsg() in (32701, 32760)
        assert worst_px(dataset, across) < 1.0


def test_over_the_180th_meridian_a_frame_does_not_reach_round_the_earth(across: AnchoredFlight, tmp_path: Path) -> None:
    told = json.loads(exported(across, tmp_path / "map.geojson", "--format", "geojson").read_text())
    (ring,) = next(one for one in told["features"] if one["properties"]["is"] == "footprint")["geometry"]["coordinates"]
    places = np.array(ring)
    assert np.ptp(places[:, 0]) < 0.01
    assert np.allclose(np.abs(across.truth.canvas(places)).max(axis=0), [650, 500], atol=1)
    assert ((places[:-1, 0] * places[1:, 1]) - (places[1:, 0] * places[:-1, 1])).sum() > 0


def test_all_that_is_told_of_a_place_tells_its_error(flight: AnchoredFlight, tmp_path: Path) -> None:
    root = shutil.copytree(flight.root, tmp_path / "flight")
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.record_frame(frame("b.jpg"))
        pose, camera = Pose(90.0, 60.0), Camera(1300, 1000)
        ledger.record_painted(RenderItem(name="b.jpg", order=1, island=0, pose=pose, camera=camera, level=16))
    target = tmp_path / "map.geojson"
    assert main(["export", str(root), "--format", "geojson", "--to", str(target)]) == 0
    told = [one["properties"] for one in json.loads(target.read_text())["features"]]
    assert {one["is"] for one in told} >= {"footprint", "path"}
    assert all(one["error_m"] >= 1 for one in told)


def test_each_of_several_aircraft_has_a_path_of_its_own(flight: AnchoredFlight, tmp_path: Path) -> None:
    """Not one that leaps from each to the other at every picture."""
    root = shutil.copytree(flight.root, tmp_path / "flight")
    with Ledger(root / LEDGER_NAME) as ledger:
        for order in range(1, 7):
            vehicle = 1 + order % 2
            name = f"{vehicle}/{order}.jpg"
            ledger.record_frame(frame(name, vehicle=vehicle))
            pose, camera = Pose(90.0 * order, 60.0 * vehicle), Camera(1300, 1000)
            ledger.record_painted(RenderItem(name=name, order=order, island=0, pose=pose, camera=camera, level=16))
    target = tmp_path / "map.geojson"
    assert main(["export", str(root), "--format", "geojson", "--to", str(target)]) == 0
    told = json.loads(target.read_text())
    paths = [one["properties"] for one in told["features"] if one["properties"]["is"] == "path"]
    assert {one["vehicle"]: one["frames"] for one in paths} == {
        1: ["1/2.jpg", "1/4.jpg", "1/6.jpg"],
        2: ["2/1.jpg", "2/3.jpg", "2/5.jpg"],
    }
    of_frames = [one["properties"] for one in told["features"] if one["properties"]["is"] == "footprint"]
    assert {one["frame"]: one.get("vehicle") for one in of_frames if one["frame"] in ("a.jpg", "2/1.jpg")} == {
        "a.jpg": None,
        "2/1.jpg": 2,
    }


@pytest.mark.long
def test_over_the_180th_meridian_a_kmz_is_one_picture(across: AnchoredFlight, tmp_path: Path) -> None:
    with zipfile.ZipFile(exported(across, tmp_path / "map.kmz", "--format", "kmz")) as archive:
        (overlay,) = ElementTree.fromstring(archive.read("doc.kml")).iter(f"{KML}GroundOverlay")
        (west, south, east, north), picture = box_of(overlay), picture_of(archive, overlay)
    assert 179.9 < west < 180 < east < 180.1
    for longitude, latitude in across.truth.places(MARKS).tolist():
        column = (longitude % 360 - west) / (east - west) * picture.shape[1]
        row = (north - latitude) / (north - south) * picture.shape[0]
        if 20 < column < picture.shape[1] - 20 and 20 < row < picture.shape[0] - 20:
            assert mark_near(picture, column, row) < 1.0


@pytest.mark.long
def test_of_islands_far_apart_a_kmz_shows_each(flight: AnchoredFlight, tmp_path: Path) -> None:
    """One pin with a wrong sign is enough for that."""
    found = earth_map(flight.root)
    (near,) = found.pyramid.islands
    far = replace(near, anchor=anchor(longitude=-170.0, latitude=near.latitude_deg))
    both = replace(found, pyramid=replace(found.pyramid, islands=(near, far)))
    export_kmz(both, tmp_path / "map.kmz", None, lambda done, count: None)
    with zipfile.ZipFile(tmp_path / "map.kmz") as archive:
        overlays = [
            box_of(one)
            for name in archive.namelist()
            if name.endswith(".kml")
            for one in ElementTree.fromstring(archive.read(name)).iter(f"{KML}GroundOverlay")
        ]
    fine = [(west + east) / 2 for west, _, east, _ in overlays if east - west < 0.01]
    assert min(fine) == pytest.approx(-170.0, abs=0.01)
    assert max(fine) == pytest.approx(7.0, abs=0.01)


@pytest.mark.parametrize("latitude", [85.5, -89.0])
@pytest.mark.parametrize("format_name", ["geotiff", "mbtiles", "pmtiles", "xyz"])
def test_near_the_poles_what_web_mercator_does_not_reach_is_told(
    refused: Callable[..., str], tmp_path_factory: pytest.TempPathFactory, latitude: float, format_name: str
) -> None:
    root = tmp_path_factory.mktemp("polar") / "small"
    root.mkdir()
    made = AnchoredFlight(root, anchor(latitude=latitude))
    write_pins(root, [(x, y, *made.truth.places(np.array([x, y])).tolist()) for x, y in PINNED])
    said = refused("--format", format_name, root=root)
    assert "reaches beyond 85 degrees" in said
    assert said.count("\n") == 1

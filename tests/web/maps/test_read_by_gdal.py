"""GDAL, which QGIS reads with, opens what is served and finds each point of the ground where the pins say."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from pyproj import Transformer
from rasterio.windows import Window

from gcs_mosaic.geo.mercator import HALF_WORLD_M
from gcs_mosaic.render.tile_grid import tile_box, tiles_over
from gcs_mosaic.stitch.arrays import AnyImage, Array
from tests.geotiles.ground import anchor
from tests.web.maps.anchored_flight import BOX, FLIGHT, AnchoredFlight
from tests.web.test_notes_api import Writer

MARKS = np.array(
    [(-520.0, -390.0), (-90.0, -310.0), (505.0, -402.0), (12.0, 7.0), (-301.0, 211.0), (544.0, 398.0), (77.0, 401.0)]
)
RADIUS = 5.0  # canvas units
NEAR_PX = 14


class MarkedFlight(AnchoredFlight):
    """Dark ground with light marks on it."""

    def draw(self, island_: int = 0) -> None:
        for level in range(self.laid.coarsest, 17):
            for tile in tiles_over(BOX, level):
                left, top, right, _ = tile_box(tile)
                at = (np.arange(256) + 0.5) * (right - left) / 256
                x, y = np.meshgrid(left + at, top + at)
                light = sum(np.exp(-((x - mx) ** 2 + (y - my) ** 2) / RADIUS**2) for mx, my in MARKS)
                seen = (x > BOX[0]) & (x < BOX[2]) & (y > BOX[1]) & (y < BOX[3])
                grey = ((40 + 180 * light) * seen).astype(np.uint8)
                self.put(tile, np.dstack([grey, grey, grey, (seen * 255).astype(np.uint8)]), island_)


@pytest.fixture(params=[44.5, 67.0], ids=["44.5 N", "67 N"])
def flight(request: pytest.FixtureRequest, tmp_path: Path, fresh_tables: None) -> AnchoredFlight:
    root = tmp_path / "small"
    root.mkdir()
    return MarkedFlight(root, anchor(gsd_m=0.1, turned_deg=-52.0, latitude=request.param))


@contextmanager
def opened(source: str) -> Iterator[Any]:
    with rasterio.Env(GDAL_HTTP_TIMEOUT=20, CPL_CURL_VERBOSE=False), rasterio.open(source) as dataset:
        yield dataset


def found_at(dataset: Any, x: float, y: float) -> tuple[float, float]:
    """Where in pixels from a place on the map its mark is."""
    north_up = dataset.transform
    column, row = (x - north_up.c) / north_up.a, (y - north_up.f) / north_up.e
    left, top = int(column) - NEAR_PX, int(row) - NEAR_PX
    side = 2 * NEAR_PX + 1
    grey = dataset.read(1, window=Window(left, top, side, side)).astype(float)
    weight: AnyImage = np.clip(grey - 100, 0, None)
    assert weight.sum() > 0, "no mark near"
    across, down = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    middle = (weight * across).sum() / weight.sum() + left, (weight * down).sum() / weight.sum() + top
    return middle[0] - column, middle[1] - row


def worst_px(dataset: Any, flight: AnchoredFlight) -> float:
    """Of all marks, by PROJ from the pins' longitude and latitude to the dataset's own system."""
    places: Array = flight.truth.places(MARKS)
    to_map = Transformer.from_crs("EPSG:4326", dataset.crs.to_wkt(), always_xy=True)
    points = zip(*to_map.transform(places[:, 0], places[:, 1]), strict=True)
    return max(float(np.hypot(*found_at(dataset, x, y))) for x, y in points)


def test_xyz(pinned: Writer, flight: AnchoredFlight) -> None:
    level = flight.laid.levels[1]
    tiles = f"http://{pinned.netloc}/maps/{FLIGHT}/${{z}}/${{x}}/${{y}}.png"
    corners = f"<UpperLeftX>-{HALF_WORLD_M}</UpperLeftX><UpperLeftY>{HALF_WORLD_M}</UpperLeftY>"
    corners += f"<LowerRightX>{HALF_WORLD_M}</LowerRightX><LowerRightY>-{HALF_WORLD_M}</LowerRightY>"
    grid = f"<TileLevel>{level}</TileLevel><TileCountX>1</TileCountX><TileCountY>1</TileCountY><YOrigin>top</YOrigin>"
    source = (
        f'<GDAL_WMS><Service name="TMS"><ServerUrl>{tiles}</ServerUrl></Service><DataWindow>{corners}{grid}</DataWindow>'
        "<Projection>EPSG:3857</Projection><BlockSizeX>256</BlockSizeX><BlockSizeY>256</BlockSizeY>"
        "<BandsCount>4</BandsCount></GDAL_WMS>"
    )
    with opened(source) as dataset:
        assert worst_px(dataset, flight) < 1.0


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")  # a service has none, only its layers
@pytest.mark.parametrize("version", ["1.1.1", "1.3.0"])
def test_wms_by_its_capabilities(pinned: Writer, flight: AnchoredFlight, version: str) -> None:
    """In each reference system that the service names, whatever order of axes that has."""
    url = f"http://{pinned.netloc}/maps/{FLIGHT}/wms"
    with opened(f"WMS:{url}?SERVICE=WMS&VERSION={version}&REQUEST=GetCapabilities") as service:
        layers = list(service.subdatasets)
    assert layers
    for layer in layers:
        with opened(f"{layer}&FORMAT=image/png&TRANSPARENT=TRUE") as dataset:
            assert dataset.count == 4
            assert dataset.bounds.left < dataset.bounds.right
    west, south, east, north = flight.laid.bounds
    # At about the canvas' resolution; GDAL itself turns the axes of EPSG:4326 in 1.3.0.
    size = f"<SizeX>{round((east - west) / 1.2e-6)}</SizeX><SizeY>{round((north - south) / 1e-6)}</SizeY>"
    window = f"<UpperLeftX>{west}</UpperLeftX><UpperLeftY>{north}</UpperLeftY><LowerRightX>{east}</LowerRightX>"
    system = "<SRS>EPSG:4326</SRS>" if version == "1.1.1" else "<CRS>EPSG:4326</CRS><BBoxOrder>yxYX</BBoxOrder>"
    source = (
        f'<GDAL_WMS><Service name="WMS"><Version>{version}</Version><ServerUrl>{url}?</ServerUrl>{system}'
        "<ImageFormat>image/png</ImageFormat><Transparent>TRUE</Transparent><Layers>mosaic</Layers></Service>"
        f"<DataWindow>{window}<LowerRightY>{south}</LowerRightY>{size}</DataWindow><Projection>EPSG:4326</Projection>"
        "<BandsCount>4</BandsCount><BlockSizeX>300</BlockSizeX><BlockSizeY>300</BlockSizeY></GDAL_WMS>"
    )
    with opened(source) as dataset:
        assert worst_px(dataset, flight) < 1.0


def test_wmts_by_its_capabilities(pinned: Writer, flight: AnchoredFlight) -> None:
    with opened(f"WMTS:http://{pinned.netloc}/maps/{FLIGHT}/wmts/1.0.0/WMTSCapabilities.xml") as dataset:
        assert dataset.crs.to_epsg() == 3857
        assert dataset.bounds.left <= flight.laid.mercator_bounds[0] + 1
        assert worst_px(dataset, flight) < 1.0

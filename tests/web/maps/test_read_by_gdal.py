"""GDAL, which QGIS reads with, opens what is served and finds each point of the ground where the pins say."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_mosaic.geo.mercator import HALF_WORLD_M
from tests.geotiles.ground import anchor
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight
from tests.web.maps.marked_flight import MarkedFlight, opened, worst_px
from tests.web.test_notes_api import Writer


@pytest.fixture(params=[44.5, 67.0], ids=["44.5 N", "67 N"])
def flight(request: pytest.FixtureRequest, tmp_path: Path, fresh_tables: None) -> AnchoredFlight:
    root = tmp_path / "small"
    root.mkdir()
    return MarkedFlight(root, anchor(gsd_m=0.1, turned_deg=-52.0, latitude=request.param))


@pytest.mark.long
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


@pytest.mark.long
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


@pytest.mark.long
def test_wmts_by_its_capabilities(pinned: Writer, flight: AnchoredFlight) -> None:
    with opened(f"WMTS:http://{pinned.netloc}/maps/{FLIGHT}/wmts/1.0.0/WMTSCapabilities.xml") as dataset:
        assert dataset.crs.to_epsg() == 3857
        assert dataset.bounds.left <= flight.laid.mercator_bounds[0] + 1
        assert worst_px(dataset, flight) < 1.0

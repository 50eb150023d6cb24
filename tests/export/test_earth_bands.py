"""All bands of a flight laid on earth, read by GDAL, against the known ground."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from pyproj import Transformer

from gcs_mosaic.cli.main import main
from gcs_mosaic.geo.ellipsoid import LocalPlane
from tests.export.multiband_flight import WINDOW, Flown, flown, ground_counts, ground_from_canvas, middle
from tests.notes.written_pins import write_pins
from tests.tiers import thorough

PLANE = LocalPlane(7.0, 44.5)
PINNED = ((-200.0, -150.0), (250.0, -150.0), (-200.0, 300.0), (250.0, 300.0))


@pytest.fixture(scope="module")
def five(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Flown:
    """Laid by four points whose place on the simulated ground is known."""
    made = flown(tmp_path_factory, world_cache, bands=5, depth=16)
    pins = []
    for x, y in PINNED:
        east, south = (ground_from_canvas(made) @ (x, y, 1.0))[:2]
        pins.append((x, y, *PLANE.places(np.array([east, -south])).tolist()))
    write_pins(made.out, pins)
    return made


@pytest.mark.long
@pytest.mark.parametrize(("format_name", "crs"), [("geotiff", "utm"), thorough("cog", "EPSG:3857")])
def test_every_band_lies_where_the_ground_is(five: Flown, tmp_path: Path, format_name: str, crs: str) -> None:
    target = tmp_path / "bands.tif"
    options = ("--format", format_name, "--bands", "--no-gains", "--crs", crs, "--to", str(target))
    assert main(["export", str(five.out), *options]) == 0
    with rasterio.open(target) as dataset:
        assert (dataset.count, set(dataset.dtypes)) == (6, {"uint16"})
        image = np.moveaxis(dataset.read(), 0, 2)
        columns, rows = middle(image)
        north_up = dataset.transform
        x, y = np.meshgrid(
            north_up.c + north_up.a * (np.r_[columns] + 0.5), north_up.f + north_up.e * (np.r_[rows] + 0.5)
        )
        to_earth = Transformer.from_crs(dataset.crs.to_wkt(), "EPSG:4326", always_xy=True)
    spots = PLANE.spots(np.stack(to_earth.transform(x, y), axis=-1))
    ground = spots * (1, -1)
    gsd = float(np.hypot(*(ground[0, 1] - ground[0, 0])))
    ours, wanted = image[rows, columns, :-1].astype(float), ground_counts(five, ground, gsd).astype(float)
    window = cv2.createHanningWindow((WINDOW, WINDOW), cv2.CV_64F)
    # OpenCV multiplies what it is given by the window.
    shifts = [cv2.phaseCorrelate(wanted[..., k].copy(), ours[..., k].copy(), window)[0] for k in range(5)]
    assert np.abs(shifts).max() < 1.0
    assert np.ptp(shifts, axis=0).max() < 0.03, "the bands lie on each other"
    for k in range(5):
        assert np.corrcoef(ours[..., k].ravel(), wanted[..., k].ravel())[0, 1] > 0.95

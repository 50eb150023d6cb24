"""The integral of a place as a GeoTIFF: each of its pixels is where the anchor says that the canvas is."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import numpy as np
import pytest
import rasterio
import tifffile
from pyproj import Transformer

from gcs_mosaic.export.integral_file import earth_tags
from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.integral.stack import GroundWindow

WINDOW = GroundWindow(300.0, -200.0, 400.0, 100)


def anchor_at(longitude: float, latitude: float, turned_deg: float = 30.0) -> Anchor:
    turn = cmath.rect(0.1, math.radians(turned_deg))
    return Anchor(
        plane=LocalPlane(longitude, latitude), turn=turn, shift=5 - 3j, middle=0j, covariance=((0.0,) * 4,) * 4
    )


@pytest.mark.parametrize(("longitude", "latitude", "epsg"), [(14.3, 48.3, 32633), (-70.2, -33.4, 32719)])
def test_pixels_are_where_the_anchor_has_them(longitude: float, latitude: float, epsg: int, tmp_path: Path) -> None:
    anchor = anchor_at(longitude, latitude)
    tifffile.imwrite(tmp_path / "one.tif", np.zeros((100, 100), np.float32), extratags=earth_tags(WINDOW, anchor))
    with rasterio.open(tmp_path / "one.tif") as dataset:
        assert dataset.crs.to_epsg() == epsg
        to_degrees = Transformer.from_crs(dataset.crs, 4326, always_xy=True)
        for column, row in ((0, 0), (100, 100), (37, 81)):
            canvas = np.array([[100.0 + 4 * column, -400.0 + 4 * row]])
            wanted = anchor.places(canvas)[0].tolist()
            assert to_degrees.transform(*(dataset.transform @ (column, row))) == pytest.approx(wanted, abs=1e-8)


def test_near_a_pole_it_has_no_zone() -> None:
    assert earth_tags(WINDOW, anchor_at(0.0, 89.0)) == ()

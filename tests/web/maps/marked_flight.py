"""Dark ground with light marks, and how far from their true places a program that reads with GDAL finds them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import rasterio
from pyproj import Transformer
from rasterio.windows import Window

from gcs_mosaic.render.tile_grid import tile_box, tiles_over
from gcs_mosaic.stitch.arrays import AnyImage, Array
from tests.web.maps.anchored_flight import BOX, AnchoredFlight

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
    middle = mark_in(dataset.read(1, window=Window(left, top, side, side)))
    return middle[0] + left - column, middle[1] + top - row


def mark_in(grey: AnyImage) -> tuple[float, float]:
    """Column and row of a mark's middle, from the picture's corner; integers are pixels' edges."""
    weight = np.clip(grey.astype(float) - 100, 0, None)
    assert weight.sum() > 0, "no mark near"
    down, across = np.mgrid[: grey.shape[0], : grey.shape[1]] + 0.5
    return float((weight * across).sum() / weight.sum()), float((weight * down).sum() / weight.sum())


def worst_px(dataset: Any, flight: AnchoredFlight) -> float:
    """Of all marks, by PROJ from the pins' longitude and latitude to the dataset's own system."""
    places: Array = flight.truth.places(MARKS)
    to_map = Transformer.from_crs("EPSG:4326", dataset.crs.to_wkt(), always_xy=True)
    points = zip(*to_map.transform(places[:, 0], places[:, 1]), strict=True)
    return max(float(np.hypot(*found_at(dataset, x, y))) for x, y in points)

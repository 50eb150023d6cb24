"""Exports for other programs: the canvas places of every frame's pixels, and the map as one image."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.arrays import PointsNx2
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels, pixel_grid
from gcs_mosaic.stitch.camera.relief import on_plane
from gcs_mosaic.store.disk import DiskFull, write_beside
from gcs_mosaic.store.documents import Document, write_json
from gcs_mosaic.store.folder import LEDGER_NAME, find_flight
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.listing import FrameNews, Listing
from gcs_mosaic.store.records import Estimate, FrameState
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.store.tiles import encode
from gcs_mosaic.store.told_islands import told_islands
from gcs_mosaic.views.tile_reader import level_within, picture, pixel_bounds

WARP_COLUMNS, WARP_ROWS = 65, 49  # between these points lens distortion is linear to a hundredth of a pixel
LARGEST_PICTURE = 100_000_000  # pixels, if no level is given; more than most programs open
MOST_PIXELS = 1_500_000_000  # pixels, as a hard limit: 6 GB


def export_placements(flight: Path, target: Path) -> str:
    """Write the placements of a flight's ledger with the exact places of a grid of pixels; returns a message."""
    with Ledger(find_flight(flight) / LEDGER_NAME, read_only=True) as ledger:
        listing, estimates = Listing(), ledger.estimates()
        rejected = {frame.name: frame.reason or "" for frame in ledger.frames(FrameState.REJECTED)}
        waiting = [frame.name for frame in ledger.frames(FrameState.WAITING)]
        news = FrameNews(
            estimates=estimates,
            covered=ledger.covered(),
            rejected=rejected,
            waiting=waiting,
            newest=ledger.newest_on_map(),
            newest_of=ledger.newest_of_aircraft(),
        )
    listing.tell(news)
    document: Document = json.loads(listing.text(last_revision(flight)))
    for entry, estimate in zip(cast("list[Document]", document["frames"]), estimates, strict=True):
        entry["warp"] = warp(estimate)
    with telling_where(target):
        write_json(target, document)
    return f"{len(estimates)} placements written to {target}"


def warp(estimate: Estimate) -> Document:
    """Canvas places of a grid of a frame's pixels, including lens and relief; null above the horizon."""
    grid = pixel_grid(estimate.camera, WARP_COLUMNS, WARP_ROWS)
    places = _places(estimate, grid).round(3)
    rows = places.astype(object).reshape(WARP_ROWS, WARP_COLUMNS, 2)
    rows[np.isnan(places.reshape(rows.shape))] = None  # JSON has no NaN
    return {
        "x": grid[:WARP_COLUMNS, 0].tolist(),
        "y": grid[::WARP_COLUMNS, 1].tolist(),
        "canvas": rows.tolist(),
    }


def _places(estimate: Estimate, pixels: PointsNx2) -> PointsNx2:
    """Canvas places (n, 2) of a frame's pixels (n, 2)."""
    if estimate.homography is not None:
        return np.asarray(cv2.perspectiveTransform(pixels[None], np.array(estimate.homography))[0], dtype=np.float64)
    return canvas_from_pixels(estimate.pose, estimate.camera, on_plane(estimate.relief, estimate.camera, pixels))


def export_png(flight: Path, target: Path, *, island: int | None = None, level: int | None = None) -> str:
    """Write an island (by default the largest) as one image with alpha; returns a message."""
    chosen = chosen_island(find_flight(flight), island)
    bounds, finest = chosen["bounds"], chosen["maxzoom"]
    zoom = level_within(bounds, LARGEST_PICTURE, finest) if level is None else level
    left, top, right, bottom = pixel_bounds(bounds, zoom)
    if (right - left) * (bottom - top) > MOST_PIXELS:
        raise UsageError(
            f"A picture of level {zoom} would have {right - left} x {bottom - top} pixels; give a lower --zoom."
        )
    bgra = picture(flight, chosen["id"], bounds, zoom)
    with telling_where(target):
        write_beside(target, encode(".png", bgra, [cv2.IMWRITE_PNG_COMPRESSION, 1]))
    finer = f"; --zoom {finest} is the finest" if zoom < finest else ""
    return (
        f"island {chosen['id']} at level {zoom}, {bgra.shape[1]} x {bgra.shape[0]} pixels, written to {target}{finer}"
    )


def chosen_island(flight: Path, number: int | None) -> dict[str, Any]:
    """The entry of mosaic.json for an island, by default the largest."""
    islands = [one for one in told_islands(flight) if one.get("merged_into") is None]
    if not islands:
        raise UsageError(f"{flight} holds no picture: no frame was placed in this flight.")
    wanted = [i for i in islands if number is None or i["id"] == number]
    if not wanted:
        there = ", ".join(str(i["id"]) for i in islands) or "none"
        raise UsageError(f"There is no island {number} in {flight}; there are: {there}.")
    return max(wanted, key=lambda i: i["frames"])


@contextmanager
def telling_where(target: Path) -> Iterator[None]:
    """Turn failures to write the target into a UsageError."""
    try:
        yield
    except (OSError, sqlite3.Error, DiskFull) as error:
        why = getattr(error, "strerror", None) or error
        raise UsageError(f"{target} cannot be written ({why}); give another file.") from error

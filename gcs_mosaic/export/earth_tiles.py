"""The XYZ tiles of a map on earth, encoded, in the order in which a file wants them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from typing import Literal, TypeAlias

import cv2
import numpy as np

from gcs_mosaic.export.earth_map import EarthMap, check_mercator
from gcs_mosaic.geo.mercator import HALF_WORLD_M, TILE_SIZE, mercator, resolution_m
from gcs_mosaic.store.tiles import encode

TileFormat: TypeAlias = Literal["png", "webp", "jpg"]
Progress: TypeAlias = Callable[[int, int], None]  # how many of how many are done

MEDIA = {"png": "image/png", "webp": "image/webp", "jpg": "image/jpeg"}
QUALITY = 90  # of JPEG and WebP
THREADS = 2
AHEAD = 64  # tiles being made or waiting to be written


@dataclass(frozen=True, slots=True)
class EncodedEarthTile:
    z: int
    x: int
    y: int
    data: bytes


@dataclass(frozen=True, slots=True)
class TilePlan:
    """The tiles that a file is to hold: places in order, of these levels."""

    places: tuple[tuple[int, int, int], ...]  # z, x, y
    coarsest: int
    finest: int
    kind: TileFormat


def planned_tiles(found: EarthMap, kind: TileFormat, finest: int | None = None) -> TilePlan:
    """All tiles from the coarsest level on; `finest`: the finest one, at most that of the map's own pixels. Raises UsageError."""
    check_mercator(found)
    levels, last = found.pyramid.levels, found.finest_level(finest)
    assert levels is not None, "a map without an island is not exported"
    places = tuple(
        (z, x, y) for z in range(levels[0], last + 1) for x, y in found.pyramid.tiles(z) if _within(found, z, x, y)
    )
    return TilePlan(places, levels[0], last, kind)


def encoded_tiles(found: EarthMap, plan: TilePlan, progress: Progress) -> Iterator[EncodedEarthTile]:
    """The tiles on which something was seen, in the plan's order."""

    def made(place: tuple[int, int, int]) -> EncodedEarthTile | None:
        picture = found.pyramid.tile(*place)
        return None if picture is None else EncodedEarthTile(*place, encoded(picture, plan.kind))

    with ThreadPoolExecutor(THREADS, thread_name_prefix="export") as pool:
        waiting, left = [], iter(plan.places)
        waiting = [pool.submit(made, place) for place in islice(left, AHEAD)]
        for number in range(len(plan.places)):
            tile = waiting.pop(0).result()
            waiting += [pool.submit(made, place) for place in islice(left, 1)]
            progress(number + 1, len(plan.places))
            if tile is not None:
                yield tile


def encoded(picture: np.ndarray, kind: TileFormat) -> bytes:
    """A picture (h, w, 4), blue first. JPEG knows no transparency: what was not seen is white."""
    if kind == "png":
        return encode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 4])
    if kind == "webp":
        return encode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    share = picture[..., 3:].astype(np.float32) / 255
    flat = np.rint(picture[..., :3] * share + 255 * (1 - share)).astype(np.uint8)
    return encode(".jpg", flat, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def _within(found: EarthMap, z: int, x: int, y: int) -> bool:
    """Whether a tile has a part in the box."""
    if found.box is None:
        return True
    west, south, east, north = found.box
    (left, bottom), (right, top) = mercator(np.array([[west, south], [east, north]])).tolist()
    side = resolution_m(z) * TILE_SIZE
    tile_left, tile_top = x * side - HALF_WORLD_M, HALF_WORLD_M - y * side
    return bool(tile_left < right and tile_left + side > left and tile_top - side < top and tile_top > bottom)

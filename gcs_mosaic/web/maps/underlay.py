"""A map that the team brings, shown under the flight's where a program has no other map beside it.

An MBTiles file, or a folder z/x/y.png (.jpg, .jpeg); 256 px tiles of Web Mercator. Where a tile is missing its nearest ancestor
is enlarged. Files are taken as hostile: how large a tile may be and how long a question may take is limited, and what cannot be
read is missing.
"""

from __future__ import annotations

import logging
import os
import re
import sqlite3
import threading
from collections.abc import Collection
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.mercator import FINEST_LEVEL
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, ancestor
from gcs_mosaic.stitch.arrays import Bands, ImageBGRA
from gcs_mosaic.views.hole_filling import coarse_from_tile
from gcs_mosaic.web.maps.underlay_extent import Span, TileIndex, UnderlayExtent, extent_of

logger = logging.getLogger(__name__)

DEEPEST = 8  # levels between a tile and the ancestor that stands for it
LARGEST_BYTES = 2 << 20
LARGEST_PIXELS = 1024 * 1024
STEPS, MOST_STEPS = 1000, 200  # of SQLite's machine for one tile, a look between so many
MOST_NAMES = 5000  # of one folder that are looked at
SUFFIXES = (".png", ".jpg", ".jpeg")
NUMBER = re.compile("0|[1-9][0-9]{0,8}")
WANTED = "name an MBTiles file of PNG or JPEG tiles, or a folder z/x/y.png"


class TileFiles(TileIndex, Protocol):
    """Encoded tiles, from any source."""

    def data(self, tile: Tile) -> bytes | None:
        """None if there is none, or none that can be read."""


class Underlay:
    """Thread-safe."""

    def __init__(self, files: TileFiles) -> None:
        self._files = files

    @cached_property
    def extent(self) -> UnderlayExtent | None:
        """As it was when it was first asked for; None if it cannot be told."""
        return extent_of(self._files)

    def tile(self, level: int, x: int, y: int) -> ImageBGRA | None:
        """(256, 256, 4), opaque; None if neither the tile nor an ancestor of it is there."""
        wanted = Tile(level, x, y)
        for above in range(level, max(level - DEEPEST, 0) - 1, -1):
            data = self._files.data(ancestor(wanted, above))
            picture = None if data is None else decoded(data)
            if picture is not None:
                part = picture if above == level else enlarged(picture, wanted, above)
                return np.dstack([part, np.full((TILE_SIZE, TILE_SIZE), 255, np.uint8)])
        return None


def underlay_of(path: str | None) -> Underlay | None:
    """What the settings name. Raises UsageError if that is no map."""
    if path is None:
        return None
    place = Path(path)
    if place.is_dir():
        return Underlay(FolderOfTiles(place))
    try:
        return Underlay(MbtilesFile(place))
    except (sqlite3.Error, OSError) as error:
        raise UsageError(f"web: the underlay {path} cannot be used ({error}): {WANTED}") from error


class FolderOfTiles:
    """Files z/x/y.png and the like."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def data(self, tile: Tile) -> bytes | None:
        for suffix in SUFFIXES:
            path = self._root / str(tile.z) / str(tile.x) / f"{tile.y}{suffix}"
            try:
                if path.is_file() and path.stat().st_size <= LARGEST_BYTES:
                    return path.read_bytes()
            except OSError:
                logger.info("a tile of the underlay cannot be read", exc_info=True)
        return None

    def levels(self) -> list[int]:
        named = sorted(level for level in numbers_in(self._root) if level <= FINEST_LEVEL)
        return [level for level in named if self.columns(level) is not None]

    def columns(self, level: int) -> Span | None:
        return span_of(numbers_in(self._root / str(level)), level)

    def rows(self, level: int, column: int) -> Span | None:
        return span_of(numbers_in(self._root / str(level) / str(column), SUFFIXES), level)

    def told_bounds(self) -> str | None:
        return None


class MbtilesFile:
    """An MBTiles file, whose rows count from the south. Raises sqlite3.Error and OSError when it is opened."""

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise FileNotFoundError("there is no such file")
        uri = f"file:{quote(str(path.resolve()))}?mode=ro"
        self._file = sqlite3.connect(uri, uri=True, check_same_thread=False)
        self._lock = threading.Lock()
        self._steps = 0
        self._file.execute("PRAGMA trusted_schema = OFF")
        self._file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_BYTES)
        self._file.set_progress_handler(self._is_too_long, STEPS)
        self._file.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles LIMIT 0")

    def data(self, tile: Tile) -> bytes | None:
        row = (1 << tile.z) - 1 - tile.y
        question = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        found = self._first(question, tile.z, tile.x, row)
        return found if isinstance(found, bytes) else None

    def levels(self) -> list[int]:
        question = "SELECT 1 FROM tiles WHERE zoom_level = ? LIMIT 1"
        return [level for level in range(FINEST_LEVEL + 1) if self._first(question, level) is not None]

    def columns(self, level: int) -> Span | None:
        return self._span("tile_column", "zoom_level = ?", level)

    def rows(self, level: int, column: int) -> Span | None:
        found = self._span("tile_row", "zoom_level = ? AND tile_column = ?", level, column)
        last = (1 << level) - 1
        return None if found is None else (last - found[1], last - found[0])

    def told_bounds(self) -> str | None:
        found = self._first("SELECT value FROM metadata WHERE name = 'bounds'")
        return found if isinstance(found, str) else None

    def _span(self, name: str, where: str, level: int, *more: int) -> Span | None:
        """The least and the greatest number of a column of the table, by its index."""
        question = f"SELECT {name} FROM tiles WHERE {where} ORDER BY {name} "  # names of ours alone
        ends = [self._first(question + order, level, *more) for order in ("LIMIT 1", "DESC LIMIT 1")]
        return span_of([end for end in ends if isinstance(end, int)], level)

    def _first(self, question: str, *values: int) -> Any:
        """The first value of the first row; None if there is none, or none within the limits."""
        with self._lock:
            self._steps = 0
            try:
                found = self._file.execute(question, values).fetchone()
            except (sqlite3.Error, OverflowError):
                logger.info("the underlay cannot be read", exc_info=True)
                return None
        return None if found is None else found[0]

    def _is_too_long(self) -> int:
        self._steps += 1
        return int(self._steps > MOST_STEPS)


def span_of(numbers: Collection[int], level: int) -> Span | None:
    """The least and the greatest of those that a level can have."""
    within = [number for number in numbers if 0 <= number < 1 << level]
    return (min(within), max(within)) if within else None


def numbers_in(folder: Path, suffixes: Collection[str] = ("",)) -> set[int]:
    """The names in a folder that are numbers, with one of these suffixes; of its first names alone."""
    try:
        with os.scandir(folder) as entries:
            names = [Path(entry.name) for entry in islice(entries, MOST_NAMES)]
    except OSError:
        return set()
    return {int(name.stem) for name in names if name.suffix in suffixes and NUMBER.fullmatch(name.stem)}


def decoded(data: bytes) -> Bands | None:
    """A tile's pixels, BGR (256, 256, 3); None if it is no picture, or too large a one."""
    from gcs_mosaic.frames.decode import Unreadable, decode_image  # it loads what reads TIFFs

    image = None if len(data) > LARGEST_BYTES else decode_image(data, LARGEST_PIXELS)
    if image is None or isinstance(image, Unreadable) or image.shape[2] not in (1, 3) or min(image.shape[:2]) < 1:
        return None
    eight = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    three = eight if eight.shape[2] == 3 else np.repeat(eight, 3, axis=2)
    if three.shape[:2] == (TILE_SIZE, TILE_SIZE):
        return three
    return np.asarray(cv2.resize(three, (TILE_SIZE, TILE_SIZE), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def enlarged(picture: Bands, tile: Tile, level: int) -> Bands:
    """The part of an ancestor of this level that a tile covers."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = TILE_SIZE, TILE_SIZE
    whole = cv2.warpAffine(picture, coarse_from_tile(tile, level), size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(whole, dtype=np.uint8)

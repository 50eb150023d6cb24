"""The map in focus at the ground instead of the canopy, as tiles on the map's own grid.

Each is a pure function of the ledger, the originals and the focus. They are made when somebody looks there, in parts of 4 x 4
tiles, so that an original is decoded once for sixteen of them, and in pieces of work of one frame each, between which whoever
has them made can rest: the sum and the number of looks of each pixel are all that is kept of a part meanwhile (16 MB), however
many frames see it. What fewer than two looks see stays transparent.
"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.integral.chosen_looks import chosen
from gcs_mosaic.integral.flight_looks import Heights, ReadOriginal, read_look
from gcs_mosaic.integral.focal_plane import camera_height, pixels_at
from gcs_mosaic.integral.forms import LEAST_LOOKS
from gcs_mosaic.integral.ground_surface import GroundHeights, GroundSurface, Slowly
from gcs_mosaic.integral.kept_originals import KeptOriginals, KeptSlopes
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, laid_part
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import TILE_SIZE, Box, Tile, canvas_from_level
from gcs_mosaic.stitch.arrays import FloatImage, Matrix
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.flight_view import FlightView, FrameTable

SPAN = 4  # tiles along a side of a part
SIDE = SPAN * TILE_SIZE  # px
# For one part: at 80 ms each, reduced, they take half a minute. More are of a view from so far that nobody is to be seen in it.
MOST_FRAMES = 400
MOST_WANTED = 64  # parts: four screens of 2048 x 2048 px at once
KEPT_BYTES = 48 << 20  # of encoded tiles: some 200 parts
ASKED_S = 10.0  # a part that nobody has asked for in this time is not looked at any more
REST_S = 4.0  # before a part is made anew: each frame that comes touches those around
QUALITY = 85  # of WebP
FAILED = "A part of the map cannot be laid together: the log of the program tells why."
FROM_AFAR = "Too much of the map at once: move nearer to look through the trees."


class PartKey(NamedTuple):
    """Which part: `column`, `row` count parts of a level. `height`: of the focus everywhere, a share of the flying height above
    the map's ground; None: it is sought."""

    island: int
    z: int
    column: int
    row: int
    height: float | None

    @classmethod
    def of(cls, island: int, tile: Tile, height: float | None) -> PartKey:
        """That of a tile."""
        return cls(island, tile.z, tile.x // SPAN, tile.y // SPAN, height)

    @property
    def box(self) -> Box:
        edges = np.array([self.column, self.row, self.column + 1, self.row + 1], np.float64) * SIDE
        left, top, right, bottom = canvas_from_level(self.z, edges).tolist()
        return left, top, right, bottom

    @property
    def window(self) -> GroundWindow:
        left, top, right, bottom = self.box
        return GroundWindow((left + right) / 2, (top + bottom) / 2, right - left, SIDE)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPart:
    """`tiles`: WebP with alpha of those on which something is seen; `version`: counts up; `known`: in how many of the `cells` of
    ground that it lies on the height was found; `lost`: frames whose originals cannot be read; `trouble`: why there are none, and
    whether that `passes`, so that it is tried again."""

    version: int
    revision: int
    records: tuple[PositionRecord, ...]
    shows: int  # hash of how the frames are painted
    tiles: Mapping[Tile, bytes] = field(default_factory=dict)
    known: int = 0
    cells: int = 0
    lost: int = 0
    trouble: str = ""
    passes: bool = False
    made: float = field(default_factory=time.monotonic)

    @property
    def nbytes(self) -> int:
        return sum(map(len, self.tiles.values()))


class GroundTiles:
    """`step` is for one thread, everything else for any."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._surface = GroundSurface(view)
        self._originals = KeptOriginals()
        self._slopes = KeptSlopes()
        self._lock = threading.Lock()
        self._parts: OrderedDict[PartKey, GroundPart] = OrderedDict()  # asked for last last
        self._wanted: OrderedDict[PartKey, float] = (
            OrderedDict()
        )  # when asked for; in the order in which they are to be made
        self._work: tuple[PartKey, Slowly[GroundPart]] | None = None
        self._version = 0

    def want(self, keys: Iterable[PartKey]) -> None:
        """Somebody looks there; those in the middle of what he sees first."""
        now = time.monotonic()
        with self._lock:
            for key in keys:
                self._wanted[key] = now
                if key in self._parts:
                    self._parts.move_to_end(key)
            for key in [key for key, asked in self._wanted.items() if now - asked > ASKED_S]:
                del self._wanted[key]
            while len(self._wanted) > MOST_WANTED:
                self._wanted.popitem(last=False)

    def parts(self, keys: Sequence[PartKey]) -> list[tuple[PartKey, GroundPart | None, bool]]:
        """What there is of each, and whether it is to be made, anew or at all."""
        table = self._view.table()
        with self._lock:
            found = [(key, self._parts.get(key)) for key in keys]
        return [(key, part, part is None or part.passes or part.records != _records(table, key)) for key, part in found]

    def tile(self, island: int, tile: Tile, height: float | None) -> bytes | None:
        """As it was made last; None for nothing, or not yet."""
        with self._lock:
            part = self._parts.get(PartKey.of(island, tile, height))
        return None if part is None else part.tiles.get(tile)

    def step(self) -> bool:
        """A piece of work; False if there is nothing to do."""
        if self._work is None or not self._is_wanted(self._work[0]):
            key = self._next()
            self._work = None if key is None else (key, self._made(key))
        if self._work is None:
            return False
        key, work = self._work
        try:
            next(work)
        except StopIteration as done:
            self._work = None
            self._keep(key, done.value)
        except UsageError as error:  # the ledger is written anew, or gone
            self._work = None
            self._keep(key, replace(self._nothing(key, str(error)), passes=True))
        except Exception:
            self._work = None  # and not tried again before something has changed there
            self._keep(key, self._nothing(key, FAILED))
            raise
        return True

    def forget(self) -> None:
        """Nobody looks any more."""
        self._work = None
        self._surface.forget()
        self._originals.forget()
        self._slopes.forget()

    def _is_wanted(self, key: PartKey) -> bool:
        with self._lock:
            return time.monotonic() - self._wanted.get(key, -math.inf) <= ASKED_S

    def _next(self) -> PartKey | None:
        """What was never made, as it is wanted; then what is oldest, and of those that which fewest frames have seen."""
        now, table = time.monotonic(), self._view.table()
        with self._lock:
            wanted = [(key, self._parts.get(key)) for key, asked in self._wanted.items() if now - asked <= ASKED_S]
        for key, part in wanted:
            if part is None:
                return key
        old = [(part.revision, len(part.records), key, part) for key, part in wanted if part is not None]
        for *_, key, part in sorted(old, key=lambda one: one[:2]):
            if now - part.made >= REST_S and self._is_old(table, key, part):
                return key
        return None

    def _is_old(self, table: FrameTable, key: PartKey, part: GroundPart) -> bool:
        """Whether frames lie otherwise than they did, or are painted in another light, or what stood against it may have passed;
        else it is as new as the map."""
        if part.passes or part.revision == table.revision:
            return part.passes
        records = _records(table, key)
        if part.records != records or part.shows != self._shows(records):
            return True
        with self._lock:
            if self._parts.get(key) is part:
                self._parts[key] = replace(part, revision=table.revision)
        return False

    def _shows(self, records: Sequence[PositionRecord]) -> int:
        return hash(tuple(self._view.painted(one.number) for one in records[: MOST_FRAMES + 1]))

    def _keep(self, key: PartKey, part: GroundPart) -> None:
        with self._lock:
            self._version += 1
            self._parts[key] = replace(part, version=self._version)
            self._parts.move_to_end(key)
            kept = sum(one.nbytes for one in self._parts.values())
            while kept > KEPT_BYTES or len(self._parts) > KEPT_BYTES // (1 << 16):
                kept -= self._parts.popitem(last=False)[1].nbytes

    def _nothing(self, key: PartKey, trouble: str = "") -> GroundPart:
        table = self._view.table()
        records = _records(table, key)
        shows = 0 if trouble else self._shows(records)
        return GroundPart(version=0, revision=table.revision, records=records, shows=shows, trouble=trouble)

    def _made(self, key: PartKey) -> Slowly[GroundPart]:
        """Raises UsageError."""
        if len(records := _records(self._view.table(), key)) > MOST_FRAMES:
            return self._nothing(key, FROM_AFAR)
        nothing = self._nothing(key)
        if len(records := nothing.records) < LEAST_LOOKS:
            return nothing
        heights = yield from self._surface.over(key.island, key.box, key.height)
        seen = [(one.number, found) for one in records if (found := self._view.painted(one.number)) is not None]
        picture = _Sum(key.window, heights)
        lost = 0
        for index in chosen([painted for _, painted in seen], key.window):
            number, painted = seen[index]
            lost += int(not picture.add(self._view, number, self._slopes.of(number, painted), self._originals.read))
            yield
        tiles = picture.tiles(key)
        return replace(nothing, tiles=tiles, known=heights.known, cells=heights.cells, lost=lost)


class _Sum:
    """The looks of a window so far."""

    def __init__(self, window: GroundWindow, heights: GroundHeights) -> None:
        self._window = window
        self._heights = heights.at(window.lattice()[0])
        self._total: FloatImage = np.zeros((window.cells, window.cells, 3), np.float32)
        self._count: Matrix = np.zeros((window.cells, window.cells), np.float32)
        self._display = Display()

    def add(self, view: FlightView, number: int, painted: RenderItem, read: ReadOriginal) -> bool:
        """Lay a frame on the ground; False if its original cannot be read."""
        pixels = pixels_at(painted.pose, painted.camera, painted.relief, self._window.lattice()[0], self._heights)
        if not ((pixels > 0) & (pixels < [painted.camera.width, painted.camera.height])).all(axis=1).any():
            return True  # beside it, so that nothing needs to be read
        above = camera_height(painted.pose, painted.camera)
        within: Heights = (float(self._heights.min()) / above, float(self._heights.max()) / above)
        look = read_look(view, number, painted, self._window, within, read)
        if look is None:
            return False
        part = laid_part(_shown(look, painted), self._window, self._heights)
        if part is not None:
            self._display = painted.display
            self._count[part.where] += part.seen
            part.values[~part.seen] = 0
            self._total[part.where] += part.values
        return True

    def tiles(self, key: PartKey) -> dict[Tile, bytes]:
        """WebP of those on which two looks or more see something."""
        seen = self._count >= LEAST_LOOKS
        mean = self._total / np.maximum(self._count, 1)[..., None]
        shown = self._display.lightened(np.clip(mean + 0.5, 0, 255).astype(np.uint8))
        picture = np.dstack([shown, np.where(seen, 255, 0).astype(np.uint8)])
        picture[~seen] = 0
        found = {}
        for down, across in np.ndindex(SPAN, SPAN):
            part = picture[down * TILE_SIZE :, across * TILE_SIZE :][:TILE_SIZE, :TILE_SIZE]
            if part[..., 3].any():
                tile = Tile(key.z, key.column * SPAN + across, key.row * SPAN + down)
                data = cv2.imencode(".webp", np.ascontiguousarray(part), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1]
                found[tile] = data.tobytes()
        return found


def _shown(look: GroundLook, painted: RenderItem) -> GroundLook:
    """With the bands that the map shows, on the ground without its crowns."""
    shown = list(painted.display.shown)
    if look.image.shape[2] == 1 or (shown == [0, 1, 2] and look.image.shape[2] == 3):
        return replace(look, relief=painted.relief)
    return replace(look, image=np.ascontiguousarray(look.image[..., shown]), relief=painted.relief)


def _records(table: FrameTable, key: PartKey) -> tuple[PositionRecord, ...]:
    return tuple(table.frames[index] for index in table.near(key.island, key.box))

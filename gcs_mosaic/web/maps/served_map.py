"""The map on earth as it is now: which islands lie where, and its tiles, made once for all who ask."""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any, TypeVar

import numpy as np
from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geotiles.canvas_tiles import canvas_tile
from gcs_mosaic.geotiles.earth_islands import CanvasIsland, EarthIsland, canvas_islands, earth_islands
from gcs_mosaic.geotiles.pyramid import GeoPyramid
from gcs_mosaic.geotiles.shown_anchors import AnchorFollower, FittedIsland
from gcs_mosaic.geotiles.touched import touched
from gcs_mosaic.notes.anchors.anchoring import IslandAnchor
from gcs_mosaic.notes.anchors.pins import SetPin
from gcs_mosaic.notes.texts import shown as shown_name
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import ImageBGRA
from gcs_mosaic.store.reading import MOSAIC_NAME, read_document
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.tile_reader import EncodedTile
from gcs_mosaic.web.answered_tiles import near_painted
from gcs_mosaic.web.api.notes import Notes
from gcs_mosaic.web.change import Change
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.maps.pictures import MapLook, encoded_tile
from gcs_mosaic.web.maps.underlay import Underlay
from gcs_mosaic.web.recent_answers import RecentAnswers

logger = logging.getLogger(__name__)

LOOK_EVERY_S = (
    1.0  # at the anchors, while somebody asks; a change of the map or of pins is looked at by the next who asks
)
THREADS = 2
CANVAS_BYTES, ANSWER_BYTES = 32 << 20, 32 << 20
EACH_BYTES = 500  # of an answer without data
LONGEST_NAME = 40
UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class MapNow:
    """`flight`: its name in addresses; `unanchored`: islands that are shown nowhere else."""

    flight: str
    title: str
    revision: int
    anchor_revision: int
    pyramid: GeoPyramid
    unanchored: tuple[int, ...]

    @property
    def error_m(self) -> float | None:
        """How far off the worst corner of what is shown may be (95 %)."""
        return max((one.error_m for one in self.pyramid.islands), default=None)

    @property
    def token(self) -> str:
        """Another one whenever something looks different."""
        return f"{self.revision}.{self.anchor_revision}"


@dataclass(frozen=True, slots=True)
class TileKey:
    """A tile as it was answered; `laid`: the revision of the anchors."""

    laid: int
    level: int
    x: int
    y: int
    look: MapLook


class ServedMap:
    """Use its coroutines from one event loop, `forget` from any thread."""

    def __init__(self, view: FlightView, notes: Notes, feed: Feed, underlay: Underlay | None) -> None:
        self._view, self._notes, self._feed, self.underlay = view, notes, feed, underlay
        self._follower = AnchorFollower()
        self._pool = ThreadPoolExecutor(THREADS, thread_name_prefix="maps")
        self._looking = asyncio.Lock()
        self._known: tuple[object, float, MapNow] | None = None
        self._pinned: tuple[list[SetPin], bool] | None = None  # pins, and whether positions may lay the map
        self._named: str | None = None
        revision = partial(last_revision, view.root)
        self._canvas: RecentAnswers[tuple[int, Tile], ImageBGRA | None] = RecentAnswers(
            revision, lambda tile: EACH_BYTES if tile is None else tile.nbytes, CANVAS_BYTES, near_painted
        )
        self._answers: RecentAnswers[TileKey, EncodedTile] = RecentAnswers(
            revision, lambda tile: EACH_BYTES + len(tile.data), ANSWER_BYTES, self._spoilt
        )

    async def now(self) -> MapNow:
        """What is to be shown now."""
        async with self._looking:
            told = self._feed.revision, self._feed.notes
            if self._known is None or self._known[0] != told or time.monotonic() - self._known[1] > LOOK_EVERY_S:
                self._known = told, time.monotonic(), await self._looked()
            return self._known[2]

    async def _looked(self) -> MapNow:
        """Raises HTTPServiceUnavailable if the pins were never read; else those that were read last hold."""
        with suppress(web.HTTPServiceUnavailable):
            _, pins, by_positions = await self._notes.run(self._notes.pinned)
            self._pinned = pins, by_positions
        if self._pinned is None:
            raise web.HTTPServiceUnavailable(text="The notes, which hold the anchors, cannot be read now.\n")
        return await self.work(self._look, *self._pinned)

    async def tile(self, level: int, x: int, y: int, look: MapLook) -> EncodedTile:
        """An XYZ tile, transparent (or of the look's background) where nothing was seen."""
        changes = self._answers.changes
        now = await self.now()
        key = TileKey(now.anchor_revision, level, x, y, look)
        pyramid = now.pyramid if look.island is None else now.pyramid.only(look.island)
        make = partial(encoded_tile, pyramid, (level, x, y), look, self.underlay if look.underlay else None)
        return await self.work(self._answers.get, key, 0, make, changes)

    async def work(self, work: Callable[..., Result], *given: Any) -> Result:
        """On a thread of the maps' own."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, work, *given)

    def forget(self, change: Change) -> None:
        """Something was painted."""
        self._canvas.forget(change)  # first: what is made anew is made of it
        self._answers.forget(change)

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _look(self, pins: list[SetPin], by_positions: bool) -> MapNow:
        revision, title, there = self._told()
        laid = self._notes.islands(pins, by_positions)
        shown = self._follower.follow(fitted(there, laid))
        islands = earth_islands(there, shown.anchors)
        anchored = {one.id for one in islands}
        return MapNow(
            flight=self._flight(),
            title=shown_name(title),
            revision=revision,
            anchor_revision=shown.revision,
            pyramid=GeoPyramid(islands, self._canvas_tile),
            unanchored=tuple(one.id for one in there if one.id not in anchored),
        )

    def _told(self) -> tuple[int, str, tuple[CanvasIsland, ...]]:
        """Revision, the flight's name and its islands by mosaic.json; none while there is none that can be read."""
        try:
            document = read_document(self._view.root / MOSAIC_NAME)
            return int(document["revision"]), str(document["flight"]), canvas_islands(document)
        except FileNotFoundError:
            pass
        except (OSError, ValueError, KeyError, TypeError, OverflowError):
            logger.warning("mosaic.json cannot be read: nothing is shown on other maps", exc_info=True)
        return 0, self._view.root.resolve().name, ()

    def _flight(self) -> str:
        """The flight's name, and when it began: of two flights in one folder, one after the other, each has its own addresses."""
        if self._named is not None:
            return self._named
        try:
            record = self._view.flight()
        except UsageError:
            record = None
        if record is None:
            return safe_name(self._view.root.resolve().name)
        began = datetime.fromtimestamp(record.started_utc, UTC)
        self._named = f"{safe_name(record.name)}-{began:%Y%m%d-%H%M%S}"
        return self._named

    def _canvas_tile(self, island: EarthIsland, tile: Tile) -> ImageBGRA | None:
        make = partial(canvas_tile, self._view.root, island, tile)
        return self._canvas.get((island.id, tile), 0, make)

    def _spoilt(self, keys: Collection[TileKey], change: Change) -> Iterator[TileKey]:
        """The tiles that show something of what was painted."""
        islands = () if self._known is None else self._known[2].pyramid.islands
        painted: dict[int, list[Tile]] = {}
        for island, tile in change.painted or ():
            painted.setdefault(island, []).append(tile)
        levels: dict[int, list[TileKey]] = {}
        for key in keys:
            levels.setdefault(key.level, []).append(key)
        for level, its_keys in levels.items():
            places = np.array([(key.x, key.y) for key in its_keys])
            is_spoilt = np.zeros(len(its_keys), bool)
            for one in islands:
                is_spoilt |= touched(one, painted.get(one.id, []), level, places)
            yield from (its_keys[at] for at in np.flatnonzero(is_spoilt))


def fitted(islands: Collection[CanvasIsland], laid: Mapping[int, IslandAnchor]) -> dict[int, FittedIsland]:
    """How those islands are laid that have an anchor."""
    return {
        one.id: FittedIsland(found.anchor, one.box, given_by(found))
        for one in islands
        if (found := laid.get(one.id)) is not None and found.anchor is not None
    }


def given_by(laid: IslandAnchor) -> Hashable:
    """What people have said of it, which is shown at once when it changes."""
    return laid.by, *((pin.id, pin.pin.longitude_deg, pin.pin.latitude_deg, pin.pin.sigma_m) for pin in laid.pins)


def safe_name(name: str) -> str:
    """Of letters that need no quoting in an address."""
    return UNSAFE.sub("_", name)[:LONGEST_NAME] or "flight"

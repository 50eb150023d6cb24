"""What an open page is told: tiles that were painted. Changes for somebody slow are merged, so that memory is bounded."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Self

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.documents import compact
from gcs_mosaic.store.told_documents import Count

MOST_TILES = 5000  # pending for one slow reader; beyond that it must reload everything
PaintedTiles = frozenset[tuple[int, Tile]]  # (island, tile)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeEntry:
    """A message of /live: the map is at this revision."""

    revision: Count
    tiles: Annotated[Sequence[tuple[int, int, int, int]] | None, "island, z, x, y of what was painted; null: anything"]


@dataclass(frozen=True, slots=True)
class Change:
    """Tiles changed up to `revision`; `painted` is None where any may have changed.

    `painted` lists tiles at the level at which a frame was painted: their ancestors were refreshed with them, and finer
    tiles below may be filled from them.
    """

    revision: int
    painted: PaintedTiles | None

    @classmethod
    def of_frame(cls, revision: int, tiles: Iterable[tuple[int, Tile]] | None) -> Self:
        """The tiles that painting one frame changed (None: any); refreshed ancestors among them are left out."""
        return cls(revision, None if tiles is None else finest(tiles))

    def after(self, earlier: Change | None) -> Change:
        """This change merged with an earlier one."""
        if earlier is None:
            return self
        if self.painted is None or earlier.painted is None:
            return Change(self.revision, None)
        both = self.painted | earlier.painted
        return Change(self.revision, both if len(both) <= MOST_TILES else None)

    @property
    def event(self) -> str:
        """The server-sent event."""
        return f"data: {self.json()}\n\n"

    def json(self) -> str:
        """The message to a page."""
        tiles = None if self.painted is None else [(island, *tile) for island, tile in sorted(self.painted)]
        return compact(ChangeEntry(revision=self.revision, tiles=tiles))


@dataclass(frozen=True, slots=True)
class NotesChange:
    """An event `notes` of /live: what people have added is at this revision."""

    revision: Count

    @property
    def event(self) -> str:
        """The server-sent event."""
        return f"event: notes\ndata: {compact(self)}\n\n"


@dataclass(frozen=True, slots=True)
class Alive:
    """An event `alive` of /live: there is no change, and the connection is whole."""

    @property
    def event(self) -> str:
        """The server-sent event."""
        return f"event: alive\ndata: {compact(self)}\n\n"


@dataclass(frozen=True, slots=True)
class Farewell:
    """An event `ended` of /live: the server ends."""

    @property
    def event(self) -> str:
        """The server-sent event."""
        return f"event: ended\ndata: {compact(self)}\n\n"


def finest(tiles: Iterable[tuple[int, Tile]]) -> PaintedTiles:
    """The tiles without a child among them."""
    every = frozenset(tiles)
    parents = {(island, tile.parent) for island, tile in every}
    return every - parents

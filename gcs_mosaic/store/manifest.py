"""The output folder's documents, revision by revision: mosaic.json, written after the frame lists (format 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_mosaic.render.tile_grid import TILE_SIZE
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.documents import iso_utc, write_json
from gcs_mosaic.store.held_out import held_out_entry
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.placements import Placements
from gcs_mosaic.store.records import Accounts
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.store.told_documents import FORMAT, IslandDocument, MosaicDocument


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandEntry:
    """One island as readers see it. A merged one stays listed, so that a reader knows which island now has its tiles."""

    id: int
    bounds: tuple[float, float, float, float]  # left, top, right, bottom in canvas units
    minzoom: int  # coarsest level with tiles
    maxzoom: int  # finest level with tiles
    frames: int
    merged_into: int | None = None
    held_out: HeldOut | None = None  # held-out error; None while unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """Everything published at one revision; for frames, only the news."""

    flight: str
    updated_utc: float
    islands: Sequence[IslandEntry]
    accounts: Accounts
    frames: FrameNews


class Manifest:
    """Writes the documents of one output folder; the revision increases with every write, also across restarts."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.revision = last_revision(out)
        self._given = self.revision  # includes failed writes: readers may have seen parts of them
        self._placements = Placements(out)
        self._told: Contents | None = None

    def write(self, contents: Contents, *, everything: bool = False) -> int:
        """Write the frame news (all frames if `everything`), then mosaic.json; returns the new revision.

        After DiskFull the old revision stays, and the news must be passed again.
        """
        self._given += 1
        self._placements.write(self._given, contents.frames, everything=everything)
        write_json(self.out / "mosaic.json", mosaic_document(contents, self._given))
        self.revision, self._told = self._given, contents
        return self.revision

    def write_accounts(self, accounts: Accounts, utc: float) -> None:
        """Write mosaic.json with newer accounts: nothing else has changed, and the revision stays. Raises DiskFull."""
        if self._told is not None:
            self._told = replace(self._told, accounts=accounts, updated_utc=utc, frames=FrameNews())
            write_json(self.out / "mosaic.json", mosaic_document(self._told, self.revision))

    def begin_anew(self) -> None:
        """The documents may be gone: write them whole next time."""
        self._placements.begin_anew()

    def catch_up(self) -> None:
        """Bring placements.json up to this revision. Raises DiskFull."""
        self._placements.catch_up()

    def close(self) -> None:
        """Stop writing."""
        self._placements.close()


def mosaic_document(contents: Contents, revision: int) -> MosaicDocument:
    """The content of mosaic.json."""
    return MosaicDocument(
        format=FORMAT,
        flight=contents.flight,
        revision=revision,
        tile_size=TILE_SIZE,
        islands=[island_entry(island) for island in contents.islands],
        events=contents.accounts.events,
        frames=contents.accounts.frames,
        orphans=contents.accounts.orphans,
        updated=iso_utc(contents.updated_utc),
    )


def island_entry(island: IslandEntry) -> IslandDocument:
    left, top, right, bottom = map(float, island.bounds)
    return IslandDocument(
        id=island.id,
        bounds=(left, top, right, bottom),
        minzoom=island.minzoom,
        maxzoom=island.maxzoom,
        frames=island.frames,
        held_out_px=held_out_entry(island.held_out) if island.held_out else None,
        tiles=f"tiles/{island.id}/{{z}}/{{x}}/{{y}}.jpg",
        merged_into=island.merged_into,
    )

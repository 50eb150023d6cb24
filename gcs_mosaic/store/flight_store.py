"""A flight on disk: accepts frames, collects changes, saves them; a full disk is waited for here.

Changes are collected in memory; `save` writes a consistent set of them: ledger, tiles, documents.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from gcs_mosaic.messages import DamagedFile, DroppedFrame, Frame, Notice, OtherFile, Topic
from gcs_mosaic.render.compositor import CompositorSettings
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent, RenderItem, TileKey
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.graph.placement import Covered, Placement
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.stitch.transaction import Kept, Snapshot
from gcs_mosaic.store import inside
from gcs_mosaic.store.changes import Changes
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.documents import finite
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lost_originals import Elsewhere, LostOriginals
from gcs_mosaic.store.manifest import Contents, IslandEntry, Manifest
from gcs_mosaic.store.originals import (
    KeptOriginal,
    NotKept,
    Originals,
    OriginalsSettings,
    is_intact,
    place_of,
    read_intact,
    relative_place,
)
from gcs_mosaic.store.records import (
    Accounts,
    Estimate,
    FlightRecord,
    FrameRecord,
    FrameState,
    IslandRecord,
)
from gcs_mosaic.store.retry import Retry, at_once
from gcs_mosaic.store.rewritten import RewrittenFiles
from gcs_mosaic.store.stages import stage
from gcs_mosaic.store.tiles import TileSettings, TileWriter, remove_strays, tile_path

logger = logging.getLogger(__name__)


class TileSource(Protocol):
    """The painted map as tiles; see `render.compositor.TileCompositor`."""

    def tile_later(self, island: int, tile: Tile) -> Callable[[], TilePicture | None]: ...
    def extent(self, island: int) -> Extent | None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreHooks:
    """What a store asks of the program around it, and tells it.

    `published(revision, tiles)` is called once tiles are on disk. `utc` returns the time written into documents, in seconds
    since 1970. `retry` runs every write and may repeat it; its exceptions propagate. `elsewhere`: see `LostOriginals`.
    `may_write`: whether the folder is ours now; called from any thread.
    """

    published: Callable[[int, Iterable[TileKey]], None] = lambda revision, tiles: None
    utc: Callable[[], float] = time.time
    retry: Retry = at_once
    elsewhere: Elsewhere = lambda name: None
    may_write: Callable[[], bool] = lambda: True


class FlightStore(Kept):
    """Owns one output folder, which is empty or holds a flight to resume. For use by one thread.

    `canvas`: how the flight is painted. Writes to the folder cannot be rolled back, so nothing is written while a frame is
    processed.
    """

    FIXED = frozenset(
        {
            "out",
            "ledger",
            "flight",
            "canvas",
            "_originals",
            "_lost",
            "_tiles",
            "_manifest",
            "_rewritten",
            "_published",
            "_utc",
            "_retry",
            "_regained",
            "_may_write",
        }
    )

    def __init__(
        self,
        out: Path,
        *,
        originals: OriginalsSettings | None = None,
        tiles: TileSettings | None = None,
        canvas: CompositorSettings | None = None,
        around: StoreHooks | None = None,
    ) -> None:
        around = around or StoreHooks()
        self.out = out
        self.ledger = Ledger(out / LEDGER_NAME)
        self.canvas = canvas or CompositorSettings()
        self.flight = self.ledger.flight() or self._begin_flight(around.utc())
        self._changes = Changes()
        self.taken_in = 0  # files accepted, whatever their outcome
        self.in_a_pause = False  # or at the end: list every frame now, as no further save may follow
        self._originals = Originals(out, originals)
        self._lost = LostOriginals(self._originals, around.elsewhere)
        self._tiles = TileWriter(out, tiles)
        self._manifest = Manifest(out)
        self._published, self._utc = around.published, around.utc
        self._retry, self._may_write = around.retry, around.may_write
        self._orders: dict[str, int] = {}  # arrival order, by frame name
        self._places: dict[str, tuple[Path, str]] = {}  # original and content hash by frame name
        self._names: dict[str, str] = {}  # first frame's name by content hash, and by the hash of its picture
        self._pictures: dict[str, str] = {}  # hash of its picture by frame name, where it is known
        self._unreadable: set[str] = set()  # frames that came whole, as it seemed, and could not be decoded
        self._rewritten = RewrittenFiles()
        self._vehicles: dict[str, int] = {}  # of frames whose aircraft is known, by name
        self._told: Accounts | None = None  # as last written to the documents: events change them without any frame
        self._islands_known = 0
        self._regained: list[str] = []
        self._extents: dict[int, Extent] = {}  # a merged island is reported with its last extent

    def _begin_flight(self, utc: float) -> FlightRecord:
        flight = FlightRecord(name=self.out.resolve().name, started_utc=utc, canvas=self.canvas)
        self.ledger.begin_flight(flight)
        return flight

    def saved(self) -> Snapshot:
        """State missing from the ledger, see `resume`: it has no arrival order for frames that first arrived damaged."""
        return {"_orders": self._orders, "_extents": self._extents}

    def resume(self, processed: Collection[str], placed: Collection[str], covered: Collection[str] = ()) -> list[Frame]:
        """Resume the folder's flight, in which `processed` frames were processed, and these have a place. Call after `load`.

        Returns the frames still to be processed, as kept, in order of arrival.
        """
        frames = self.ledger.frames()
        known = [frame for frame in frames if frame.content_hash is not None and frame.state not in SET_ASIDE]
        self.taken_in = len(frames)
        for frame in known:  # arrived after the saved state
            self._orders.setdefault(frame.name, len(self._orders))
        known.sort(key=lambda frame: self._orders[frame.name])
        self._names = {frame.content_hash: frame.name for frame in known if frame.content_hash is not None}
        kept = [frame_of(frame, self.out) for frame in known]
        self._places = {frame.name: (frame.path, frame.content_hash) for frame in kept}
        self._vehicles = {frame.name: frame.vehicle for frame in known if frame.vehicle is not None}
        self._islands_known = len(self.ledger.islands())
        again = [frame for frame in kept if frame.name not in processed]
        self._retry(lambda: self.ledger.process_again([frame.name for frame in again], placed, covered))
        for frame in known:
            if frame.width is not None and frame.height is not None:
                self._changes.sizes[frame.name] = (frame.width, frame.height)
            if frame.sharpness is not None:
                self._changes.sharpness[frame.name] = frame.sharpness
        return again

    def tell_whole(
        self,
        placements: Iterable[Placement],
        painted: Iterable[RenderItem],
        covered: Iterable[Covered],
        waiting: Iterable[str],
    ) -> None:
        """Take the whole map of a resumed flight for changed, so that the next `save` tells all of it. Call after `resume`."""
        changes = self._changes
        changes.placements = {placement.name: placement for placement in placements}
        changes.painted = {one.name: one for one in painted}
        changes.covered = {one.name: one for one in covered}
        changes.states = {
            **dict.fromkeys(changes.placements, (FrameState.PLACED, None)),
            **dict.fromkeys(changes.covered, (FrameState.COVERED, None)),
            **dict.fromkeys(waiting, (FrameState.WAITING, None)),
            **{frame.name: (frame.state, frame.reason) for frame in self.ledger.frames(FrameState.REJECTED)},
        }

    def remove_tiles_but(self, known: Collection[TileKey]) -> None:
        """Remove all other tiles: written just before a kill, or awaiting a repaint at that time."""
        self._retry(lambda: remove_strays(self.out, known))
        self._tiles.there = set(known)

    @property
    def revision(self) -> int:
        return self._manifest.revision

    def accounts(self) -> Accounts:
        return self.ledger.accounts()

    # Arrivals

    def keep_ahead(self, frame: Frame) -> Frame:
        """Keep the original of a frame to be accepted later; callable from any thread. Returns the frame as kept.

        The frame is stitched from the file as found, whatever happens to that file afterwards.
        """
        if frame.content_hash in self._names or not self._may_write():
            return frame
        same = self._names.get(frame.picture or "")
        if same is None:
            return self._originals.keep_ahead(frame)
        if frame.earlier is None or self.known_as(frame.earlier) != same:  # a duplicate in other bytes
            return frame
        return replace(self._originals.keep_ahead(replace(frame, name=same)), name=frame.name)

    def accept(self, frame: Frame) -> tuple[Frame | None, list[Notice]]:
        """Keep a frame's original and record both; returns the frame as kept, and notices for the operator.

        None if the same image arrived before.
        """
        self.taken_in += 1
        earlier = self.shown_by(frame)
        if earlier is not None:
            self._retry(lambda: self._record_as(frame, FrameState.DUPLICATE, f"the same picture as {earlier}"))
            logger.info("%s: duplicate, the same picture as %s", frame.name, earlier)
            return None, []
        self.in_a_pause = False
        kept, said = self._retry(lambda: self._keep(frame))
        self._note_identity(frame, frame.name)
        self._orders[frame.name] = len(self._orders)
        self._places[frame.name] = (kept.path, frame.content_hash)
        if frame.vehicle is not None:
            self._vehicles[frame.name] = frame.vehicle
        return kept, said

    def shown_by(self, frame: Frame) -> str | None:
        """The frame that showed this one's picture first; None if no other did."""
        name = self._names.get(frame.content_hash) or self._names.get(frame.picture or "")
        return None if name == frame.name else name

    def was_unreadable(self, name: str) -> bool:
        """Whether this frame could not be decoded."""
        return name in self._unreadable

    def known_as(self, name: str) -> str | None:
        """The frame that this one is, if its file was written again with the same picture; None for no frame of this flight."""
        name = self._rewritten.first(name)
        return name if name in self._places else None

    def has_picture(self, name: str, picture: str) -> bool | None:
        """Whether this frame shows that picture, see `Frame`; None if it is not known since a restart."""
        known = self._pictures.get(name)
        return None if known is None else known == picture

    def take_new_bytes(self, frame: Frame, name: str) -> None:
        """Take what came as `frame`, the same picture as the frame `name` in other bytes, for the original of that."""
        self._rewritten.note(frame.name, name)
        if frame.content_hash != self.content_hash(name):  # the same bytes: it is known since before a restart
            self._retry(lambda: self._keep_new_bytes(replace(frame, name=name)))
            logger.info("%s was written again with the same picture: its original is that file now", name)
        self._note_identity(frame, name)

    def _keep_new_bytes(self, frame: Frame) -> None:
        old, _ = self._places[frame.name]
        kept = self._originals.keep(frame)
        path = None if isinstance(kept, NotKept) else self.out / kept.path
        with self.ledger.transaction():
            self.ledger.record_new_bytes(frame)
            if isinstance(kept, NotKept):
                self.ledger.forget_original(frame.name)
            else:
                self.ledger.record_original(frame.name, kept.path)
        self._lost.forget(frame.name)
        if path is None:
            self._lost.add([frame])
        self._places[frame.name] = path or frame.path, frame.content_hash
        if path != old:
            self._rewritten.outdated(frame.name, old)

    def _note_identity(self, frame: Frame, name: str) -> None:
        self._names[frame.content_hash] = name
        if frame.picture is not None:
            self._names[frame.picture] = name
            self._pictures[name] = frame.picture

    def accept_dropped(self, dropped: DroppedFrame) -> None:
        """Record a stream frame dropped for lack of space."""
        self.taken_in += 1
        self._retry(lambda: self._record_as(dropped.frame, FrameState.DROPPED, dropped.reason))
        logger.info("%s: dropped, %s", dropped.frame.name, dropped.reason)

    def accept_other(self, other: OtherFile) -> None:
        """Record a file of a camera that is not mapped; its file stays where it is."""
        self._retry(lambda: self.ledger.record_other(other))
        logger.info("%s: of the camera %s, which is not mapped", other.frame.name, other.camera or "that is left out")

    def note_beside(self, name: str, what: str) -> None:
        """The frame `name` is of a shot whose frame is another one, a smaller preview for instance."""
        if name in self._places:
            self._retry(lambda: self.ledger.record_beside(name, what))

    def accept_damaged(self, damaged: DamagedFile) -> None:
        """Record an incomplete file."""
        self.taken_in += 1
        self._retry(lambda: self.ledger.record_damaged(damaged))
        logger.info("%s: damaged, %s", damaged.name, damaged.reason)

    def adopt(self, frame: Frame, state: FrameState, reason: str | None) -> None:
        """Take in a frame of another flight, whose original is at `frame.path`, with what became of it there. Call `resume` after
        the last one."""
        with self.ledger.transaction():
            kept, _ = self._keep(frame)
            if reason is not None:
                self.ledger.settle_frame(kept.name, state, reason)

    def may_come_again(self, frame: Frame) -> None:
        """Do not treat the same image as a duplicate if it arrives again: this one could not be read."""
        self._names.pop(frame.content_hash, None)
        self._names.pop(frame.picture or "", None)
        self._unreadable.add(frame.name)

    # After the folder was made anew

    def write_again(self) -> int:
        """Mark all tiles and documents as unsaved, and seek the originals that are gone, first those of frames still to be
        processed; returns the number of others. May be repeated."""
        self._originals.forget_lost()
        kept = [frame for frame in self.ledger.frames() if frame.original is not None]
        gone = [frame for frame in kept if not inside.is_file(self.out / str(frame.original), self.out)]
        with self.ledger.transaction():
            for frame in gone:
                self.ledger.forget_original(frame.name)
        self._lost.add(frame_of(frame, self.out) for frame in gone if frame.state is not FrameState.PENDING)
        for frame in gone:
            if frame.state is FrameState.PENDING:
                self._keep_again(frame_of(frame, self.out))
        self._changes.tiles.append(frozenset(self._tiles.there))
        self._manifest.begin_anew()
        self._told = None
        return len(gone)

    def lacks_files(self) -> bool:
        """Whether a file that was written is gone: an original or a tile."""
        kept = (self.out / str(frame.original) for frame in self.ledger.frames() if frame.original is not None)
        tiles = (tile_path(self.out, island, tile) for island, tile in self._tiles.there)
        return not all(inside.is_file(path, self.out) for path in (*kept, *tiles))

    def keep_lost(self, now: float) -> list[Notice]:
        """Keep one original that is not kept, if it is due and found. For pauses."""
        if not self._lost.is_due(now):
            return []
        frame, kept = self._retry(lambda: self._lost.next(now))
        if isinstance(kept, KeptOriginal):
            path = kept.path
            self._retry(lambda: self._note_original(frame, path))
            self._regained.append(frame.name)
        return [kept.notice] if kept is not None and kept.notice else []

    def take_regained(self) -> list[str]:
        """Frames whose originals are kept again since the last call: tiles may have waited for them."""
        taken, self._regained = self._regained, []
        return taken

    def seek_originals_now(self) -> None:
        """Try all that are not kept once more, without a pause."""
        self._lost.seek_now()

    def not_kept(self) -> list[str]:
        """Frames whose originals are sought still."""
        return self._lost.names

    def seeks_originals(self, now: float) -> bool:
        """Whether `keep_lost` has something to do."""
        return self._lost.is_due(now)

    def found_again(self, frame: Frame) -> Frame | None:
        """The frame where its file is now, if it can be read; None if not."""
        if is_intact(frame.path, frame.content_hash, self._root_of(frame.path)):
            return frame
        path = self._lost.found(frame)
        return None if path is None else replace(frame, path=path)

    def _keep_again(self, frame: Frame) -> None:
        kept = self._lost.keep(frame)
        if isinstance(kept, KeptOriginal):
            self._note_original(frame, kept.path)
        else:
            self._lost.add([frame])

    def _note_original(self, frame: Frame, path: str) -> None:
        self.ledger.record_original(frame.name, path)
        self._places[frame.name] = (self.out / path, frame.content_hash)

    # Queries

    def order_of(self, name: str) -> int:
        """A frame's position in the order of arrival, from 0."""
        return self._orders[name]

    def original(self, name: str) -> bytes | None:
        """The frame's original file, or the camera's, if that is the same; None if both are missing or have changed. Raises
        CannotWrite while the folder is not there."""
        path, digest = self._places[name]
        data = read_intact(path, digest, self._root_of(path)) or self._lost.read(name, digest)
        if data is None and not self._may_write():
            raise CannotWrite(f"{self.out} is not there now")
        return data

    def _root_of(self, path: Path) -> Path | None:
        """This flight's folder for what is kept in it; None for what is still the camera's, or another flight's."""
        return self.out if path.is_relative_to(self.out) else None

    def content_hash(self, name: str) -> str:
        """Of a frame's original."""
        return self._places[name][1]

    # Changes

    def settle(self, name: str, state: FrameState, reason: str | None) -> None:
        """Note a frame's outcome."""
        if self._changes.states.get(name) != (state, reason):
            fields = {"frame": name, "state": state, "reason": reason}
            logger.info("%s: %s%s", name, state, f", {reason}" if reason else "", extra={"fields": fields})
        self._changes.states[name] = (state, reason)

    def settle_unstitched(self) -> int:
        """The flight ends: note the frames whose turn has not come, so that none stays pending; returns their number."""
        left = self.ledger.frames(FrameState.PENDING)
        for frame in left:
            self.settle(frame.name, FrameState.UNSTITCHED, "the flight was ended before its turn")
        return len(left)

    def note_measured(self, name: str, size: tuple[int, int], sharpness: float) -> None:
        """Note a frame's width and height in pixels, and how sharp it is."""
        self._changes.sizes[name], self._changes.sharpness[name] = size, sharpness

    def note_placed(self, placements: Iterable[Placement]) -> None:
        """Note where frames lie that are new on the map or have moved."""
        self._changes.placements |= {placement.name: placement for placement in placements}

    def note_covered(self, covered: Covered) -> None:
        """Note that a placed frame covers a new one; pages are told although no tile changes."""
        self._changes.covered[covered.name] = covered
        self._changes.tiles.append(frozenset())

    def note_replaced(self, covered: Covered, size: tuple[int, int]) -> None:
        """Note that a frame of this width and height, placed before, is covered from now on."""
        self._changes.sizes[covered.name] = size
        self._changes.placements.pop(covered.name, None)
        self._changes.painted.pop(covered.name, None)
        self.note_covered(covered)

    def note_painted(self, painted: RenderItem) -> None:
        """Note how a frame is painted now."""
        self._changes.painted[painted.name] = painted

    def note_tiles(self, tiles: Iterable[TileKey]) -> None:
        """Note that these tiles changed in one processing step."""
        self._changes.tiles.append(frozenset(tiles))

    def save(
        self,
        picture: TileSource,
        islands: Sequence[IslandRecord],
        frames_on: Mapping[int, int],
        held_out: Callable[[], Mapping[int, HeldOut]] = dict,
    ) -> None:
        """Write all changes: the ledger, then the tiles, then the documents, so that a kill in between leaves no tile unknown to
        the ledger, and no document refers to missing data.

        If anything is raised, the changes remain for the next call.
        """
        self._retry(lambda: self._save(picture, islands, frames_on, held_out))
        self._rewritten.remove_outdated(self.out / "frames", self.ledger.frames)

    def tell_accounts(self) -> None:
        """Bring the accounts in mosaic.json up to the ledger's, which `save` does only with the next frame."""
        accounts = self.ledger.accounts()
        if self._told is not None and accounts != self._told:
            self._retry(lambda: self._manifest.write_accounts(accounts, self._utc()))
            self._told = accounts

    def close(self) -> None:
        """Release all resources; unsaved changes are lost."""
        self._manifest.close()
        self._tiles.close()
        self.ledger.close()

    # Writing

    def _record_as(self, frame: Frame, state: FrameState, reason: str) -> None:
        with self.ledger.transaction():
            self.ledger.record_frame(frame)
            self.ledger.settle_frame(frame.name, state, reason)

    def _keep(self, frame: Frame) -> tuple[Frame, list[Notice]]:
        kept = self._originals.keep(frame)
        with self.ledger.transaction():
            self.ledger.record_frame(frame)
            if frame.recorded is not None:
                self.ledger.record_position(frame.name, frame.recorded)
            if not isinstance(kept, NotKept):
                self.ledger.record_original(frame.name, kept.path)
        said = [kept.notice] if kept.notice else []
        if not isinstance(kept, NotKept):
            return replace(frame, path=self.out / kept.path), said
        self._lost.add([frame])
        text = f"{frame.name} is not kept: {kept.reason}"
        logger.info("%s", text)
        if not kept.for_lack_of_room:  # that is said once for all
            said.append(Notice(source="originals", level="warning", text=text, topic=Topic.DISK))
        return frame, said

    def _save(
        self,
        picture: TileSource,
        islands: Sequence[IslandRecord],
        frames_on: Mapping[int, int],
        held_out: Callable[[], Mapping[int, HeldOut]],
    ) -> None:
        if not self._changes and self.ledger.accounts() == self._told:
            if self.in_a_pause:
                self._manifest.catch_up()
            return
        of = ", ".join(self._changes.states)
        with stage("ledger", of):
            placements, vehicles = self._changes.placements.values(), self._vehicles
            estimates = [estimate_of_placement(one, vehicles.get(one.name)) for one in placements]
            self._save_ledger(islands, estimates)
            self.ledger.make_durable()  # no document is ahead of the ledger even after a power cut
        with stage("tiles", of):
            self._tiles.write(set().union(*self._changes.tiles), picture.tile_later)
        with stage("documents", of):
            self._tell(picture, islands, frames_on, held_out, estimates)
        self._changes = Changes()

    def _tell(
        self,
        picture: TileSource,
        islands: Sequence[IslandRecord],
        frames_on: Mapping[int, int],
        held_out: Callable[[], Mapping[int, HeldOut]],
        estimates: Sequence[Estimate],
    ) -> None:
        """Write the documents, if anything in them changed."""
        accounts = self.ledger.accounts()
        if self._changes.is_public or accounts != self._told:
            entries = list(self._entries(picture, islands, frames_on, held_out()))
            revision = self._manifest.write(self._contents(entries, accounts, estimates), everything=self.in_a_pause)
            self._told = accounts
            for changed in self._changes.tiles:
                self._published(revision, changed)

    def _save_ledger(self, islands: Sequence[IslandRecord], estimates: Sequence[Estimate]) -> None:
        changes = self._changes
        with self.ledger.transaction():
            for island in islands[self._islands_known :]:
                self.ledger.record_island(island.id)
            for island in islands:
                if island.merged_into is not None:
                    self.ledger.merge_island(island.id, island.merged_into)
            for name, (width, height) in changes.sizes.items():
                self.ledger.record_size(name, width, height, changes.sharpness.get(name))
            for name, (state, reason) in changes.states.items():
                self.ledger.settle_frame(name, state, reason)
            self.ledger.record_estimates(estimates)
            for covered in changes.covered.values():
                self.ledger.record_covered(covered.name, covered.by, covered.by_from_frame)
            for painted in changes.painted.values():
                self.ledger.record_painted(painted)
        # A resumed flight's ledger may have more islands than have been found again so far.
        self._islands_known = max(self._islands_known, len(islands))

    def _contents(self, islands: list[IslandEntry], accounts: Accounts, estimates: Sequence[Estimate]) -> Contents:
        newest_of = self.ledger.newest_of_aircraft() if self._vehicles else {}
        return Contents(
            flight=self.flight.name,
            updated_utc=self._utc(),
            islands=islands,
            accounts=accounts,
            frames=self._changes.news(estimates, self.ledger.newest_on_map(), newest_of, self._vehicles),
        )

    def _entries(
        self,
        picture: TileSource,
        islands: Sequence[IslandRecord],
        frames_on: Mapping[int, int],
        held_out: Mapping[int, HeldOut],
    ) -> Iterator[IslandEntry]:
        for island in islands:
            extent = picture.extent(island.id) or self._extents.get(island.id)
            if extent is not None:
                self._extents[island.id] = extent
                yield IslandEntry(
                    id=island.id,
                    bounds=extent.box,
                    minzoom=extent.coarsest,
                    maxzoom=extent.finest,
                    frames=frames_on.get(island.id, 0),
                    merged_into=island.merged_into,
                    held_out=held_out.get(island.id),
                )


# Frames that will not be placed.
SET_ASIDE = (FrameState.DUPLICATE, FrameState.DROPPED, FrameState.DAMAGED)


def frame_of(record: FrameRecord, out: Path) -> Frame:
    """A frame as kept, as it was when it arrived."""
    assert record.content_hash is not None, "a frame has come whole"
    return Frame(
        name=record.name,
        path=place_of(out, record.original or "") or out / relative_place(record.name),
        content_hash=record.content_hash,
        size=record.size or 0,
        received=record.received or 0.0,
        modified=record.modified or 0.0,
        vehicle=record.vehicle,
    )


def estimate_of_placement(placement: Placement, vehicle: int | None = None) -> Estimate:
    return Estimate(
        name=placement.name,
        island=placement.island,
        pose=placement.pose,
        camera=placement.camera,
        relief=placement.relief,
        inliers=placement.inliers,
        residual_px=finite(placement.residual_px),
        neighbours=len(placement.neighbours),
        hops=placement.hops,
        corner_deviation_px=finite(placement.corner_deviation_px),
        homography=placement.homography,
        vehicle=vehicle,
        focal_log_deviation=None if placement.focal_log_deviation is None else finite(placement.focal_log_deviation),
    )

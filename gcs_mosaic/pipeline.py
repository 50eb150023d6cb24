"""A frame's way through the program, and what is written about it: the same for a live flight and for a folder of frames.

Everything is changed in memory first and then written by `save`, which may be called again when the disk was full.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.config import Config
from gcs_mosaic.events import DamagedFile, Frame, Notice
from gcs_mosaic.flight.folder import LEDGER_NAME
from gcs_mosaic.flight.ledger import Ledger
from gcs_mosaic.flight.manifest import Contents, IslandEntry, Manifest
from gcs_mosaic.flight.originals import NotKept, Originals, is_intact
from gcs_mosaic.flight.records import Accounts, Estimate, FlightRecord, FrameState
from gcs_mosaic.flight.tiles import TileWriter
from gcs_mosaic.frames.load import Unreadable, load_image
from gcs_mosaic.painter import Painter
from gcs_mosaic.prepare import Prepared, Unprepared, thumbnail
from gcs_mosaic.stitch.mosaic import Mosaic, Placement, Rejection, Waiting
from gcs_mosaic.stitch.painted import Extent, Painted, TileKey

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Done:
    """What became of a frame, for the operator. `seconds` by stage."""

    name: str
    state: FrameState
    reason: str | None
    island: int | None
    seconds: dict[str, float]


@dataclass(slots=True)
class _Unsaved:
    """What has changed since the last writing."""

    frames: dict[str, tuple[FrameState, str | None]] = field(default_factory=dict)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    estimates: dict[str, Placement] = field(default_factory=dict)
    painted: dict[str, Painted] = field(default_factory=dict)
    tiles: list[set[TileKey]] = field(default_factory=list)  # one set for each frame that was painted


class Pipeline:
    """Owns the mosaic, the canvas and the output folder of one flight. Used by one thread.

    `say` is given what the operator should hear; `published(revision, tiles)` is called when tiles are on disk.
    """

    def __init__(
        self,
        out: Path,
        config: Config,
        say: Callable[[Notice], None],
        published: Callable[[int, Iterable[TileKey]], None] = lambda revision, tiles: None,
    ) -> None:
        self.out = out
        self.ledger = Ledger(out / LEDGER_NAME)
        self.flight = FlightRecord(name=out.resolve().name, started_utc=time.time())
        self.ledger.begin_flight(self.flight)
        self.mosaic = Mosaic(config.stitch)
        self._reduction = config.reduction
        self.taken_in = 0  # files, whatever became of them
        self._originals = Originals(out, config.originals)
        self._painter = Painter(self._load_original, self._note_painted, config.paint, scratch=out)
        self._tiles = TileWriter(out, config.tiles)
        self._manifest = Manifest(out)
        self._say, self._published = say, published
        self._orders: dict[str, int] = {}
        self._places: dict[str, tuple[Path, str]] = {}  # original and content hash by frame name
        self._names: dict[str, str] = {}  # first frame's name by content hash
        self._unsaved = _Unsaved()
        self._islands_written = 0
        self._extents: dict[int, Extent] = {}  # a merged island is told of with its last one

    @property
    def revision(self) -> int:
        return self._manifest.revision

    @property
    def has_repaints(self) -> bool:
        """Whether some frames lie elsewhere than where they are painted."""
        return self._painter.has_repaints

    def accounts(self) -> Accounts:
        return self.ledger.accounts()

    # Frames come in

    def accept(self, frame: Frame) -> Frame | None:
        """Write down that a frame has come, and keep its original; returns the frame to work off, as it is kept.

        None if the same picture came before. After DiskFull nothing has happened: tell it again.
        """
        earlier = self._names.get(frame.content_hash)
        if earlier is not None:
            with self.ledger.transaction():
                self.ledger.record_frame(frame)
                self.ledger.settle_frame(frame.name, FrameState.DUPLICATE, f"the same picture as {earlier}")
            self.taken_in += 1
            return None
        original = self._recorded(frame)
        self.taken_in += 1
        self._names[frame.content_hash] = frame.name
        self._orders[frame.name] = len(self._orders)
        self._places[frame.name] = (original, frame.content_hash)
        return replace(frame, path=original)

    def accept_damaged(self, damaged: DamagedFile) -> None:
        """Write down that a file is not whole."""
        self.taken_in += 1
        self.ledger.record_damaged(damaged)

    def _recorded(self, frame: Frame) -> Path:
        """Keep the frame's original and write both down; returns where the original can be read from."""
        kept = self._originals.keep(frame)
        with self.ledger.transaction():
            self.ledger.record_frame(frame)
            if not isinstance(kept, NotKept):
                self.ledger.record_original(frame.name, kept.path)
        if kept.notice:
            self._say(kept.notice)
        if isinstance(kept, NotKept):
            self._say(Notice(source="originals", level="warning", text=f"{frame.name} is not kept: {kept.reason}"))
            return frame.path
        return self.out / kept.path

    # Frames are worked off

    def work_off(self, prepared: Prepared | Unprepared) -> Done:
        """Place a frame, paint it and whatever finds its place because of it. `save` is to follow."""
        name = prepared.frame.name
        try:
            return self._work_off(prepared)
        except Exception as error:  # whatever is wrong with one frame must not end the flight, nor go unsaid
            reason = f"it could not be worked off ({error!r})"
            self._say(Notice(source="pipeline", level="error", text=f"{name}: {reason}"))
            self._settle(name, FrameState.REJECTED, reason)
            return Done(name, FrameState.REJECTED, reason, None, {})

    def _work_off(self, prepared: Prepared | Unprepared) -> Done:
        name = prepared.frame.name
        if isinstance(prepared, Unprepared):
            self._settle(name, FrameState.DAMAGED, prepared.reason)
            return Done(name, FrameState.DAMAGED, prepared.reason, None, {})
        self._unsaved.sizes[name] = (prepared.features.width, prepared.features.height)
        start = time.perf_counter()
        outcome = self.mosaic.place(prepared.features, name)
        self.mosaic.adjust()
        placed = time.perf_counter()
        state, reason = _state_of(outcome)
        self._settle(name, state, reason)
        self._paint_moved(prepared)
        seconds = {"place": placed - start, "paint": time.perf_counter() - placed}
        island = outcome.island if isinstance(outcome, Placement) else None
        return Done(name, state, reason, island, prepared.seconds | seconds)

    def repaint_some(self) -> bool:
        """Use spare time to paint a moved frame where it lies now; False if there is nothing to do. `save` is to follow."""
        changed = self._painter.repaint_some()
        self._unsaved.tiles += [changed] if changed else []
        return changed is not None

    def adjust_all(self) -> None:
        """Use a pause in the flight to adjust every island that has grown. `save` is to follow."""
        self.mosaic.adjust(everything=True)
        self._paint_moved(None)

    def finish(self) -> Iterator[None]:
        """The flight is over: adjust everything, reject what still waits, paint all at its final pose, step by step."""
        self.mosaic.adjust(everything=True)
        self._paint_moved(None)
        for rejection in self.mosaic.finish():
            self._settle(rejection.name, FrameState.REJECTED, rejection.reason)
        yield
        for changed in self._painter.repaint_all(self.mosaic.placements()):
            self._unsaved.tiles += [changed] if changed else []
            yield

    def _paint_moved(self, prepared: Prepared | None) -> None:
        """Paint what has found its place; note what must be painted elsewhere."""
        moved = self.mosaic.moved()
        self._unsaved.estimates |= {placement.name: placement for placement in moved}
        for placement in moved:
            if not self._painter.is_painted(placement.name):
                self._settle(placement.name, FrameState.PLACED, None)
                self._paint_new(placement, prepared)
        self._painter.follow(moved)

    def _paint_new(self, placement: Placement, prepared: Prepared | None) -> None:
        order = self._orders[placement.name]
        if prepared is not None and prepared.frame.name == placement.name:
            self._unsaved.tiles.append(self._painter.paint_new(prepared.image, prepared.thumbnail, placement, order))
            return
        image = self._load_original(placement.name)
        if image is None:
            text = f"{placement.name} found its place, but its original is gone: it is not on the map"
            self._say(Notice(source="originals", level="error", text=text))
            return
        self._unsaved.tiles.append(self._painter.paint_new(image, thumbnail(image), placement, order))

    def _load_original(self, name: str) -> Image | None:
        path, content_hash = self._places[name]
        if not is_intact(path, content_hash):
            return None
        image = load_image(path, reduction=self._reduction)
        return None if isinstance(image, Unreadable) else image

    def _note_painted(self, painted: Painted) -> None:
        self._unsaved.painted[painted.name] = painted
        self.mosaic.hold(painted.name, painted.pose, painted.camera)

    def _settle(self, name: str, state: FrameState, reason: str | None) -> None:
        self._unsaved.frames[name] = (state, reason)

    # Everything is written

    def save(self) -> float:
        """Write tiles, ledger and documents; returns the seconds it took. After DiskFull call it again."""
        start = time.perf_counter()
        tiles = self._unsaved.tiles
        self._tiles.write(set().union(*tiles), self._painter.canvas.tile)
        self._save_ledger()
        revision = self._manifest.write(self._contents())
        self._unsaved = _Unsaved()
        for changed in tiles:
            self._published(revision, changed)
        return time.perf_counter() - start

    def close(self) -> None:
        """Let go of everything; what is not saved is lost."""
        self._painter.close()
        self._tiles.close()
        self.ledger.close()

    def _save_ledger(self) -> None:
        with self.ledger.transaction():
            self._save_islands()
            for name, (width, height) in self._unsaved.sizes.items():
                self.ledger.record_size(name, width, height)
            for name, (state, reason) in self._unsaved.frames.items():
                self.ledger.settle_frame(name, state, reason)
            self.ledger.record_estimates(_estimate(placement) for placement in self._unsaved.estimates.values())
            for painted in self._unsaved.painted.values():
                self.ledger.record_painted(painted)
        self._islands_written = len(self.mosaic.islands)

    def _save_islands(self) -> None:
        for island in self.mosaic.islands[self._islands_written :]:
            self.ledger.record_island(island.number)
        for island in self.mosaic.islands:
            if island.merged_into is not None:
                self.ledger.merge_island(island.number, island.merged_into)

    def _contents(self) -> Contents:
        frames = self.ledger.frames
        return Contents(
            flight=self.flight.name,
            updated_utc=time.time(),
            islands=list(self._island_entries()),
            accounts=self.accounts(),
            estimates=self.ledger.estimates(),
            unplaced=[*frames(FrameState.REJECTED), *frames(FrameState.WAITING)],
        )

    def _island_entries(self) -> Iterator[IslandEntry]:
        count = self.mosaic.frame_counts()
        for island in self.mosaic.islands:
            extent = self._painter.canvas.extent(island.number) or self._extents.get(island.number)
            if extent is not None:
                self._extents[island.number] = extent
                yield IslandEntry(
                    id=island.number,
                    bounds=extent.box,
                    minzoom=extent.coarsest,
                    maxzoom=extent.finest,
                    frames=count.get(island.number, 0),
                    merged_into=island.merged_into,
                )


def _state_of(outcome: Placement | Waiting | Rejection) -> tuple[FrameState, str | None]:
    match outcome:
        case Placement():
            return FrameState.PLACED, None
        case Waiting():
            return FrameState.WAITING, None
        case Rejection():
            return FrameState.REJECTED, outcome.reason


def _estimate(placement: Placement) -> Estimate:
    residual = placement.residual_px
    return Estimate(
        name=placement.name,
        island=placement.island,
        pose=placement.pose,
        camera=placement.camera,
        inliers=placement.inliers,
        residual_px=None if math.isnan(residual) else residual,
    )

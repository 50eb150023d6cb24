"""What is written about a flight: the originals, the ledger, the tiles and the documents of one output folder.

Changes are collected in memory and written by `save`, all of one moment together; after DiskFull it may be called again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gcs_mosaic.app.method import Picture
from gcs_mosaic.config.tree import Config
from gcs_mosaic.messages import DamagedFile, DroppedFrame, Frame, Notice, Topic
from gcs_mosaic.render.painted import Extent, Painted, TileKey
from gcs_mosaic.stitch.graph.placement import Covered, Placement
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.stitch.mapping.islands import Island
from gcs_mosaic.stitch.transaction import Kept
from gcs_mosaic.store.documents import finite
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger, printable
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.manifest import Contents, IslandEntry, Manifest
from gcs_mosaic.store.originals import NotKept, Originals
from gcs_mosaic.store.records import Accounts, CoveredRecord, Estimate, FlightRecord, FrameState
from gcs_mosaic.store.stages import stage
from gcs_mosaic.store.tiles import TileWriter


@dataclass
class Changes(Kept):
    """What is not written yet."""

    states: dict[str, tuple[FrameState, str | None]] = field(default_factory=dict)  # and reason, by frame name
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    placements: dict[str, Placement] = field(default_factory=dict)
    covered: dict[str, Covered] = field(default_factory=dict)
    painted: dict[str, Painted] = field(default_factory=dict)
    tiles: list[frozenset[TileKey]] = field(default_factory=list)  # what looks different, a set for each step of work

    def cover(self, covered: Covered) -> str:
        """A placed frame covers a new one, which pages are to learn of though no tile changes; returns its name."""
        self.covered[covered.name] = covered
        self.tiles.append(frozenset())
        return covered.by

    def __bool__(self) -> bool:
        return self.is_public or any((self.sizes, self.painted))

    def news(self, estimates: Sequence[Estimate], newest: str | None) -> FrameNews:
        """What readers are told of the frames; `estimates` are those of the placements."""
        states = self.states.items()
        return FrameNews(
            estimates=estimates,
            covered=[self._record_of(covered) for covered in self.covered.values()],
            rejected={
                name: printable(reason or "") for name, (state, reason) in states if state is FrameState.REJECTED
            },
            waiting=[name for name, (state, _) in states if state is FrameState.WAITING],
            newest=newest,
        )

    def _record_of(self, covered: Covered) -> CoveredRecord:
        width, height = self.sizes[covered.name]
        shift = covered.by_from_frame
        return CoveredRecord(name=covered.name, by=covered.by, by_from_frame=shift, width=width, height=height)

    @property
    def is_public(self) -> bool:
        """Whether the documents tell of any of it."""
        return any((self.states, self.placements, self.tiles))


class Recorder(Kept):
    """Owns one output folder. Used by one thread. `published(revision, tiles)` is called when tiles are on disk.

    `utc` tells the time that is written into documents, in seconds since 1970. What is in the folder cannot be put back as
    it was, so nothing is written while a frame is processed.
    """

    FIXED = frozenset({"out", "ledger", "flight", "_originals", "_tiles", "_manifest", "_published", "_utc"})

    def __init__(
        self,
        out: Path,
        config: Config,
        published: Callable[[int, Iterable[TileKey]], None] = lambda revision, tiles: None,
        utc: Callable[[], float] = time.time,
    ) -> None:
        self.out = out
        self.ledger = Ledger(out / LEDGER_NAME)
        self.flight = FlightRecord(name=out.resolve().name, started_utc=utc(), canvas=config.paint.canvas)
        self.ledger.begin_flight(self.flight)
        self.changes = Changes()
        self._originals = Originals(out, config.originals)
        self._tiles = TileWriter(out, config.tiles)
        self._manifest = Manifest(out)
        self._published = published
        self._utc = utc
        self._told: Accounts | None = None  # as the documents have them: events change them without any frame
        self._islands_known = 0
        self.in_a_pause = False  # or at the end: there is time to list every frame, and nothing may come after it
        self._extents: dict[int, Extent] = {}  # a merged island is told of with its last one

    @property
    def revision(self) -> int:
        return self._manifest.revision

    def accept(self, frame: Frame) -> tuple[Frame, list[Notice]]:
        """Keep a frame's original and write both down; returns the frame as it is kept, and what is to be said."""
        kept = self._originals.keep(frame)
        with self.ledger.transaction():
            self.ledger.record_frame(frame)
            if not isinstance(kept, NotKept):
                self.ledger.record_original(frame.name, kept.path)
        said = [kept.notice] if kept.notice else []
        if isinstance(kept, NotKept):
            text = f"{frame.name} is not kept: {kept.reason}"
            return frame, [*said, Notice(source="originals", level="warning", text=text, topic=Topic.DISK)]
        return replace(frame, path=self.out / kept.path, data=None), said

    def accept_duplicate(self, frame: Frame, earlier: str) -> None:
        """Write down that a frame is the same picture as an earlier one."""
        with self.ledger.transaction():
            self.ledger.record_frame(frame)
            self.ledger.settle_frame(frame.name, FrameState.DUPLICATE, f"the same picture as {earlier}")

    def accept_dropped(self, dropped: DroppedFrame) -> None:
        """Write down that there was no room for a stream's frame."""
        with self.ledger.transaction():
            self.ledger.record_frame(dropped.frame)
            self.ledger.settle_frame(dropped.frame.name, FrameState.DROPPED, dropped.reason)

    def accept_damaged(self, damaged: DamagedFile) -> None:
        """Write down that a file is not whole."""
        self.ledger.record_damaged(damaged)

    def save(
        self,
        canvas: Picture,
        islands: Sequence[Island],
        frames_on: Mapping[int, int],
        held_out: Callable[[], Mapping[int, HeldOut]] = dict,
    ) -> None:
        """Write all changes: tiles, then the ledger, then the documents, so that none names what is not there.

        Whatever is raised on the way, they stay to be written by the next call.
        """
        if not self.changes and self.ledger.accounts() == self._told:
            if self.in_a_pause:
                self._manifest.catch_up()
            return
        of = ", ".join(self.changes.states)
        with stage("tiles", of):
            self._tiles.write(set().union(*self.changes.tiles), canvas.tile_later)
        with stage("ledger", of):
            estimates = [estimate_of_placement(placement) for placement in self.changes.placements.values()]
            self._save_ledger(islands, estimates)
        with stage("documents", of):
            self._tell(canvas, islands, frames_on, held_out, estimates)
        self.changes = Changes()

    def _tell(
        self,
        canvas: Picture,
        islands: Sequence[Island],
        frames_on: Mapping[int, int],
        held_out: Callable[[], Mapping[int, HeldOut]],
        estimates: Sequence[Estimate],
    ) -> None:
        """Write the documents, if they are to tell of anything new."""
        accounts = self.ledger.accounts()
        if self.changes.is_public or accounts != self._told:
            entries = list(self._entries(canvas, islands, frames_on, held_out()))
            revision = self._manifest.write(self._contents(entries, accounts, estimates), everything=self.in_a_pause)
            self._told = accounts
            for changed in self.changes.tiles:
                self._published(revision, changed)

    def close(self) -> None:
        """Let go of everything; what is not saved is lost."""
        self._manifest.close()
        self._tiles.close()
        self.ledger.close()

    def _save_ledger(self, islands: Sequence[Island], estimates: Sequence[Estimate]) -> None:
        changes = self.changes
        with self.ledger.transaction():
            for island in islands[self._islands_known :]:
                self.ledger.record_island(island.number)
            for island in islands:
                if island.merged_into is not None:
                    self.ledger.merge_island(island.number, island.merged_into)
            for name, (width, height) in changes.sizes.items():
                self.ledger.record_size(name, width, height)
            for name, (state, reason) in changes.states.items():
                self.ledger.settle_frame(name, state, reason)
            self.ledger.record_estimates(estimates)
            for covered in changes.covered.values():
                self.ledger.record_covered(covered.name, covered.by, covered.by_from_frame)
            for painted in changes.painted.values():
                self.ledger.record_painted(painted)
        self._islands_known = len(islands)

    def _contents(self, islands: list[IslandEntry], accounts: Accounts, estimates: Sequence[Estimate]) -> Contents:
        return Contents(
            flight=self.flight.name,
            updated_utc=self._utc(),
            islands=islands,
            accounts=accounts,
            frames=self.changes.news(estimates, self.ledger.newest_on_map()),
        )

    def _entries(
        self,
        canvas: Picture,
        islands: Sequence[Island],
        frames_on: Mapping[int, int],
        held_out: Mapping[int, HeldOut],
    ) -> Iterator[IslandEntry]:
        for island in islands:
            extent = canvas.extent(island.number) or self._extents.get(island.number)
            if extent is not None:
                self._extents[island.number] = extent
                yield IslandEntry(
                    id=island.number,
                    bounds=extent.box,
                    minzoom=extent.coarsest,
                    maxzoom=extent.finest,
                    frames=frames_on.get(island.number, 0),
                    merged_into=island.merged_into,
                    held_out=held_out.get(island.number),
                )


def estimate_of_placement(placement: Placement) -> Estimate:
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
    )

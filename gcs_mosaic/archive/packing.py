"""Stage 14: the flight's folder, as a flight writes it: ledger, originals, tiles, documents. One writer.

It is made beside and moved into place with mosaic.json last, so nobody takes half of it for a map.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs_mosaic.archive.arrivals import ArchiveFiles
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.exposure_compensation import CompensatedFrames, painted_frame, placements_of
from gcs_mosaic.archive.features import SeenFrame, SetAside, frame_at, frame_of_file
from gcs_mosaic.archive.files import files_at
from gcs_mosaic.archive.islands import Assembled
from gcs_mosaic.archive.painting import ArchiveMap
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.super_tiles import SuperTile, SuperTileLayout
from gcs_mosaic.archive.target import PACKING
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import FlightFailed
from gcs_mosaic.messages import DamagedFile, Frame
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import make_folder, write_beside
from gcs_mosaic.store.flight_store import FlightStore
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.originals import OriginalsSettings
from gcs_mosaic.store.records import FlightRecord, FrameState, IslandRecord
from gcs_mosaic.store.tiles import mask_path, tile_path

LAST = (LEDGER_NAME, "mosaic.json")  # put into place
# What a map made of other frames may leave; the first go first. What people have added stays, and what was heard and logged.
REPLACED = (
    *("mosaic.json", LEDGER_NAME, f"{LEDGER_NAME}-wal", f"{LEDGER_NAME}-shm", "placements.json", "placements.jsonl"),
    *("status.json", "checkpoint", "checkpoint.values", "tiles", "masks", "frames"),
)
NO_LIMIT_GB = 1e6
UPLOADS = 8  # at once
Outcome = tuple[FrameState, str | None]  # of a file, with the reason if it takes no part


@dataclass(frozen=True, slots=True)
class Reprocessed:
    """All that the stages have found."""

    arrivals: ArchiveFiles
    seen: list[SeenFrame]
    aside: list[SetAside]
    assembled: Assembled
    held_out: dict[int, HeldOut]  # held-out error by island
    compensated: CompensatedFrames
    map: ArchiveMap


def packed(engine: Engine, found: Reprocessed, name: str, config: Config, folder: Path) -> list[Outcome]:
    """Write a whole flight of this name into an empty folder; what has become of each file."""
    _write_tiles(engine, found.map, folder)
    with Ledger(folder / LEDGER_NAME) as ledger:
        ledger.begin_flight(FlightRecord(name=name, started_utc=time.time(), canvas=config.paint.canvas))
    originals = OriginalsSettings(keep="link", budget_gb=NO_LIMIT_GB)
    with closing(FlightStore(folder, originals=originals, tiles=config.tiles, canvas=config.paint.canvas)) as store:
        for file, digest, reason in found.arrivals.files:
            if reason:
                store.accept_damaged(DamagedFile(name=file.name, reason=reason))
            else:
                store.accept(_frame_of(file, digest))
        _note_outcomes(store, found)
        _note_places(store, engine, found)
        islands = [IslandRecord(id=number, merged_into=into) for number, into in enumerate(found.assembled.islands)]
        counts: dict[int, int] = {}
        for island in found.assembled.placed.values():
            counts[island] = counts.get(island, 0) + 1
        store.in_a_pause = True
        store.save(_Extents(found.map.layout), islands, counts, lambda: found.held_out)
        return [(frame.state, frame.reason) for frame in store.ledger.frames()]


def _frame_of(file: SourceFile, digest: str) -> Frame:
    """As `frame_at`, without reading a file on this disk that is as it was listed. Raises Passing."""
    with suppress(OSError):
        now = None if file.bucket else Path(file.path).stat()
        if now is not None and (now.st_size, now.st_mtime_ns) == (file.size, file.modified_ns):
            return frame_of_file(file, digest)
    return frame_at(file, digest)


def _note_outcomes(store: FlightStore, found: Reprocessed) -> None:
    for one in found.seen:
        store.note_measured(one.frame.name, one.facts.size, one.facts.sharpness)
    for name in found.assembled.placed:
        store.settle(name, FrameState.PLACED, None)
    for covered in found.assembled.covered:
        store.settle(covered.name, FrameState.COVERED, None)
        store.note_covered(covered)
    for rejected in found.assembled.rejected:
        store.settle(rejected.name, FrameState.REJECTED, rejected.reason)
    for aside in found.aside:
        state = FrameState.DAMAGED if aside.damaged else FrameState.REJECTED
        store.settle(aside.frame.name, state, aside.reason)


def _note_places(store: FlightStore, engine: Engine, found: Reprocessed) -> None:
    compensated, part = found.compensated, 0
    for number, one in enumerate(compensated.frames):
        part += number >= compensated.starts[part + 1]
        placement = placements_of(engine.artefacts, one.placements)[one.place]
        painted = painted_frame(engine.artefacts, one, compensated.key, part, number - compensated.starts[part])
        store.note_placed([placement])
        store.note_painted(painted)


class _Extents:
    """The map, of whose tiles all are written already."""

    def __init__(self, layout: SuperTileLayout) -> None:
        self._extents = layout.extents

    def tile_later(self, island: int, tile: Tile) -> Callable[[], TilePicture | None]:
        return lambda: None

    def extent(self, island: int) -> Extent | None:
        return self._extents.get(island)


def _write_tiles(engine: Engine, painted: ArchiveMap, folder: Path) -> None:
    for one, key in painted.keys.items():
        for x, y, colour, mask in engine.part(key, "tiles"):
            island, tile = _place_of(one, painted.side, key, x, y)
            for path, data in ((mask_path(folder, island, tile), mask), (tile_path(folder, island, tile), colour)):
                if data is not None:
                    make_folder(path.parent, folder)
                    write_beside(path, data, root=folder)


def _place_of(one: SuperTile, side: int, key: str, x: Any, y: Any) -> tuple[int, Tile]:
    """Island and tile that an artefact names, which others may have written: they become names of files."""
    try:
        island, tile = int(one.island), Tile(int(one.level), int(x), int(y))
        if tile in set(one.tiles(side)):
            return island, tile
    except (TypeError, ValueError):
        pass
    raise FlightFailed(f"the artefact {key} names tiles that are not its own: remove it, and give the command again")


@contextmanager
def beside(target: Path) -> Iterator[Path]:
    """An empty folder on the target's disk, gone in the end."""
    with tempfile.TemporaryDirectory(prefix=PACKING, dir=target, ignore_cleanup_errors=True) as folder:
        made = Path(folder) / "made"
        made.mkdir()
        yield made


def move_into_place(made: Path, target: Path) -> None:
    """Put a whole flight where an older one of the same archive may be. A kill in between leaves none there."""
    older = made.parent / "older"
    older.mkdir()
    for name in REPLACED:
        with suppress(FileNotFoundError):
            inside.move(target / name, older / name, target)
    others = [path for path in made.iterdir() if path.name not in LAST]
    for path in [*others, *(made / name for name in LAST)]:
        inside.move(path, target / path.name, target)


def upload(made: Path, target: str) -> None:
    """Put a whole flight into a bucket, mosaic.json last. Raises CannotWrite."""
    files = files_at(target)
    names = {path.relative_to(made).as_posix() for path in inside.files(made, made)}
    older = {one.name for name in REPLACED for one in files.listed(name)}
    for name in REPLACED:
        files.remove(name)
    with ThreadPoolExecutor(UPLOADS) as pool:
        list(pool.map(files.remove, older - names))
        list(pool.map(lambda name: files.write(name, (made / name).read_bytes()), names.difference(LAST)))
    for name in LAST:
        files.write(name, (made / name).read_bytes())

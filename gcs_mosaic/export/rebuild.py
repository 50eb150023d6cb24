"""Rebuilding a flight's map from its ledger and originals, with all bands of the frames on its tiles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.pixels import KeepBands
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent, RenderItem
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import Bands, Coverage
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.originals import original_bytes
from gcs_mosaic.store.records import FrameRecord

KEPT_TILES = 128  # tiles in memory while holes are filled: 2 MB each with eight bands of 16 bits


@dataclass(frozen=True, slots=True)
class RebuildSource:
    """Inputs for rebuilding an island. Frames of another kind (bands, depth) than most, and those whose originals are gone, are
    left out."""

    frames: Sequence[RenderItem]
    flight: Path
    records: dict[str, FrameRecord]  # of those frames, by name
    reductions: dict[str, int]  # at which the frames were painted, by name
    canvas: CompositorSettings
    of_another_kind: int
    gone: int

    def load(self, name: str) -> Bands | None:
        """A frame (h, w, bands) as it was painted."""
        data = original_bytes(self.flight, self.records[name])
        image = None if data is None else decode_image(data, reduction=self.reductions[name])
        return None if isinstance(image, Unreadable) else image


class RebuiltTiles:
    """The tiles of an island, as `hole_filling.Tiles`."""

    def __init__(self, canvas: TileCompositor, island: int, extent: Extent) -> None:
        self.island, self.extent = island, extent
        self._picture = lru_cache(KEPT_TILES)(lambda tile: canvas.tile(island, tile))

    def picture(self, tile: Tile) -> TilePicture | None:
        return self._picture(tile)

    def mask(self, tile: Tile) -> Coverage | None:
        picture = self._picture(tile)
        return None if picture is None else picture.coverage


def source_of(flight: Path, island: int) -> RebuildSource:
    """An island's data from the ledger. UsageError if none of its frames can be read."""
    with Ledger(flight / LEDGER_NAME, read_only=True) as ledger:
        painted, record = ledger.painted(island), ledger.flight()
        frames = {frame.name: frame for frame in ledger.frames()}
    if not painted:
        raise UsageError(
            f"{flight} is a map of --method paper, which is not painted again from its frames: give --format png."
        )
    kinds = Counter(one.display.kind for one in painted)
    of_kind = [one for one in painted if one.display.kind == kinds.most_common(1)[0][0]]
    there = [one for one in of_kind if original_bytes(flight, frames[one.name]) is not None]
    if not there:
        raise UsageError(
            f"{flight} has no original of a frame that is painted on island {island}: only they have all bands."
        )
    return RebuildSource(
        frames=there,
        flight=flight,
        records={one.name: frames[one.name] for one in there},
        reductions={one.name: _reduction(one, frames[one.name]) for one in there},
        canvas=record.canvas if record else CompositorSettings(),
        of_another_kind=len(painted) - len(of_kind),
        gone=len(of_kind) - len(there),
    )


@contextmanager
def rebuilt(source: RebuildSource, keep_bands: KeepBands, scratch: Path) -> Iterator[RebuiltTiles]:
    """The island's tiles with all bands; `scratch` is a folder for what does not fit into memory."""
    island = source.frames[0].island
    with TileCompositor(source.load, source.canvas, scratch=scratch, keep_bands=keep_bands) as canvas:
        canvas.move(source.frames)
        for _ in canvas.repaint():
            pass
        extent = canvas.extent(island)
        assert extent is not None, "frames that were painted touch tiles"
        yield RebuiltTiles(canvas, island, extent)


def _reduction(painted: RenderItem, frame: FrameRecord) -> int:
    return round((frame.width or painted.camera.width) / painted.camera.width)

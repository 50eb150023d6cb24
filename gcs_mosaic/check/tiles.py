"""Tiles and masks against the ledger: what is missing, unknown or unreadable, and whether each shows what the ledger says."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from gcs_mosaic.check.findings import CheckedPart, LostForGood, Progress, counted
from gcs_mosaic.check.layout import Layout, layout_of
from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import RenderItem, TileKey
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.store import inside
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.originals import original_bytes
from gcs_mosaic.store.records import FrameRecord
from gcs_mosaic.store.tiles import (
    TileSettings,
    encode_jpeg,
    encode_mask,
    keys_of,
    mask_path,
    pictures_in,
    read_tile,
    remove_tile,
    tile_bytes,
    tile_path,
    tiles_in,
    write_tile,
)

logger = logging.getLogger(__name__)

ROUNDING = 1.0  # grey levels, a tile's mean difference: what another build of the decoder and encoder may do
SAMPLED = 20  # tiles by which the quality is recognised


@dataclass(frozen=True, slots=True)
class PaintedMap:
    """What the ledger says of a flight's tiles; `gone` are the painted frames whose originals cannot be read."""

    flight: Path
    painted: Sequence[RenderItem]
    frames: dict[str, FrameRecord]
    reductions: dict[str, int]  # at which frames were painted, by name
    settings: CompositorSettings
    layout: Layout
    gone: frozenset[str]

    def load(self, name: str) -> Bands | None:
        """A frame as it was painted; None if its original is not what came."""
        frame = self.frames[name]
        data = original_bytes(self.flight, frame)
        if data is None:
            return None
        image = decode_image(data, reduction=self.reductions[name])
        return None if isinstance(image, Unreadable) else image


def painted_map(flight: Path, ledger: Ledger, damaged: Collection[str]) -> PaintedMap:
    """What the ledger says of the tiles; `damaged` are frames whose originals are not what came."""
    record = ledger.flight()
    painted = [one for island in ledger.islands() for one in ledger.painted(island.id)]
    frames = {frame.name: frame for frame in ledger.frames()}
    gone = {one.name for one in painted if frames[one.name].original is None or one.name in damaged}
    reductions = {one.name: round((frames[one.name].width or one.camera.width) / one.camera.width) for one in painted}
    settings = record.canvas if record else CompositorSettings()
    return PaintedMap(flight, painted, frames, reductions, settings, layout_of(painted), frozenset(gone))


def check_tiles(shown: PaintedMap, part: CheckedPart, progress: Progress) -> None:
    """Add tiles that are missing, unknown or unreadable to `part`."""
    there, possible = set(tiles_in(shown.flight)), shown.layout.possible()
    unsure = shown.layout.unsure(shown.gone)
    for number, key in enumerate(sorted(there)):
        progress("tiles", number, len(there))
        part.checked += 1
        if shown.painted and key not in possible:
            part.fault(name_of(key), "a tile that no frame of the ledger touches")
        elif read_tile(shown.flight, *key) is None:
            part.fault(name_of(key), "a tile that cannot be decoded, or its mask")
    missing = sorted(shown.layout.required() - there)
    for key in missing:
        if key not in unsure:
            part.fault(name_of(key), "a tile that is missing")
    if lost := [name_of(key) for key in missing if key in unsure]:
        part.lost = f"{counted(len(lost), 'tile')} or more that cannot be made without originals, {lost[0]} for one"
    for path in _lone_masks(shown.flight):
        part.fault(path.relative_to(shown.flight).as_posix(), "a mask without its tile")
    if shown.gone:
        part.notes.append(f"tiles of {len(shown.gone)} frames whose originals are not there cannot be made again")


def compare_tiles(shown: PaintedMap, part: CheckedPart, progress: Progress) -> None:
    """Paint all tiles from ledger and originals and add those that differ to `part`."""
    quality, different, rounded = jpeg_quality(shown.flight), list[TileKey](), 0
    with _repainted(shown, progress) as pictures:
        for key, picture in pictures:
            if not _is_as_painted(shown.flight, key, picture, quality):
                different.append(key)
                rounded += _is_nearly(shown.flight, key, picture, quality)
    part.notes.append(f"compared with {len(shown.painted)} frames painted again")
    if rounded == len(different) > part.checked / 2:
        part.notes.append(f"{rounded} tiles differ by rounding alone: painted by another build of the image libraries")
        return
    known = part.subjects
    for key in different:
        if name_of(key) not in known:
            part.fault(name_of(key), "a tile that does not show what ledger and originals say")


def repair_tiles(shown: PaintedMap, progress: Progress, lost: LostForGood) -> list[str]:
    """Make all tiles what ledger and originals say, and remove those that nothing says; returns what was done. Of tiles that are
    missing and need lost originals their masks tell."""
    quality = jpeg_quality(shown.flight) or TileSettings().jpeg_quality
    possible = shown.layout.possible()
    unknown = [key for key in tiles_in(shown.flight) if shown.painted and key not in possible]
    for key in unknown:
        remove_tile(shown.flight, *key)
    made = _remove_undecodable(shown)
    with _repainted(shown, progress) as pictures:
        for key, picture in pictures:
            if not _is_as_painted(shown.flight, key, picture, quality):
                made += 1
                if picture is None:
                    remove_tile(shown.flight, *key)
                else:
                    write_tile(shown.flight, *key, picture, quality)
    lost.tiles = len(shown.layout.unsure(shown.gone).intersection(keys_of(_lone_masks(shown.flight))))
    masks = _remove_lone_masks(shown.flight)
    done = (
        (made, "tiles made anew, or removed where nothing is shown"),
        (len(unknown), "tiles removed that no frame touches"),
    )
    return [f"{text}: {count}" for count, text in (*done, (masks, "masks without tiles removed")) if count]


def jpeg_quality(flight: Path) -> int | None:
    """With which quality the tiles were written, by their quantisation tables; None without a tile that tells."""
    known = _tables()
    paths = (tile_path(flight, *key) for key in islice(tiles_in(flight), SAMPLED))
    found = Counter(known.get(_table(tile_bytes(path, flight) or b"")) for path in paths)
    found.pop(None, None)
    return found.most_common(1)[0][0] if found else None


def name_of(key: TileKey) -> str:
    island, tile = key
    return f"tiles/{island}/{tile.z}/{tile.x}/{tile.y}.jpg"


@contextmanager
def _repainted(shown: PaintedMap, progress: Progress) -> Iterator[Iterator[tuple[TileKey, TilePicture | None]]]:
    """All tiles as ledger and originals say, but those that need an original that is gone."""
    with (
        TemporaryDirectory(prefix="gcs-mosaic-check-", ignore_cleanup_errors=True) as scratch,
        TileCompositor(shown.load, shown.settings, scratch=Path(scratch)) as canvas,
    ):
        canvas.move(shown.painted)
        all_tiles = canvas.behind
        for _ in canvas.repaint():
            progress("painting", all_tiles - canvas.behind, all_tiles)
        keys = shown.layout.possible() - shown.layout.unsure(shown.gone | canvas.gone)
        yield ((key, canvas.tile(*key)) for key in sorted(keys))


def _is_as_painted(flight: Path, key: TileKey, picture: TilePicture | None, quality: int | None) -> bool:
    """Whether the tile's files are those that would be written now."""
    colours, mask = (tile_bytes(path, flight) for path in (tile_path(flight, *key), mask_path(flight, *key)))
    if picture is None:
        return colours is None and mask is None
    full = int(picture.coverage.min()) == 255
    wanted = None if full else encode_mask(picture.coverage)
    said = encode_jpeg(picture.colour, picture.coverage, quality or TileSettings().jpeg_quality)
    return (colours, mask) == (said, wanted)


def _is_nearly(flight: Path, key: TileKey, picture: TilePicture | None, quality: int | None) -> bool:
    """Whether the tile is what would be written now but for rounding."""
    there = read_tile(flight, *key)
    if picture is None or there is None or not np.array_equal(there.coverage, picture.coverage):
        return False
    data = encode_jpeg(picture.colour, picture.coverage, quality or TileSettings().jpeg_quality)
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    seen = picture.coverage > 0
    return decoded is not None and float(np.abs(there.colour[seen] - decoded[seen].astype(np.int16)).mean()) < ROUNDING


def _remove_undecodable(shown: PaintedMap) -> int:
    """Without such a tile readers fill its place from the coarser ones."""
    bad = [key for key in tiles_in(shown.flight) if read_tile(shown.flight, *key) is None]
    for key in bad:
        remove_tile(shown.flight, *key)
    return len(bad) if not shown.painted else 0


def _remove_lone_masks(flight: Path) -> int:
    lone = list(_lone_masks(flight))
    for path in lone:
        inside.remove(path, flight)
    return len(lone)


def _lone_masks(flight: Path) -> Iterator[Path]:
    for path in pictures_in(flight, "masks", ".png"):
        colours = flight / "tiles" / path.relative_to(flight / "masks").with_suffix(".jpg")
        if not inside.is_file(colours, flight):
            yield path


@lru_cache(1)
def _tables() -> dict[bytes, int]:
    grey, full = np.zeros((16, 16, 3), np.uint8), np.full((16, 16), 255, np.uint8)
    return {_table(encode_jpeg(grey, full, quality)): quality for quality in range(1, 101)}


def _table(data: bytes) -> bytes:
    """The first quantisation table of a JPEG."""
    at = data.find(b"\xff\xdb")
    return data[at + 4 : at + 69]

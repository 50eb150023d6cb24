"""Stages 12 and 13: super-tiles are painted, each by itself, and coarser ones made of finer ones.

A tile is a pure function of the frames around it (`render.compositor`), so a super-tile is painted from those alone, whatever
else is painted, where and when.
"""

from __future__ import annotations

import tempfile
import zlib
from bisect import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gcs_mosaic.archive.artefacts import Artefacts, unpacked
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.exposure_compensation import BookedFrame, CompensatedFrames, book_of, painted_frame
from gcs_mosaic.archive.features import image_of
from gcs_mosaic.archive.super_tiles import Footprint, SuperTile, SuperTileLayout, footprint, layout_of
from gcs_mosaic.archive.tasks import Parts, Passing, scratch_folder, task
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.blend_maps import BlendMaps
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.overviews import assemble, composite, shrink
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_cache import Layer, make_layer
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.store.tiles import encode_jpeg, encode_mask

MOST_HALF_BYTES = 1 << 22  # of a tile's half: no tile has more pixels
Packed = tuple[bytes, bytes | None, bytes, tuple[int, int]]  # colour, coverage, weight and its shape
Places = tuple[str, str, tuple[int, ...]]  # see `CompensatedFrames`: book, looks, where the parts of these begin


@dataclass(frozen=True, slots=True)
class ArchiveMap:
    """All super-tiles with their artefacts, and the islands' extents; `side`: tiles along a super-tile."""

    layout: SuperTileLayout
    keys: dict[SuperTile, str]
    side: int


@dataclass(frozen=True, slots=True)
class HowPainted:
    """All that a super-tile depends on beside frames."""

    canvas: CompositorSettings
    jpeg_quality: int
    reduction: int
    max_pixels: int
    side: int


def painted_map(engine: Engine, found: CompensatedFrames, config: Config, side: int) -> ArchiveMap:
    """Paint everything."""
    how = HowPainted(config.paint.canvas, config.tiles.jpeg_quality, config.reduction, config.frames.max_pixels, side)
    places: Places = (found.book, found.key, found.starts)
    parts = [task(footprints, places, number, side) for number in range(len(found.starts) - 1)]
    layout = layout_of([one for some in engine.made("footprints", parts) for one in some])
    keys: dict[SuperTile, str] = {}
    for level, tiles in layout.levels():
        tasks = [_task(places, one, layout, keys, how) for one in tiles]
        engine.made(f"painting, level {level}", tasks)
        keys |= {one: made.key for one, made in zip(tiles, tasks, strict=True)}
    return ArchiveMap(layout, keys, side)


def _task(
    places: Places, one: SuperTile, layout: SuperTileLayout, keys: Mapping[SuperTile, str], how: HowPainted
) -> Any:
    below = tuple(keys.get(finer) for finer in one.below())
    is_top = one.level <= layout.extents[one.island].coarsest
    return task(super_tile, places, one, layout.frames[one], below, is_top, how)


def footprints(artefacts: Artefacts, places: Places, part: int, side: int) -> Parts:
    """Where the frames of a part are painted."""
    book, key, starts = places
    booked = list(book_of(artefacts, book).values())[starts[part] : starts[part + 1]]
    found: list[Footprint | None] = [
        footprint(painted_frame(artefacts, one, key, part, place), side) for place, one in enumerate(booked)
    ]
    return {"summary": found}


def super_tile(
    artefacts: Artefacts,
    places: Places,
    one: SuperTile,
    frames: tuple[int, ...],
    below: tuple[str | None, ...],
    is_top: bool,
    how: HowPainted,
) -> Parts:
    """A super-tile's tiles as files, and for the level above each at half size. `frames`: places in the book."""
    own = _own(artefacts, places, one, frames, how) if frames else {}
    finer: dict[tuple[int, int], Layer] = {}
    for key in filter(None, below):
        finer |= {place: _unpacked(packed) for place, packed in artefacts.part(key, "halves").items()}
    tiles, halves = list[tuple[int, int, bytes, bytes | None]](), dict[tuple[int, int], Packed]()
    for tile in one.tiles(how.side):
        layer = composite(own.get(tile), assemble([finer.get((child.x, child.y)) for child in tile.children]))
        if layer is None:
            continue
        mask = None if int(layer.coverage.min()) == 255 else encode_mask(layer.coverage)
        tiles.append((tile.x, tile.y, encode_jpeg(layer.colour, layer.coverage, how.jpeg_quality), mask))
        half = None if is_top else shrink(layer)
        if half is not None:
            halves[tile.x, tile.y] = _packed(half)
    return {"summary": len(tiles), "tiles": tiles, "halves": halves}


def _own(
    artefacts: Artefacts, places: Places, one: SuperTile, frames: Sequence[int], how: HowPainted
) -> dict[Tile, Layer]:
    """What the frames of this level show on the tiles. Raises Passing if an original is gone, or another one."""
    book, key, starts = places
    booked = list(book_of(artefacts, book).values())
    by_name: dict[str, BookedFrame] = {}
    painted: list[RenderItem] = []
    for number in frames:
        part = bisect(starts, number) - 1
        painted.append(painted_frame(artefacts, booked[number], key, part, number - starts[part]))
        by_name[painted[-1].name] = booked[number]
    load = partial(_load, by_name, how)
    with (
        tempfile.TemporaryDirectory(prefix="painting-", dir=scratch_folder(), ignore_cleanup_errors=True) as scratch,
        TileCompositor(load, replace(how.canvas, threads=1), scratch=Path(scratch)) as canvas,
    ):
        for frame in painted:
            if (maps := _blend_maps(artefacts, by_name[frame.name])) is not None:
                canvas.know(frame.name, maps)
        canvas.move(painted)
        canvas.confine((one.island, tile) for tile in one.tiles(how.side))
        for _ in canvas.repaint():
            pass
        if canvas.gone:
            raise Passing(f"{sorted(canvas.gone)[0]} cannot be decoded any more")
        layers = {tile: canvas.layer(one.island, tile) for tile in one.tiles(how.side)}
    return {tile: layer for tile, layer in layers.items() if layer is not None}


def _blend_maps(artefacts: Artefacts, one: BookedFrame) -> BlendMaps | None:
    found: BlendMaps | None = artefacts.part(one.frame.blend_maps, "maps")
    return found


def _load(booked: Mapping[str, BookedFrame], how: HowPainted, name: str) -> Bands | None:
    frame = booked[name].frame.frame
    return image_of(frame.file, frame.content_hash, how.reduction, how.max_pixels)


def _packed(layer: Layer) -> Packed:
    coverage = None if layer.is_full else zlib.compress(layer.coverage.tobytes(), 1)
    weight = np.ascontiguousarray(layer.weight, np.float32)
    return zlib.compress(layer.colour.tobytes(), 1), coverage, weight.tobytes(), weight.shape


def _unpacked(packed: Packed) -> Layer:
    colour, coverage, weight, shape = packed
    seen = np.frombuffer(unpacked(colour, MOST_HALF_BYTES), np.uint8)
    side = round((len(seen) / 3) ** 0.5)
    covered = (
        None if coverage is None else np.frombuffer(unpacked(coverage, MOST_HALF_BYTES), np.uint8).reshape(side, side)
    )
    layer = make_layer(seen.reshape(side, side, 3), covered, np.frombuffer(weight, np.float32).reshape(shape))
    assert layer is not None, "nothing empty is packed"
    return layer

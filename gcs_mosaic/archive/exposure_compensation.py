"""Stage 11: how bright each frame is painted, and at which level: overlaps of thumbnails in parallel, then one solution."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame
from gcs_mosaic.archive.frame_kinds import FrameKind
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.render.agreement import Aircraft, Overlap, agreed_looks, overlap_of
from gcs_mosaic.render.brightness import Camera, size_of
from gcs_mosaic.render.exposure import ExposureSettings, is_false_colour
from gcs_mosaic.render.levels import FINER
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import PaintSettings
from gcs_mosaic.render.tile_grid import level_among
from gcs_mosaic.render.vignetting import FLAT, Vignetting, VignettingEstimate, VignettingSettings
from gcs_mosaic.render.warp_grid import resolved
from gcs_mosaic.stitch.arrays import Levels
from gcs_mosaic.stitch.camera.geometry import reduced_view
from gcs_mosaic.stitch.graph.placement import Placement


@dataclass(frozen=True, slots=True)
class BookedFrame:
    """A placed frame: its place in the order of frames, where its placement and its features lie, and its picture's kind."""

    order: int
    frame: SeenFrame
    kind: FrameKind
    placements: str  # artefact
    place: int  # in it


@dataclass(frozen=True, slots=True)
class CompensatedFrames:
    """All placed frames, ready to be painted: the book of them, the artefact with their looks, and where its parts begin."""

    book: str
    key: str
    starts: tuple[int, ...]  # of each part, and the end
    frames: tuple[BookedFrame, ...]


def compensated(
    engine: Engine,
    frames: Sequence[SeenFrame],
    kinds: Sequence[FrameKind],
    chunks: Sequence[tuple[str, Sequence[str]]],
    settings: PaintSettings,
) -> CompensatedFrames:
    """Gain, vignetting, light field and level of all frames of these chunks of placements."""
    booked = booked_frames(frames, kinds, chunks)
    book = engine.listed(booked)
    starts = tuple(int(at) for at in np.cumsum([0, *(len(names) for _, names in chunks)]))
    overlaps = [task(overlaps_of, book, first, stop) for first, stop in pairwise(starts)]
    engine.made("overlaps", overlaps)
    keys = engine.listed([one.key for one in overlaps])
    one = task(looks, keys, settings.exposure, settings.vignetting)
    engine.made("gains", [one])
    return CompensatedFrames(book, one.key, starts, tuple(booked))


def booked_frames(
    frames: Sequence[SeenFrame], kinds: Sequence[FrameKind], chunks: Sequence[tuple[str, Sequence[str]]]
) -> list[BookedFrame]:
    """The placed frames in the order of these chunks."""
    numbers = {one.frame.name: number for number, one in enumerate(frames)}
    return [
        BookedFrame(frames[numbers[name]].frame.order, frames[numbers[name]], kinds[numbers[name]], key, place)
        for key, names in chunks
        for place, name in enumerate(names)
    ]


@lru_cache(4)
def book_of(artefacts: Artefacts, key: str) -> dict[str, BookedFrame]:
    """All placed frames by name, in order. Raises Lost."""
    return {one.frame.frame.name: one for one in artefacts.part(key, "list")}


@lru_cache(256)
def placements_of(artefacts: Artefacts, key: str) -> list[Placement]:
    """The placements of a chunk. Raises Lost."""
    found: list[Placement] = artefacts.part(key, "placements")
    return found


def uncompensated(artefacts: Artefacts, one: BookedFrame) -> RenderItem:
    """A frame as it is painted but for gain, vignetting, light field and level."""
    placement = placements_of(artefacts, one.placements)[one.place]
    pose, camera = reduced_view(placement.pose, placement.camera, *one.frame.facts.painted)
    return RenderItem(
        name=placement.name,
        order=one.order,
        island=placement.island,
        pose=pose,
        camera=camera,
        relief=placement.relief,
        display=one.kind.display,
        dead=one.kind.dead,
        still=placement.still,
        area=placement.area,
        level=0,
    )


def overlaps_of(artefacts: Artefacts, book: str, first: int, stop: int) -> Parts:
    """Some frames without relief, with the ground sampling distance of each and its overlaps with linked frames before it."""
    known = book_of(artefacts, book)
    some = list(known.values())[first:stop]
    frames = [replace(uncompensated(artefacts, one), relief=None) for one in some]
    found = [
        overlap
        for one, painted in zip(some, frames, strict=True)
        for overlap in _overlaps(artefacts, known, one, painted)
    ]
    return {
        "summary": len(found),
        "frames": frames,
        "aircraft": [placements_of(artefacts, one.placements)[one.place].aircraft for one in some],
        "palettes": [is_false_colour(_thumbnail(artefacts, one)) for one in some],
        "distances": [resolved(one.pose, one.camera) for one in frames],
        "overlaps": found,
    }


def _overlaps(
    artefacts: Artefacts, known: dict[str, BookedFrame], one: BookedFrame, painted: RenderItem
) -> Iterator[Overlap]:
    small = _thumbnail(artefacts, one)
    if is_false_colour(small):
        return
    linked = placements_of(artefacts, one.placements)[one.place].neighbours
    for other in (known[name] for name in linked if name in known and known[name].order < one.order):
        beside, beside_small = uncompensated(artefacts, other), _thumbnail(artefacts, other)
        alike = beside.island == painted.island and beside.display.kind == painted.display.kind
        if alike and not is_false_colour(beside_small):
            means = overlap_of(painted, small, beside, beside_small)
            if means is not None:
                yield painted.name, beside.name, means


@lru_cache(512)
def _thumbnail(artefacts: Artefacts, one: BookedFrame) -> Levels:
    return one.kind.display.levels(artefacts.part(one.frame.key, "thumbnail"))


def looks(artefacts: Artefacts, overlaps: str, exposure: ExposureSettings, vignetting: VignettingSettings) -> Parts:
    """Gain, vignetting, light field and level of each frame, part by part as the overlaps are."""
    keys = artefacts.part(overlaps, "list")
    chunks: list[list[RenderItem]] = [artefacts.part(key, "frames") for key in keys]
    frames = [one for chunk in chunks for one in chunk]
    found: list[Overlap] = [one for key in keys for one in artefacts.part(key, "overlaps")]
    distances: list[float | None] = [one for key in keys for one in artefacts.part(key, "distances")]
    aircraft = [one for key in keys for one in artefacts.part(key, "aircraft")]
    whose = dict(zip((one.name for one in frames), aircraft, strict=True))
    palettes = [one for key in keys for one in artefacts.part(key, "palettes")]
    curves = curves_of(whose, frames, found, vignetting) | {
        one.name: FLAT for one, is_palette in zip(frames, palettes, strict=True) if is_palette
    }
    agreed = agreed_looks(frames, found, curves, exposure, whose)
    levels = dict(zip(curves, levels_of(frames, distances), strict=True))
    parts = {
        f"looks {number}": [
            (agreed[one.name][0], curves[one.name], agreed[one.name][1], levels[one.name]) for one in chunk
        ]
        for number, chunk in enumerate(chunks)
    }
    return {"summary": len(frames), **parts}


def curves_of(
    aircraft: Mapping[str, Aircraft],
    frames: Sequence[RenderItem],
    overlaps: Sequence[Overlap],
    settings: VignettingSettings,
) -> dict[str, Vignetting]:
    """The vignetting of each frame; of another aircraft, which took the frames of another folder, it is another one."""
    cameras: dict[str, Camera] = {
        one.name: (aircraft[one.name], size_of(one), len(one.display.black)) for one in frames
    }
    estimates = {camera: VignettingEstimate(settings) for camera in cameras.values()}
    for name, other, means in overlaps:
        if aircraft[name] == aircraft[other]:
            estimates[cameras[name]] = estimates[cameras[name]].after(means.radial)
    curves = {camera: estimate.curves for camera, estimate in estimates.items()}
    return {name: curves[camera] for name, camera in cameras.items()}


def levels_of(frames: Iterable[RenderItem], distances: Sequence[float | None]) -> Iterator[int]:
    """The level of each frame by its ground sampling distance and those of its island; 0 if it sees no ground."""
    of_island: dict[int, list[float]] = {}
    given = list(zip(frames, distances, strict=True))
    for one, distance in given:
        if distance is not None:
            of_island.setdefault(one.island, []).append(distance)
    usual = {island: float(np.quantile(some, FINER)) for island, some in of_island.items()}
    return (0 if distance is None else level_among(distance, usual[one.island]) for one, distance in given)


@lru_cache(256)
def _looks(artefacts: Artefacts, key: str, part: int) -> list[tuple[object, object, object, int]]:
    found: list[tuple[object, object, object, int]] = artefacts.part(key, f"looks {part}")
    return found


def painted_frame(artefacts: Artefacts, one: BookedFrame, key: str, part: int, place: int) -> RenderItem:
    """A frame as it is painted; its look lies at a place of a part of `key`. Raises Lost."""
    gain, vignetting, light, level = _looks(artefacts, key, part)[place]
    lit = {"gain": gain, "vignetting": vignetting, "light": light}
    return replace(uncompensated(artefacts, one), **lit, level=level)  # type: ignore[arg-type]

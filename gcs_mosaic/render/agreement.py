"""Exposure agreement between painted frames: overlaps of thumbnails, and the gains that follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from gcs_mosaic.render.count_steps import CountsInOverlap, counts_in_overlap
from gcs_mosaic.render.exposure import (
    ExposureSettings,
    Gain,
    Observation,
    OverlapMeans,
    overlap_means,
    seen_from,
    solve_gains,
)
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.vignetting import Vignetting
from gcs_mosaic.stitch.arrays import Bands, Levels, Mask, PointsNx2
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels, pixels_from_canvas

SATURATED = 65_535  # counts
Overlap = tuple[str, str, OverlapMeans]  # frame i, frame j, their overlap


def overlap_of(i: RenderItem, small_i: Levels, j: RenderItem, small_j: Levels) -> OverlapMeans | None:
    """Overlap of two frames in their thumbnails (h, w, bands) in grey levels; None if empty."""
    return overlap_means(small_i, small_j, _mapping(i, small_i, j, small_j))


def counts_overlap_of(i: RenderItem, small_i: Bands, j: RenderItem, small_j: Bands) -> CountsInOverlap | None:
    """What two frames have in common in their thumbnails (h, w, bands) of counts; None if next to nothing."""
    counts_i, counts_j = small_i.astype(np.float32), small_j.astype(np.float32)
    _, _, seen, shared = seen_from(counts_i, counts_j, _mapping(i, counts_i, j, counts_j))
    for counts in (counts_i, seen):
        shared &= ((counts > 0) & (counts < SATURATED)).all(axis=-1)
    return counts_in_overlap(counts_i[shared], seen[shared].astype(np.float32))


def _mapping(i: RenderItem, small_i: Levels, j: RenderItem, small_j: Levels) -> Callable[[PointsNx2], PointsNx2]:
    """From pixels (n, 2) of a thumbnail to those of another, NaN for nowhere."""
    scale_i, scale_j = i.camera.width / small_i.shape[1], j.camera.width / small_j.shape[1]

    def j_from_i(pixels: PointsNx2) -> PointsNx2:
        places = canvas_from_pixels(i.pose, i.camera, (pixels + 0.5) * scale_i - 0.5)
        there = (pixels_from_canvas(j.pose, j.camera, places) + 0.5) / scale_j - 0.5
        alive = _is_alive(i, scale_i, pixels, small_i)
        alive &= _is_alive(j, scale_j, there, small_j)
        return np.where(alive[:, None], there, np.nan)

    return j_from_i


def _is_alive(painted: RenderItem, scale: float, pixels: PointsNx2, thumbnail: Levels) -> Mask:
    """Which pixels (n, 2) of a thumbnail, or places between them, depend on live pixels without an overlay only."""
    height, width = thumbnail.shape[:2]
    alive = painted.dead.scaled(1 / scale).spares(pixels, width, height)
    return alive if painted.still is None else alive & ~painted.still.covers(np.nan_to_num(pixels), width, height)


def agreed_gains(
    frames: Iterable[RenderItem],
    overlaps: Sequence[Overlap],
    curves: Mapping[str, Vignetting],
    settings: ExposureSettings,
) -> dict[str, Gain]:
    """The gain of each frame from all overlaps; `curves`: vignetting by name."""
    kinds: dict[tuple[int, bool], list[RenderItem]] = {}  # frames of different kinds are not comparable in exposure
    for painted in frames:
        kinds.setdefault(painted.display.kind, []).append(painted)
    gains: dict[str, Gain] = {}
    for (bands, _), alike in kinds.items():
        names = {painted.name: number for number, painted in enumerate(alike)}
        seen: list[Observation] = [
            (names[i], names[j], means.flattened(curves[i], curves[j])) for i, j, means in overlaps if i in names
        ]
        gains |= dict(zip(names, solve_gains(len(names), seen, settings, bands), strict=True))
    return gains

"""Exposure agreement between painted frames: overlaps of thumbnails, and the gains that follow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gcs_mosaic.render.count_steps import CountsInOverlap, counts_in_overlap
from gcs_mosaic.render.exposure import (
    ExposureSettings,
    Gain,
    Observation,
    OverlapMeans,
    bounded,
    log_gains,
    overlap_means,
    pixels_of,
    seen_from,
)
from gcs_mosaic.render.light_field import LightBeside, LightField, at_places, lacking, nodes, shown_part
from gcs_mosaic.render.render_list import RenderItem, log_compensation
from gcs_mosaic.render.vignetting import Vignetting
from gcs_mosaic.stitch.arrays import AnyArray, Bands, FloatRows, Levels, Mask, PointsNx2
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixels_from_canvas

SATURATED = 65_535  # counts
Aircraft = int | None  # None: the only one
Overlap = tuple[str, str, OverlapMeans]  # frame i, frame j, their overlap
Look = tuple[Gain, LightField | None]


def overlap_of(i: RenderItem, small_i: Levels, j: RenderItem, small_j: Levels) -> OverlapMeans | None:
    """Overlap of two frames in their thumbnails (h, w, bands) in grey levels; None if empty."""
    return overlap_means(small_i, small_j, _places_in(j, small_j, i, small_i))


def counts_overlap_of(i: RenderItem, small_i: Bands, j: RenderItem, small_j: Bands) -> CountsInOverlap | None:
    """What two frames have in common in their thumbnails (h, w, bands) of counts; None if next to nothing."""
    counts_i, counts_j = small_i.astype(np.float32), small_j.astype(np.float32)
    _, seen, shared = seen_from(counts_i, counts_j, _places_in(j, counts_j, i, counts_i))
    for counts in (counts_i, seen):
        shared &= ((counts > 0) & (counts < SATURATED)).all(axis=-1)
    return counts_in_overlap(counts_i[shared], seen[shared].astype(np.float32))


def _places_in(j: RenderItem, small_j: Levels, i: RenderItem, small_i: Levels) -> PointsNx2:
    """Where in thumbnail j the pixels of thumbnail i are, as in `pixels_of`; NaN for nowhere."""
    (height, width), scale_j = small_i.shape[:2], j.camera.width / small_j.shape[1]
    there = (pixels_from_canvas(j.pose, j.camera, _on_canvas(i.pose, i.camera, width, height)) + 0.5) / scale_j - 0.5
    alive = _is_alive(i, i.camera.width / width, pixels_of(width, height), small_i)
    alive &= _is_alive(j, scale_j, there, small_j)
    return np.where(alive[:, None], there, np.nan)


@lru_cache(1)  # a new frame is compared with each around it
def _on_canvas(pose: Pose, camera: Camera, width: int, height: int) -> PointsNx2:
    """Canvas places of the pixels of a frame's thumbnail, as in `pixels_of`."""
    return canvas_from_pixels(pose, camera, (pixels_of(width, height) + 0.5) * (camera.width / width) - 0.5)


def _is_alive(painted: RenderItem, scale: float, pixels: PointsNx2, thumbnail: Levels) -> Mask:
    """Which pixels (n, 2) of a thumbnail, or places between them, depend on live pixels without an overlay only."""
    height, width = thumbnail.shape[:2]
    alive = painted.dead.scaled(1 / scale).spares(pixels, width, height)
    if painted.area is not None:
        alive &= painted.area.spares(pixels, width, height, 0.5)
    return alive if painted.still is None else alive & ~painted.still.covers(np.nan_to_num(pixels), width, height)


def agreed_looks(
    frames: Iterable[RenderItem],
    overlaps: Sequence[Overlap],
    curves: Mapping[str, Vignetting],
    settings: ExposureSettings,
    aircraft: Mapping[str, Aircraft],
) -> dict[str, Look]:
    """Gain and light field of each frame from all overlaps; `curves`, `aircraft`: vignetting, and whose camera, by name."""
    kinds: dict[tuple[int, bool], list[RenderItem]] = {}  # frames of different kinds are not comparable in exposure
    for painted in frames:
        kinds.setdefault(painted.display.kind, []).append(painted)
    looks: dict[str, Look] = {}
    for alike in kinds.values():
        gains = _agreed_gains(alike, overlaps, curves, settings, aircraft)
        looks |= _lit([replace(one, gain=gains[one.name], vignetting=curves[one.name]) for one in alike], overlaps)
    return {name: (bounded(np.log(np.array(gain)), settings), light) for name, (gain, light) in looks.items()}


def _agreed_gains(
    frames: Sequence[RenderItem],
    overlaps: Sequence[Overlap],
    curves: Mapping[str, Vignetting],
    settings: ExposureSettings,
    aircraft: Mapping[str, Aircraft],
) -> dict[str, Gain]:
    """The gain of each frame of one kind, beside those that the same camera took in close succession: in an archive the frames
    of one aircraft may come all together, so its own frames between two are counted as well."""
    names = {painted.name: number for number, painted in enumerate(frames)}
    streams, turns = len(set(aircraft.values())), _turns(frames, aircraft)
    seen: list[Observation] = [
        (names[i], names[j], means.flattened(curves[i], curves[j]))
        for i, j, means in overlaps
        if i in names
        and aircraft[i] == aircraft[j]
        and abs(turns[i] - turns[j]) <= settings.around
        and are_near(frames[names[i]], frames[names[j]], settings, streams)
    ]
    logs = log_gains(len(names), seen, settings, len(frames[0].display.black))
    return {name: bounded(row, settings) for name, row in zip(names, logs, strict=True)}


def are_near(one: RenderItem, other: RenderItem, settings: ExposureSettings, streams: int) -> bool:
    """Whether two frames of one camera were taken in close succession; `streams`: cameras whose frames may lie between."""
    return abs(one.order - other.order) <= settings.around * streams


def _turns(frames: Sequence[RenderItem], aircraft: Mapping[str, Aircraft]) -> dict[str, int]:
    """Of each frame, how many its own camera took before it."""
    taken: Counter[Aircraft] = Counter()
    turns: dict[str, int] = {}
    for one in sorted(frames, key=lambda painted: painted.turn):
        turns[one.name] = taken[aircraft[one.name]]
        taken[aircraft[one.name]] += 1
    return turns


def _lit(frames: Sequence[RenderItem], overlaps: Sequence[Overlap]) -> dict[str, Look]:
    """Gain and light field of frames of one kind, given with gain and vignetting. Over the ground that overlapping frames of
    an island show, what gains and light fields add has together the mean logarithm 0, and what is taken out as vignetting the
    median 0: no map is brighter or darker than its photographs."""
    seen = _seen_beside({painted.name: painted for painted in frames}, overlaps)
    lights: dict[str, LightField | None] = {}
    parts: dict[int, list[tuple[AnyArray, AnyArray, AnyArray]]] = {}  # of each island
    for one in frames:
        beside = [_beside(one, other, light) for other, light in seen[one.name]]
        lights[one.name] = lacking(_aspect(one), beside)
        if beside:
            ground = np.exp(2 * one.pose.log_gsd) * one.camera.width * one.camera.height
            gain = np.log(np.array(one.gain))
            taken_out = log_compensation(one, nodes()) - gain
            logs = np.broadcast_to(gain + at_places(lights[one.name], nodes()), taken_out.shape)
            parts.setdefault(one.island, []).append((shown_part(_aspect(one), beside) * ground, logs, taken_out))
    even = {
        island: _evening(*(np.concatenate(one) for one in zip(*some, strict=True))) for island, some in parts.items()
    }
    gains = {one.name: np.array(one.gain) * (even[one.island] if seen[one.name] else 1) for one in frames}
    return {name: (tuple(gain.tolist()), lights[name]) for name, gain in gains.items()}


def _evening(areas: AnyArray, logs: AnyArray, taken_out: AnyArray) -> AnyArray:
    """Factors (bands,) that make places (n, ...) of these areas (n, 1) as bright as their photographs: `logs` (n, bands) from
    gains and light, and `taken_out` (n, bands) as vignetting, of which the median is held: a dark spot of a lens is brightened
    on the map, and all else is not to be darkened for it."""
    order = np.argsort(taken_out, axis=0)
    before = np.cumsum(areas[order, 0], axis=0) / areas.sum()
    middle = [taken_out[order[np.searchsorted(before[:, band], 0.5), band], band] for band in range(logs.shape[1])]
    return np.asarray(np.exp(-(areas * logs).sum(axis=0) / areas.sum() - middle))


def _seen_beside(
    frames: Mapping[str, RenderItem], overlaps: Sequence[Overlap]
) -> dict[str, list[tuple[RenderItem, LightBeside]]]:
    """What is seen beside each frame."""
    seen: dict[str, list[tuple[RenderItem, LightBeside]]] = {name: [] for name in frames}
    for i, j, means in overlaps:
        if means.light is not None and i in frames and j in frames:
            seen[i].append((frames[j], means.light[0]))
            seen[j].append((frames[i], means.light[1]))
    return seen


def field_beside(new: RenderItem, beside: Iterable[tuple[RenderItem, LightBeside]], own: float) -> LightField | None:
    """The light field of a new frame beside frames that stay as they are; `own`: how much its own light counts."""
    return lacking(_aspect(new), [_beside(new, other, light, shown=True) for other, light in beside], own)


def _beside(
    one: RenderItem, other: RenderItem, light: LightBeside, *, shown: bool = False
) -> tuple[FloatRows, AnyArray]:
    """Weights (nodes, 1) and log brightness (nodes, bands) of a frame beside another one, less the latter's; `shown`: with the
    light field that it has."""
    rows = light.rows
    weight, there, brighter = rows[:, :1], rows[:, 1:3], rows[:, 3:]
    brighter = brighter + log_compensation(other, there) - log_compensation(one, nodes())
    return weight, brighter + at_places(other.light, there) if shown else brighter


def _aspect(painted: RenderItem) -> float:
    return painted.camera.height / painted.camera.width

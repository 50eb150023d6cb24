"""Stage 2, of what stands still in the pictures: overlays are masked, and faint pictures freed of it and searched again.

A frame is freed of the mean of those of its camera around it in the archive's order, because sensors drift and recalibrate; what
an overlay covers is found in the same way in their textures. Pictures are summed in blocks; the mean is that of the blocks with
the nearest MEMORY frames. A frame that shows the ground of the one before is not counted: where an aircraft hovers blocks are
empty, and the mean reaches beyond. Frames that are not faint and have no overlay stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.cameras import by_camera
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import TOGETHER, SeenFrame, parts_of, whole_features
from gcs_mosaic.archive.tasks import Parts, StageTask, task
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings
from gcs_mosaic.stitch.features.faint import blurred_faint
from gcs_mosaic.stitch.features.fixed_pattern import (
    LEAST_FRAMES,
    MEMORY,
    clipped,
    freed,
    same_ground,
    shows_same_ground,
)
from gcs_mosaic.stitch.features.still import LEAST_GROUNDS, Grounds

BLOCK = 16  # frames of one sum


def without_pattern(engine: Engine, frames: Sequence[SeenFrame], settings: FeatureSettings) -> list[SeenFrame]:
    """The frames, those with faint pictures or an overlay with other features."""
    patterns = _around_each(
        engine, "fixed patterns", [one for one in frames if one.facts.faint], pattern_sum, LEAST_FRAMES
    )
    grounds = _around_each(engine, "grounds", frames, ground_sum, LEAST_GROUNDS)
    masks = {blocks: task(still_mask, blocks) for blocks in grounds.values() if blocks}
    covered = dict(zip(masks, engine.made("overlays", list(masks.values())), strict=True))
    tasks: dict[str, StageTask] = {}
    for one in frames:
        of_faint, of_textures = patterns.get(one.key, ()), grounds[one.key]
        if of_faint or covered.get(of_textures) is not None:
            tasks[one.key] = task(freed_features, one.key, of_faint, of_textures, settings)
    if not tasks:
        return list(frames)
    found = dict(zip(tasks, engine.made("faint features", list(tasks.values()), TOGETHER), strict=True))
    return [
        replace(one, key=tasks[one.key].key, facts=replace(one.facts, features=found[one.key]))
        if one.key in tasks
        else one
        for one in frames
    ]


def _around_each(
    engine: Engine, stage: str, frames: Sequence[SeenFrame], of_block: Callable[..., Parts], least: int
) -> dict[str, tuple[str, ...]]:
    """By the key of each frame, the sums of its camera's frames around it; none where there are fewer than `least` to count."""
    cameras: dict[Hashable, list[str]] = {}
    for one, camera in zip(frames, by_camera(frames, LEAST_FRAMES), strict=True):
        cameras.setdefault(camera, []).append(one.key)
    sums = [_sums(keys, of_block) for keys in cameras.values()]
    counted = iter(engine.made(stage, [one for some in sums for one in some], 2) if sums else ())
    found: dict[str, tuple[str, ...]] = {}
    for keys, some in zip(cameras.values(), sums, strict=True):
        around = _around([one.key for one in some], [next(counted) for _ in some], least)
        found |= {key: around[at // BLOCK] for at, key in enumerate(keys)}
    return found


def _sums(keys: Sequence[str], of_block: Callable[..., Parts]) -> list[StageTask]:
    """A task for each block of one camera's frames."""
    starts = range(0, len(keys), BLOCK)
    return [task(of_block, tuple(keys[at : at + BLOCK]), keys[at - 1] if at else None) for at in starts]


def _around(blocks: Sequence[str], counts: Sequence[int], least: int = LEAST_FRAMES) -> list[tuple[str, ...]]:
    """Of each block those that hold the MEMORY counted frames around its middle; nothing where there are too few in all."""
    ends = np.cumsum(counts)
    if ends[-1] < least:
        return [()] * len(blocks)
    starts = ends - counts
    low = np.clip((starts + ends - MEMORY) / 2, 0, max(0, ends[-1] - MEMORY))
    first, stop = np.searchsorted(ends, low, "right"), np.searchsorted(starts, low + MEMORY)
    return [tuple(blocks[at] for at in range(*some) if counts[at]) for some in zip(first, stop, strict=True)]


def pattern_sum(artefacts: Artefacts, frames: tuple[str, ...], before: str | None) -> Parts:
    """The sum of a block of faint pictures, and how many are in it: those that show other ground than the last one. `before`:
    the frame before them."""
    last = None if before is None else blurred_faint(artefacts.part(before, "faint"))
    count, total = 0, np.zeros_like(artefacts.part(frames[0], "faint"), np.int16)
    for key in frames:
        faint = artefacts.part(key, "faint")
        blurred = blurred_faint(faint)
        if last is None or not same_ground(blurred, last):
            count, last = count + 1, blurred
            total += clipped(faint).astype(np.int16)
    return {"summary": count, "sum": total}


def ground_sum(artefacts: Artefacts, frames: tuple[str, ...], before: str | None) -> Parts:
    """The sum of a block of textures and that of their squares, and how many are in it, as `pattern_sum`."""
    last = None if before is None else _pictures(artefacts, before)
    count, total, square = 0, np.zeros(1, np.int16), np.zeros(1, np.float32)
    for key in frames:
        pictures = _pictures(artefacts, key)
        texture = pictures.texture
        if texture is None or (count and texture.shape != total.shape):
            continue
        if last is None or not shows_same_ground(pictures, last):
            count, last = count + 1, pictures
            total = total + texture.astype(np.int16)
            square = square + Grounds.of(texture).square
    return {"summary": count, "sum": total, "square": square}


def _pictures(artefacts: Artefacts, key: str) -> Features:
    """A frame's faint picture and texture, without its features' descriptors. Raises Lost."""
    parts = {f"kept_{part}": artefacts.part(key, part) for part in ("faint", "texture")}
    places: Features = artefacts.part(key, "places")
    return replace(places, **parts)


def still_mask(artefacts: Artefacts, blocks: tuple[str, ...]) -> Parts:
    """What an overlay covers in all frames of these sums of textures."""
    return {"summary": _grounds(artefacts, blocks).still()}


def freed_features(
    artefacts: Artefacts, key: str, patterns: tuple[str, ...], grounds: tuple[str, ...], settings: FeatureSettings
) -> Parts:
    """What `features` makes, of a frame without what stands still in these blocks of faint pictures and of textures; and the
    number of features."""
    pattern = _mean(artefacts, patterns) if patterns else None
    known = _grounds(artefacts, grounds) if grounds else None
    mean, still = (None, None) if known is None else (known.mean, known.still())
    found = freed(whole_features(artefacts, key), pattern, settings, mean, still)
    return {"summary": len(found), **parts_of(found), "thumbnail": artefacts.part(key, "thumbnail")}


@lru_cache(4)
def _grounds(artefacts: Artefacts, blocks: tuple[str, ...]) -> Grounds:
    """The textures in these sums. Raises Lost."""
    count = sum(artefacts.part(key, "summary") for key in blocks)
    total = np.sum([artefacts.part(key, "sum") for key in blocks], axis=0, dtype=np.int32)
    square = np.sum([artefacts.part(key, "square") for key in blocks], axis=0, dtype=np.float64)
    return Grounds(count, (total / count).astype(np.float32), (square / count).astype(np.float32))


@lru_cache(4)
def _mean(artefacts: Artefacts, blocks: tuple[str, ...]) -> FloatImage:
    """The mean of all frames in these sums. Raises Lost."""
    total = np.sum([artefacts.part(key, "sum") for key in blocks], axis=0, dtype=np.int32)
    return np.asarray(total / sum(artefacts.part(key, "summary") for key in blocks), dtype=np.float32)

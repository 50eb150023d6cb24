"""Stage 2, of faint pictures: what stands still in them is taken out, and their features are found again.

A picture is freed of the mean of those of its camera around it in the archive's order, because sensors drift and recalibrate.
Pictures are summed in blocks; the mean is that of the blocks with the nearest MEMORY frames. A frame that shows the ground of
the one before is not counted: where an aircraft hovers blocks are empty, and the mean reaches beyond.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.cameras import by_camera
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import TOGETHER, SeenFrame, parts_of, whole_features
from gcs_mosaic.archive.tasks import Parts, StageTask, task
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.stitch.features.extraction import FeatureSettings
from gcs_mosaic.stitch.features.faint import blurred_faint
from gcs_mosaic.stitch.features.fixed_pattern import LEAST_FRAMES, MEMORY, clipped, freed, same_ground

BLOCK = 16  # frames of one sum


def without_pattern(engine: Engine, frames: Sequence[SeenFrame], settings: FeatureSettings) -> list[SeenFrame]:
    """The frames, those with faint pictures with other features; without such pictures nothing is done."""
    faint = [one for one in frames if one.facts.faint]
    cameras: dict[Hashable, list[str]] = {}
    for one, camera in zip(faint, by_camera(faint, LEAST_FRAMES), strict=True):
        cameras.setdefault(camera, []).append(one.key)
    if not cameras:
        return list(frames)
    sums = [_sums(keys) for keys in cameras.values()]
    counted = iter(engine.made("fixed patterns", [one for some in sums for one in some], 2))
    tasks: dict[str, StageTask] = {}
    for keys, some in zip(cameras.values(), sums, strict=True):
        around = _around([one.key for one in some], [next(counted) for _ in some])
        for at, key in enumerate(keys):
            if blocks := around[at // BLOCK]:
                tasks[key] = task(freed_features, key, blocks, settings)
    found = dict(zip(tasks, engine.made("faint features", list(tasks.values()), TOGETHER), strict=True))
    return [
        replace(one, key=tasks[one.key].key, facts=replace(one.facts, features=found[one.key]))
        if one.key in tasks
        else one
        for one in frames
    ]


def _sums(keys: Sequence[str]) -> list[StageTask]:
    """A task for each block of one camera's faint pictures."""
    starts = range(0, len(keys), BLOCK)
    return [task(pattern_sum, tuple(keys[at : at + BLOCK]), keys[at - 1] if at else None) for at in starts]


def _around(blocks: Sequence[str], counts: Sequence[int]) -> list[tuple[str, ...]]:
    """Of each block those that hold the MEMORY counted frames around its middle; nothing where there are too few in all."""
    ends = np.cumsum(counts)
    if ends[-1] < LEAST_FRAMES:
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


def freed_features(artefacts: Artefacts, key: str, blocks: tuple[str, ...], settings: FeatureSettings) -> Parts:
    """What `features` makes, of a picture without the mean of these blocks; and the number of features."""
    found = freed(whole_features(artefacts, key), _mean(artefacts, blocks), settings)
    return {"summary": len(found), **parts_of(found), "thumbnail": artefacts.part(key, "thumbnail")}


@lru_cache(4)
def _mean(artefacts: Artefacts, blocks: tuple[str, ...]) -> FloatImage:
    """The mean of all frames in these sums. Raises Lost."""
    total = np.sum([artefacts.part(key, "sum") for key in blocks], axis=0, dtype=np.int32)
    return np.asarray(total / sum(artefacts.part(key, "summary") for key in blocks), dtype=np.float32)

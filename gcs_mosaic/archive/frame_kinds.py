"""Stage 3: how frames are shown, by their bands, those of counts by the camera; and which border is dead, by the camera."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.cameras import by_camera
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame, image_of
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.tasks import Parts, StageTask, task
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.display import Display, camera_display, display_of
from gcs_mosaic.render.repaint_queue import PaintSettings
from gcs_mosaic.stitch.camera.dead_border import FRAMES, BorderWatch, DeadBorder

FIRST = 24  # frames of a camera that are looked at: a flight knows a dead border after five
TRIED = 8  # frames for a display, of which one can be decoded


@dataclass(frozen=True, slots=True)
class FrameKind:
    """How frames of a kind are shown; their dead border, in pixels as painted and as taken."""

    display: Display
    dead: DeadBorder
    dead_as_taken: DeadBorder


def kinds_of(engine: Engine, frames: Sequence[SeenFrame], config: Config) -> list[FrameKind]:
    """The kind of each frame."""
    displays = _displays(engine, frames, config)
    borders = _borders(engine, frames, displays, config)
    return [
        FrameKind(display, dead, dead.scaled(one.facts.size[0] / one.facts.painted[0]))
        for one, display, dead in zip(frames, displays, borders, strict=True)
    ]


def _displays(engine: Engine, frames: Sequence[SeenFrame], config: Config) -> list[Display]:
    """How each frame is shown: one of 8 bits as the first of its number of bands, whatever its camera, as in a flight; those of
    counts in the range of their camera's frames, until more is known of them (`ranges`)."""
    settings = config.reduction, config.frames.max_pixels, config.paint.bands, config.paint.brightness == "auto"

    def of(some: Sequence[SeenFrame]) -> StageTask:
        return task(display, _digests(some[:TRIED]), *settings, hints=(_files(some[:TRIED]),))

    plain = [one for one in frames if not one.facts.counts]
    fixed = iter(_by_group(engine, "displays", plain, [one.facts.bands for one in plain], of))
    ranges = _ranges(frames, config.paint)
    return [ranges[one.frame.name] if one.facts.counts else next(fixed) for one in frames]


def _ranges(frames: Sequence[SeenFrame], settings: PaintSettings) -> dict[str, Display]:
    """Of each frame of counts the range of its camera's frames, but for those that show nothing."""
    cameras: dict[Hashable, list[SeenFrame]] = {}
    of_counts = [one for one in frames if one.facts.counts]
    for one, camera in zip(of_counts, by_camera(of_counts, FRAMES), strict=True):
        cameras.setdefault(camera, []).append(one)
    found: dict[str, Display] = {}
    for some in cameras.values():
        seen = [one.facts.counts for one in some if one.facts.features] or [some[0].facts.counts]
        shown = camera_display(seen, settings.bands, lighten=settings.brightness == "auto")
        found |= {one.frame.name: shown for one in some}
    return found


def _borders(
    engine: Engine, frames: Sequence[SeenFrame], displays: Sequence[Display], config: Config
) -> list[DeadBorder]:
    """The dead border of each frame, as the first of its camera show it."""
    shown = dict(zip((one.frame.name for one in frames), displays, strict=True))

    def of(some: Sequence[SeenFrame]) -> StageTask:
        told = shown[some[0].frame.name], config.reduction, config.frames.max_pixels
        return task(dead_border, _digests(some[:FIRST]), *told, hints=(_files(some[:FIRST]),))

    return _by_group(engine, "dead borders", frames, by_camera(frames, FRAMES), of)


def _by_group(
    engine: Engine,
    stage: str,
    frames: Sequence[SeenFrame],
    group: Sequence[Hashable],
    of: Callable[[Sequence[SeenFrame]], StageTask],
) -> list[Any]:
    """What a task has found of each group of frames, for each frame."""
    groups: dict[Hashable, list[SeenFrame]] = {}
    for one, of_group in zip(frames, group, strict=True):
        groups.setdefault(of_group, []).append(one)
    found = dict(zip(groups, engine.made(stage, [of(some) for some in groups.values()]), strict=True))
    return [found[one] for one in group]


def _digests(some: Sequence[SeenFrame]) -> tuple[str, ...]:
    return tuple(one.frame.content_hash for one in some)


def _files(some: Sequence[SeenFrame]) -> tuple[SourceFile, ...]:
    return tuple(one.frame.file for one in some)


def display(
    artefacts: Artefacts,
    digests: tuple[str, ...],
    reduction: int,
    max_pixels: int,
    bands: tuple[int, ...],
    lighten: bool,
    files: tuple[SourceFile, ...],
) -> Parts:
    """How frames are shown of which these are the first."""
    for file, digest in zip(files, digests, strict=True):
        image = image_of(file, digest, reduction, max_pixels)
        if image is not None:
            return {"summary": display_of(image, bands, lighten=lighten)}
    return {"summary": Display()}


def dead_border(
    artefacts: Artefacts,
    digests: tuple[str, ...],
    shown: Display,
    reduction: int,
    max_pixels: int,
    files: tuple[SourceFile, ...],
) -> Parts:
    """The dead border, as painted, of frames of which these are the first."""
    watch = BorderWatch()
    for file, digest in zip(files, digests, strict=True):
        image = image_of(file, digest, reduction, max_pixels)
        if image is not None:
            watch = watch.after(image, shown.levels)
    return {"summary": watch.border}

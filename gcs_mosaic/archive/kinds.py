"""Stage 3: of each kind of frame (size, bands, depth), how it is shown, and which border is dead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame, image_of
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.display import Display, display_of
from gcs_mosaic.stitch.camera.dead_border import BorderWatch, DeadBorder

FIRST = 24  # frames of a kind that are looked at: a flight knows a dead border after five


@dataclass(frozen=True, slots=True)
class FrameKind:
    """How frames of a kind are shown; their dead border, in pixels as painted and as taken."""

    display: Display
    dead: DeadBorder
    dead_as_taken: DeadBorder


def kinds_of(engine: Engine, frames: Sequence[SeenFrame], config: Config) -> list[FrameKind]:
    """The kind of each frame."""
    first: dict[object, list[SeenFrame]] = {}
    for one in frames:
        first.setdefault(one.facts.kind, []).append(one)
    settings = config.reduction, config.frames.max_pixels, config.paint.bands, config.paint.brightness == "auto"
    tasks = [
        task(
            kind,
            tuple(one.frame.content_hash for one in some[:FIRST]),
            *settings,
            hints=(tuple(one.frame.file for one in some[:FIRST]),),
        )
        for some in first.values()
    ]
    found = dict(zip(first, engine.made("kinds of frames", tasks), strict=True))
    return [_scaled(found[one.facts.kind], one) for one in frames]


def _scaled(found: tuple[Display, DeadBorder], frame: SeenFrame) -> FrameKind:
    display, dead = found
    return FrameKind(display, dead, dead.scaled(frame.facts.size[0] / frame.facts.painted[0]))


def kind(
    artefacts: Artefacts,
    digests: tuple[str, ...],
    reduction: int,
    max_pixels: int,
    bands: tuple[int, ...],
    lighten: bool,
    files: tuple[SourceFile, ...],
) -> Parts:
    """Display and dead border from the first frames of a kind."""
    display, watch = Display(), BorderWatch()
    for number, (file, digest) in enumerate(zip(files, digests, strict=True)):
        image = image_of(file, digest, reduction, max_pixels)
        if image is not None:
            display = display_of(image, bands, lighten=lighten) if number == 0 else display
            watch = watch.after(image, display.levels)
    return {"summary": (display, watch.border)}

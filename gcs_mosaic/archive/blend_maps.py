"""Stage 10: what painting wants to know of each frame (where it is sharp, what stands out), made once for all super-tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import TOGETHER, SeenFrame, image_of
from gcs_mosaic.archive.frame_kinds import FrameKind
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.tasks import Parts, Passing, task
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.frame_cache import seen_by
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.picture_area import filled


def looked_at(
    engine: Engine, frames: Sequence[SeenFrame], kinds: Sequence[FrameKind], config: Config
) -> list[SeenFrame]:
    """The frames, with their blend maps. Raises FlightFailed if an original is gone."""
    how = config.reduction, config.frames.max_pixels, config.paint.canvas.blend
    tasks = [
        task(
            blend_maps_of, one.frame.content_hash, kind.display, tuple(kind.dead), *how, hints=(one.frame.file, one.key)
        )
        for one, kind in zip(frames, kinds, strict=True)
    ]
    engine.made("sights", tasks, TOGETHER)
    return [replace(one, blend_maps=made.key) for one, made in zip(frames, tasks, strict=True)]


def blend_maps_of(
    artefacts: Artefacts,
    digest: str,
    display: Display,
    dead: tuple[int, int, int, int],
    reduction: int,
    max_pixels: int,
    blend: str,
    file: SourceFile,
    features: str,
) -> Parts:
    """What a blend mode wants to know of a frame. `features`: the key of those, which know where it holds a picture. Raises
    Passing if its original is gone, or another one."""
    image = image_of(file, digest, reduction, max_pixels)
    if image is None:
        raise Passing(f"{file.name} cannot be decoded any more")
    border = DeadBorder(*dead)
    ground = filled(image, border, artefacts.part(features, "places").area)
    return {"summary": None, "maps": seen_by(MODES[blend], display.picture(ground), (display, border))}

"""Stage 8: the relief displacement of each frame, from the ground that it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gcs_mosaic.archive.adjustment import PlacedChunk
from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.stitch.bundle.relief import displacement
from gcs_mosaic.stitch.camera.relief import ReliefSettings
from gcs_mosaic.stitch.graph.placement import Placement

TOGETHER = 1  # chunks of a batch: a second's work each


def with_relief(engine: Engine, chunks: Sequence[PlacedChunk], settings: ReliefSettings) -> list[tuple[str, list[str]]]:
    """The artefacts that hold the placements of each chunk, with the names of its frames."""
    tasks = [task(relief, chunk.key, chunk.part, settings) for chunk in chunks]
    names = engine.made("relief", tasks, TOGETHER)
    return [(one.key, some) for one, some in zip(tasks, names, strict=True)]


def relief(artefacts: Artefacts, key: str, part: int, settings: ReliefSettings) -> Parts:
    """The placements of a chunk."""
    before: list[Placement] = artefacts.part(key, f"placements {part}")
    grounds = artefacts.part(key, f"ground {part}")
    placements = [
        one if ground is None else replace(one, relief=displacement(one.pose, one.camera, ground, settings))
        for one, ground in zip(before, grounds, strict=True)
    ]
    return {"summary": [one.name for one in placements], "placements": placements}

"""The quality of an archive's islands; whatever keeps one from being measured keeps no map from being made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs_mosaic.archive.adjustment import PlacedChunk
from gcs_mosaic.archive.tasks import Made, StageTask, Unmade
from gcs_mosaic.archive.tearing import measured
from gcs_mosaic.stitch.camera.relief import ReliefSettings
from gcs_mosaic.stitch.graph.tearing import HeldOut

FOUND: dict[int, Made | Unmade] = {
    0: Made((1.5, 4.0, 200), 0.1),
    1: Unmade("it could not be processed"),
    2: Made(None, 0.1),
}


class Told:
    """An engine whose tasks bring what was told of their islands."""

    def run(self, stage: str, tasks: Sequence[StageTask]) -> list[Made | Unmade]:
        return [FOUND[one.arguments[0]] for one in tasks]

    def listed(self, values: Sequence[Any]) -> str:
        return f"lists/{'-'.join(values)}"


def test_an_island_that_cannot_be_measured_has_no_figure_and_ends_nothing() -> None:
    chunks = [PlacedChunk(island, f"adjusted/{island}", 0, 30, "islands") for island in FOUND]
    alone = PlacedChunk(3, "lone/3", 0, 1, None)
    placed = [f"relief/{number}" for number in range(4)]
    found = measured(Told(), [*chunks, alone], placed, ReliefSettings())  # type: ignore[arg-type]
    assert found == {0: HeldOut(1.5, 4.0, 200)}

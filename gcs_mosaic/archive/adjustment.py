"""Stage 7: one joint adjustment of each island. Subtrees of a large one are tasks for the other workers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from distributed import worker_client

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.islands import CHUNK, Assembled
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.stitch.bundle.island import AdjustedIsland, IslandTask, adjusted, adjusted_lenses, found_cameras
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.placement import Placement

SPREAD_FROM = 10_000  # frames of an island from which its subtrees are worth sending


@dataclass(frozen=True, slots=True)
class PlacedChunk:
    """Some frames of an island after its adjustment: part `part` of the artefact `key`. `matches`: the artefact that says what
    links them, None if nothing does."""

    island: int
    key: str
    part: int
    frames: int
    matches: str | None


def adjusted_islands(engine: Engine, found: Assembled) -> list[PlacedChunk]:
    """The islands' frames, adjusted, in chunks."""
    linked = dict(found.tasks)
    alone = sorted(set(found.placed.values()) - linked.keys())
    tasks = {island: task(adjustment, found.key, island, count >= SPREAD_FROM) for island, count in linked.items()}
    tasks |= {island: task(lone, found.key, island) for island in alone}
    chunks = engine.made("adjustment", list(tasks.values()))
    return [
        PlacedChunk(island, one.key, number, count, found.key if island in linked else None)
        for (island, one), counts in zip(tasks.items(), chunks, strict=True)
        for number, count in enumerate(counts)
    ]


def lone(artefacts: Artefacts, key: str, island: int) -> Parts:
    """An island without links stays as it is."""
    placements = artefacts.part(key, f"placements {island}")
    return {"summary": [len(placements)], "placements 0": placements}


def adjustment(artefacts: Artefacts, key: str, island: int, spread: bool) -> Parts:
    """An island's placements after its adjustment, without relief, in chunks."""
    one: IslandTask = artefacts.part(key, f"adjustment {island}")
    before: Sequence[Placement] = artefacts.part(key, f"placements {island}")
    found = adjusted(one, on_workers if spread else map)
    placements = placed(one, found, before)
    chunks = [placements[at : at + CHUNK] for at in range(0, len(placements), CHUNK)]
    return {"summary": [len(chunk) for chunk in chunks], **{f"placements {n}": chunk for n, chunk in enumerate(chunks)}}


def placed(one: IslandTask, found: AdjustedIsland, before: Sequence[Placement]) -> list[Placement]:
    """The placements (n) of an island by its adjustment; `before` it, in the same order."""
    cameras = found_cameras(one, found)
    scales = one.problem.half_diagonal / one.problem.unit_px  # of a camera
    numbers = one.problem.camera.tolist()
    hops = _hops(before, before[one.root].name)
    deviations = [lens.focal_log_deviation for lens in adjusted_lenses(one, found).values()]
    return [
        replace(
            placement,
            pose=Pose(*found.poses[row].tolist()),
            camera=cameras[numbers[row]],
            relief=None,
            residual_px=float(found.residuals[row] * scales[numbers[row]]),
            hops=hops[placement.name],
            corner_deviation_px=float(found.deviations_px[row]),
            focal_log_deviation=deviations[numbers[row]],
        )
        for row, placement in enumerate(before)
    ]


def _hops(placements: Sequence[Placement], root: str) -> dict[str, int]:
    """Fewest links from the root to each frame."""
    linked = {placement.name: placement.neighbours for placement in placements}
    hops, waiting = {root: 0}, [root]
    for name in waiting:
        new = [other for other in linked[name] if other not in hops and other in linked]
        hops |= dict.fromkeys(new, hops[name] + 1)
        waiting += new
    return hops


def on_workers(work: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
    """As `map`, by other workers; for use within a task."""
    with worker_client() as client:
        given = client.scatter(list(items), hash=False)
        found: list[Any] = client.gather(client.map(work, given, pure=False))
        return found

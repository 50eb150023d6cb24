"""What memory the serial stages of large archives take: placing in stretches, joining, the islands and their adjustment.

    python -m tests.benchmarks.archive_memory [FRAMES ...] [--given LENGTH] [--workers 2]

No pictures and no matching: `archive_of_points` puts into a store what features and pairs would have brought. Each task then runs
as in an archive, but in a process of its own, `--workers` at a time. By stage: tasks, seconds of a core in all and of the longest
task, the most memory of any task's process (MB; an empty one takes the first figure told), and what its artefacts take on the
disk. The client is this process: what it held at most since the store was filled. Error: RMS distance of inner corners of frames
from the truth, after one similarity.

`--given`: frames are placed in parts of so many at once, near their true poses and linked, instead of one after another; for
archives whose stretches take hours. Such a part is as a stretch, or several joined, would have left it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np

from gcs_mosaic.archive import adjustment, stretches
from gcs_mosaic.archive.adjustment import PlacedChunk, adjusted_islands
from gcs_mosaic.archive.artefacts import Artefacts, Lost
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import places_of
from gcs_mosaic.archive.islands import assembled
from gcs_mosaic.archive.look_up import NumberedFrame
from gcs_mosaic.archive.stretches import STRETCH, Lists, _begun
from gcs_mosaic.archive.tasks import Batch, Made, Parts, StageTask, Unmade, artefacts_at, run_batch
from gcs_mosaic.archive.versions import versions
from gcs_mosaic.stitch.arrays import PosesNx6
from gcs_mosaic.stitch.camera.geometry import Pose, moved_by_similarity
from gcs_mosaic.stitch.camera.projection import lens_row, pose_row
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.graph.view_graph import Lens
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.stitch.registration.outcome import Registration
from tests.benchmarks.archive_of_points import ArchiveOfPoints, archive_of_points
from tests.benchmarks.survey_of_matches import CAMERA, rms_error_px

COUNTS = (3000, 10_000)
ARCHIVE = "archive"
# What is off in a given part: pixels, shares and radians of each frame; and what it knows of its lens.
OFF = np.array([0.5, 0.5, 5e-4, 5e-4, 5e-4, 5e-4])
LENS_INFORMATION = 1e6
TITLES = ("tasks", "core s", "longest", "MB", "disk MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", nargs="*", type=int, default=COUNTS)
    parser.add_argument("--given", type=int, help="frames of a part that is given")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--kept", type=Path, help="a folder for what frames and pairs have brought: it is not made again"
    )
    asked = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    for count in asked.frames:
        with tempfile.TemporaryDirectory(prefix="gcs-mosaic-benchmark-") as folder:
            store = folder if asked.kept is None else f"{asked.kept}/{count}"
            measured(count, store, asked.given, asked.workers)


def measured(count: int, folder: str, given_length: int | None, workers: int) -> None:
    with processes(1) as pool:
        archive = pool.submit(made_archive, folder, count).result()
    forget_peak()
    engine = FreshProcesses(folder, workers)
    print(f"{count} frames, {len(archive.known.found) / count:.1f} pairs a frame", flush=True)
    print(f"{'':28}" + "".join(f"{title:>9}" for title in TITLES), flush=True)
    adjustment.SPREAD_FROM = count + 1  # there is no cluster: the whole of it in one process
    if given_length is not None:
        stretches.stretch = given
    found = assembled(engine, archive.frames, archive.known, StitchSettings(), given_length or STRETCH)
    chunks = adjusted_islands(engine, found)
    print(f"client {peak_mb():.0f} MB; {len(found.placed)} placed, islands of {[n for _, n in found.tasks]}", end="")
    errors = [error_px(engine.artefacts, chunks, island, archive.poses) for island, _ in found.tasks]
    print(f", errors {', '.join(f'{error:.3f}' for error in errors)} px", flush=True)


def made_archive(folder: str, count: int) -> ArchiveOfPoints:
    Path(folder).mkdir(parents=True, exist_ok=True)
    artefacts = artefacts_at(folder)
    with suppress(Lost):
        return ArchiveOfPoints(*(artefacts.part(ARCHIVE, part) for part in ("frames", "known", "poses")))
    archive = archive_of_points(artefacts, count)
    artefacts.put(ARCHIVE, {"frames": archive.frames, "known": archive.known, "poses": archive.poses})
    return archive


def error_px(artefacts: Artefacts, chunks: Sequence[PlacedChunk], island: int, truth: PosesNx6) -> float:
    """RMS error of an island."""
    of_island = (chunk for chunk in chunks if chunk.island == island)
    placed = [one for chunk in of_island for one in artefacts.part(chunk.key, f"placements {chunk.part}")]
    lens = np.array(lens_row(placed[0].camera))
    return rms_error_px(np.array([pose_row(one.pose) for one in placed]), lens, truth[[number_of(p) for p in placed]])


def number_of(frame: Placement | NumberedFrame) -> int:
    return int(frame.name.partition(".")[0])


def given(artefacts: Artefacts, frames: str, pairs: str, settings: StitchSettings) -> Parts:
    """In place of a stretch: its frames near their true places on a canvas of their own, and all links among them."""
    found = _begun(artefacts, Lists((frames,), (pairs,)), settings)
    mosaic, numbered = found.mosaic, artefacts.part(frames, "list")
    graph = mosaic._graph
    truth = artefacts.part(ARCHIVE, "poses")[[number_of(one) for one in numbered]]
    rng = np.random.default_rng(number_of(numbered[0]))
    own = float(rng.normal(0, 0.1)), float(rng.uniform(-3, 3)), rng.normal(0, 1e3, 2)
    for one in numbered:
        graph.turn_to(graph.order + 1, one.folder)
        graph.append(one.name, places_of(artefacts, one.key, one.dead))
    poses = [Pose(*row) for row in (truth + rng.normal(size=truth.shape) * OFF).tolist()]
    moved = [moved_by_similarity(pose, np.exp(own[0]), *own[1:]) for pose in poses]
    lens = Lens(CAMERA, np.eye(5) * LENS_INFORMATION)
    graph.put_all(range(len(moved)), moved, graph.found_island(), {0: lens})
    for (a, b), _ in artefacts.part(pairs, "list"):
        one, other = (graph.frames[graph.numbers[found.book.name(frame)]] for frame in (a, b))
        registration = found.book.found(one.name, other.name, one.features, other.features)
        if isinstance(registration, Registration):
            graph.link(graph.numbers[one.name], graph.numbers[other.name], registration)
    return found.parts()


class FreshProcesses(Engine):
    """Runs each task in a process of its own, and prints what the stage has taken."""

    def __init__(self, store: str, workers: int) -> None:
        self._store = store
        self._workers_at_once = workers
        self._lists = {}

    def run(self, stage: str, tasks: Sequence[StageTask], batch: int = 1) -> list[Made | Unmade]:
        with processes(self._workers_at_once) as pool:
            found = list(pool.map(run_alone, [self._store] * len(tasks), tasks))
        costs = [outcome.seconds for outcome, _ in found if isinstance(outcome, Made)]
        disk = sum(self.artefacts.files.size(one.key) or 0 for one in tasks) / 1e6
        columns = sum(costs), max(costs, default=0.0), max(peak for _, peak in found), disk
        print(f"{stage:28}{len(tasks):9}" + "".join(f"{number:9.0f}" for number in columns), flush=True)
        return [outcome for outcome, _ in found]


def processes(count: int) -> ProcessPoolExecutor:
    """Each for one task."""
    return ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), max_tasks_per_child=1)


def run_alone(store: str, one: StageTask) -> tuple[Made | Unmade, float]:
    """The outcome of a task, and the most memory of this process."""
    return run_batch(Batch(store, (one,), versions()))[0], peak_mb()


def peak_mb() -> float:
    """The most memory that this process has had resident; unlike `ru_maxrss` without that of the one that started it."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024


def forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


if __name__ == "__main__":
    main()

"""Islands are adjusted while frames go on being placed; what came meanwhile is carried along."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, map_error, photograph

from gcs_mosaic.stitch.bundle import schedule as upkeep
from gcs_mosaic.stitch.bundle.island import AdjustedIsland, IslandTask, adjust_island, adjusted, island_task, take_in
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.schedule import UpkeepSettings
from gcs_mosaic.stitch.bundle.worker import WorkerFailed
from gcs_mosaic.stitch.camera.geometry import Pose, moved_by_similarity
from gcs_mosaic.stitch.camera.projection import pose_row
from gcs_mosaic.stitch.features.extraction import Features, extract
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

pytestmark = pytest.mark.long


SETTINGS = StitchSettings(upkeep=UpkeepSettings(background_from=5, meanwhile=2))
LINE = [Pose(350 + 90 * i, 600, 0.02 * (i % 3), 0.05 * i, 0.04, -0.03) for i in range(16)]


class FakeWorker:
    """Adjusts at once, and says that it is ready after having been asked some times."""

    def __init__(
        self, asked: int = 1, change: Callable[[AdjustedIsland], AdjustedIsland | WorkerFailed] = lambda found: found
    ) -> None:
        self._asked, self._change = asked, change
        self.tasks: list[IslandTask] = []

    def begin(self, task: IslandTask) -> None:
        self.tasks.append(task)
        self._left = self._asked

    def is_ready(self) -> bool:
        self._left -= 1
        return self._left <= 0

    def result(self) -> AdjustedIsland | WorkerFailed:
        return self._change(adjusted(self.tasks[-1]))


SEEN: dict[Pose, Features] = {}


def seen(ground: Image, pose: Pose) -> Features:
    """Found once for all tests here, which fly the same line over the same ground."""
    if pose not in SEEN:
        SEEN[pose] = extract(photograph(ground, pose, SMALL_CAMERA), SETTINGS.features)
    return SEEN[pose]


def flown(ground: Image, mosaic: Mosaic, poses: Iterable[Pose] = LINE) -> Mosaic:
    for i, pose in enumerate(poses):
        assert isinstance(mosaic.place(seen(ground, pose), str(i)), Placement)
        mosaic.adjust()
    return mosaic


def elsewhere(found: AdjustedIsland) -> AdjustedIsland:
    """The same map, turned, half as large and far away: as good a solution as any."""
    poses = [moved_by_similarity(Pose(*pose), 0.5, 1.0, np.array([9000.0, -700.0])) for pose in found.poses]
    return replace(found, poses=np.array([pose_row(pose) for pose in poses]))


def test_frames_that_came_meanwhile_go_where_their_neighbours_go(ground: Image) -> None:
    worker = FakeWorker(asked=3, change=elsewhere)
    mosaic = flown(ground, Mosaic(SETTINGS, worker))
    assert len(worker.tasks) >= 2
    assert min(p.pose.x for p in mosaic.placements()) > 5000
    assert map_error(mosaic.placements(), LINE) < 2


@pytest.mark.parametrize("asked", [pytest.param(1, marks=pytest.mark.thorough), 7])
def test_a_punctual_map_does_not_depend_on_how_fast_the_worker_is(ground: Image, asked: int) -> None:
    usual, other = FakeWorker(asked=2), FakeWorker(asked=asked)
    expected = [p.pose for p in flown(ground, Mosaic(SETTINGS, usual, punctual=True)).placements()]
    assert [p.pose for p in flown(ground, Mosaic(SETTINGS, other, punctual=True)).placements()] == expected
    assert [task.members for task in other.tasks] == [task.members for task in usual.tasks]


def test_small_islands_and_the_last_adjustment_are_not_left_to_the_worker(ground: Image) -> None:
    worker = FakeWorker()
    mosaic = flown(ground, Mosaic(SETTINGS, worker), LINE[:4])
    assert worker.tasks == []
    flown(ground, Mosaic(SETTINGS, worker), LINE[:8])
    begun = len(worker.tasks)
    assert begun > 0
    mosaic.adjust(everything=True)
    assert len(worker.tasks) == begun


class FailingWorker(FakeWorker):
    """It dies with its first tasks."""

    def __init__(self, failures: float) -> None:
        super().__init__()
        self._failures = failures

    def result(self) -> AdjustedIsland | WorkerFailed:
        return WorkerFailed("it has died") if len(self.tasks) <= self._failures else super().result()


def test_a_worker_that_dies_is_given_the_adjustment_again(ground: Image) -> None:
    worker = FailingWorker(failures=1)
    mosaic = flown(ground, Mosaic(SETTINGS, worker), LINE[:6])
    assert mosaic.problem == "it has died; it is tried again"
    assert len(worker.tasks) == 1  # after a pause
    flown_on(ground, mosaic, LINE[6:10])
    assert len(worker.tasks) > 1
    assert mosaic.problem is None
    mosaic.adjust(everything=True)
    assert map_error(mosaic.placements(), LINE[:10]) < 2


def test_an_adjustment_that_kills_the_worker_again_and_again_is_left_out_until_the_island_has_grown(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker, here = FailingWorker(failures=np.inf), list[int]()
    monkeypatch.setattr(upkeep, "adjust_island", lambda graph, *given: here.append(len(graph.frames)))
    mosaic = flown(ground, Mosaic(SETTINGS, worker), LINE[:5])
    for _ in range(20):
        mosaic.adjust()
    assert len(worker.tasks) == 3
    assert mosaic.problem == "it has died, 3 times in a row: this adjustment is left out until the map has grown"
    flown_on(ground, mosaic, LINE[5:6])
    assert len(worker.tasks) == 4
    mosaic.adjust(everything=True)
    assert len(worker.tasks) == 5
    assert mosaic.problem == "it has died: an island of 6 frames stays as it was adjusted before"
    assert max(here) < 5  # never in the process of the flight


def flown_on(ground: Image, mosaic: Mosaic, poses: Iterable[Pose]) -> None:
    for i, pose in enumerate(poses, len(mosaic.placements())):
        assert isinstance(mosaic.place(seen(ground, pose), str(i)), Placement)
        mosaic.adjust()


def test_in_a_pause_of_the_flight_the_worker_is_asked_again_too(ground: Image) -> None:
    worker = FailingWorker(failures=2)
    mosaic = flown(ground, Mosaic(SETTINGS, worker), LINE[:5])
    while mosaic.adjust_in_a_pause():
        pass
    assert len(worker.tasks) == 3
    assert mosaic.problem is None


def test_a_pause_is_used_until_all_is_adjusted(ground: Image) -> None:
    mosaic = Mosaic(replace(SETTINGS, upkeep=replace(SETTINGS.upkeep, per_doubling=1)), FakeWorker(asked=2))
    flown(ground, mosaic)
    assert mosaic.adjust_in_a_pause()
    while mosaic.adjust_in_a_pause():
        pass
    assert map_error(mosaic.placements(), LINE) < 2


def test_the_result_for_an_island_that_is_no_more_is_dropped(ground: Image) -> None:
    graph = flown(ground, Mosaic(), LINE[:5])._graph
    task = island_task(graph, 0, AdjustmentSettings())
    assert task is not None
    graph.put(3, graph.pose_of(3), 1)
    before = [graph.pose_of(frame) for frame in range(5)]
    assert not take_in(graph, task, elsewhere(adjusted(task)))
    assert [graph.pose_of(frame) for frame in range(5)] == before


@pytest.mark.parametrize("broken", [pytest.param("begin", marks=pytest.mark.thorough), "result"])
def test_a_worker_that_has_raised_is_never_out_of_step(
    ground: Image, monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    """It has begun, or answered, and then something raises: the map is what it would have been."""
    usual, other = FakeWorker(), FakeWorker()
    expected = [p.pose for p in flown(ground, Mosaic(SETTINGS, usual, punctual=True)).placements()]
    work = getattr(FakeWorker, broken)
    raised: list[object] = []

    def raising_once(self: FakeWorker, *task: IslandTask) -> object:
        found: object = work(self, *task)
        if len(raised) < 2:
            raised.append(found)
            raise MemoryError
        return found

    monkeypatch.setattr(FakeWorker, broken, raising_once)
    mosaic = Mosaic(SETTINGS, other, punctual=True)
    for i, pose in enumerate(LINE):
        mosaic.place(seen(ground, pose), str(i))
        while True:
            try:
                mosaic.adjust()
                break
            except MemoryError:
                continue
    assert len(raised) == 2
    assert [p.pose for p in mosaic.placements()] == expected


@pytest.mark.parametrize("detour", [False, pytest.param(True, marks=pytest.mark.thorough)])
def test_a_task_that_is_taken_back_is_not_answered_for_the_next_one(ground: Image, detour: bool) -> None:
    """All is put back as it was before the worker was given its task, and something else is asked of it."""
    worker = FakeWorker()
    mosaic = Mosaic(SETTINGS, worker, punctual=True)
    flown(ground, mosaic, LINE[:4])
    before = mosaic.snapshot()
    if detour:
        flown(ground, mosaic, LINE[4:8])
        assert worker.tasks
        mosaic.restore(before)
    again = [mosaic.place(seen(ground, pose), f"again {i}") for i, pose in enumerate(LINE[4:])]
    assert all(isinstance(outcome, Placement) for outcome in again)
    mosaic.adjust()
    assert mosaic.adjust_in_a_pause()  # the worker is at it
    assert len(worker.tasks[-1].members) == len(LINE)
    mosaic.adjust(everything=True)
    assert mosaic.problem is None
    assert map_error([replace(p, name=str(k)) for k, p in enumerate(mosaic.placements())], LINE) < 2


def test_an_island_that_cannot_be_adjusted_keeps_no_other_from_it(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    mosaic = Mosaic(SETTINGS)
    for i, pose in enumerate([*LINE[:3], *(replace(pose, y=1700) for pose in LINE[:3])]):
        mosaic.place(seen(ground, pose), str(i))
    tried: list[int] = []

    def failing(graph: ViewGraph, island: int, settings: AdjustmentSettings) -> None:
        tried.append(island)
        adjust_island(graph, island, settings)
        if island == 0:
            raise ValueError("singular")

    monkeypatch.setattr(upkeep, "adjust_island", failing)
    before = [p.pose for p in mosaic.placements()]
    with pytest.raises(ValueError, match="singular"):
        mosaic.adjust()
    after = [p.pose for p in mosaic.placements()]
    assert tried == [0, 1]
    assert after[:3] == before[:3]
    assert all(a != b for a, b in zip(after[3:], before[3:], strict=True))

"""Small flights over a known ground: every frame ends where it was taken, or says why not."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, fly, map_error, photograph, textured_ground

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.placement import Placement, Rejection, Waiting
from gcs_mosaic.stitch.mapping.incremental_mapper import Assembly
from gcs_mosaic.stitch.mapping.islands import Bridges
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.stitch.registration.outcome import Registration

Register = Callable[[int, int], Registration | None]


def line(x: float, y: float, count: int, step: float = 130, **more: float) -> list[Pose]:
    return [Pose(x + step * i, y, **more) for i in range(count)]


def noted_pairs(monkeypatch: pytest.MonkeyPatch) -> list[set[int]]:
    """The frames that are compared from now on, two by two."""
    register = Search.register
    asked: list[set[int]] = []

    def noting(search: Search, frame: int, other: int) -> Registration | None:
        asked.append({frame, other})
        return register(search, frame, other)

    monkeypatch.setattr(Search, "register", noting)
    return asked


@pytest.mark.long
def test_two_flight_lines_become_one_map(ground: Image) -> None:
    rng = np.random.default_rng(5)
    level = line(400, 500, 7) + line(400, 720, 7)[::-1]
    truth = [Pose(p.x, p.y, *rng.normal(0, [0.05, 0.1, 0.05, 0.05])) for p in level]
    mosaic = Mosaic()
    outcomes = fly(mosaic, ground, truth)
    assert all(isinstance(outcome, Placement) for outcome in outcomes)
    mosaic.adjust(everything=True)
    assert map_error(mosaic.placements(), truth) < 1.5
    assert {p.island for p in mosaic.placements()} == {0}


@pytest.mark.long
def test_a_climb_is_not_a_drift(ground: Image) -> None:
    truth = [Pose(1200, 1200, math.log(0.5 + 0.15 * i), 0.2 * i) for i in range(11)]
    mosaic = Mosaic()
    assert all(isinstance(outcome, Placement) for outcome in fly(mosaic, ground, truth))
    mosaic.adjust(everything=True)
    assert map_error(mosaic.placements(), truth) < 2.5


@pytest.mark.thorough
@pytest.mark.long
def test_frames_apart_form_an_island_that_joins_when_the_gap_is_flown(ground: Image) -> None:
    first, far, bridge = line(300, 600, 4), line(1300, 600, 4), line(820, 600, 4)
    mosaic = Mosaic()
    fly(mosaic, ground, first)
    outcomes = fly(mosaic, ground, far, first=4)
    assert isinstance(outcomes[0], Waiting)
    assert {p.island for p in mosaic.placements()} == {0, 1}
    fly(mosaic, ground, bridge, first=8)
    mosaic.adjust(everything=True)
    assert {p.island for p in mosaic.placements()} == {0}
    assert [island.merged_into for island in mosaic.islands] == [None, 0]
    assert map_error(mosaic.placements(), first + far + bridge) < 2


@pytest.mark.long
def test_a_frame_of_another_place_waits_and_is_rejected_at_the_end(ground: Image, other_ground: Image) -> None:
    mosaic = Mosaic()
    fly(mosaic, ground, line(400, 500, 3))
    assert isinstance(mosaic.add(photograph(other_ground, Pose(500, 500), SMALL_CAMERA), "stray"), Waiting)
    assert mosaic.finish() == [Rejection("stray", "matches no other frame")]


def test_one_thing_that_looks_alike_founds_no_island(ground: Image, other_ground: Image) -> None:
    """Its own matches must not count as what was to be expected around it."""
    alike = textured_ground(400, 9)[:200, :200]
    one = photograph(ground, Pose(400, 400), SMALL_CAMERA).copy()
    other = photograph(other_ground, Pose(500, 500), SMALL_CAMERA).copy()
    one[60:260, 100:300] = other[90:290, 160:360] = alike
    mosaic = Mosaic()
    mosaic.add(one, "one")
    assert isinstance(mosaic.add(other, "other"), Waiting)


@pytest.mark.long
def test_much_in_common_with_a_waiting_frame_outdoes_a_weak_link(
    ground: Image, other_ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two lands of one make: the link to the placed frame is false, and the neighbour tells."""
    register = Search.register

    def deceived(search: Search, frame: int, other: int) -> Registration | None:
        if (frame, other) != (3, 0):
            return register(search, frame, other)
        found = register(search, 3, 2)
        return found and replace(found, evidence=found.evidence / 20)

    monkeypatch.setattr(Search, "register", deceived)
    mosaic = Mosaic()
    fly(mosaic, ground, line(500, 500, 2, step=80))
    fly(mosaic, other_ground, line(500, 500, 2, step=80), first=2)
    assert mosaic.frame_counts() == {0: 2, 1: 2}


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_an_empty_picture_is_rejected_with_a_reason(grey: int) -> None:
    outcome = Mosaic().add(np.full((360, 480, 3), grey, np.uint8), "empty")
    assert isinstance(outcome, Rejection)
    assert outcome.reason.startswith("too little to see: 0 features, it is flat or noise alone")


@pytest.mark.long
def test_a_frame_of_another_size_is_another_camera(ground: Image) -> None:
    mosaic = Mosaic()
    fly(mosaic, ground, line(400, 500, 3))
    crop = photograph(ground, Pose(600, 500), SMALL_CAMERA)[30:330, 40:440].copy()
    outcome = mosaic.add(crop, "small")
    assert isinstance(outcome, Placement)
    assert (outcome.camera.width, outcome.camera.height) == (400, 300)


@pytest.mark.long
def test_held_frames_stay_where_they_are_drawn(ground: Image) -> None:
    mosaic = Mosaic()
    fly(mosaic, ground, line(400, 500, 4))
    for placement in mosaic.placements():
        mosaic.anchor_drawn_pose(placement.name, placement.pose, placement.camera)
    before = {p.name: p.pose for p in mosaic.placements()}
    mosaic.adjust(everything=True)
    fly(mosaic, ground, line(920, 500, 2), first=4)
    shift = [math.hypot(p.pose.x - before[p.name].x, p.pose.y - before[p.name].y) for p in mosaic.placements()[:4]]
    assert np.median(shift) < 20


def test_nothing_that_is_not_in_the_pixels_matters(ground: Image) -> None:
    truth = line(400, 500, 4)
    runs = []
    for _ in range(2):
        mosaic = Mosaic()
        fly(mosaic, ground, truth)
        runs.append([p.pose for p in mosaic.placements()])
    assert runs[0] == runs[1]


def test_two_tilted_frames_find_each_other(ground: Image) -> None:
    """The first frame counts as level until the second shows otherwise."""
    truth = [Pose(600, 600, 0, 0, 0.2, 0.1), Pose(720, 600, 0, 0, -0.15, -0.2)]
    mosaic = Mosaic()
    assert all(isinstance(outcome, Placement) for outcome in fly(mosaic, ground, truth))
    assert mosaic.placements()[1].residual_px < 2


@pytest.mark.long
def test_a_founder_that_nothing_joined_comes_home(ground: Image) -> None:
    """A single frame apart is too little to prove a join of islands, and needs none."""
    truth = [Pose(300, 600), *line(1300, 600, 2), *line(1170, 600, 6, step=-140)]
    mosaic = Mosaic()
    fly(mosaic, ground, truth)
    mosaic.adjust(everything=True)
    assert {p.island for p in mosaic.placements()} == {1}
    assert len(mosaic.placements()) == len(truth)
    assert map_error(mosaic.placements(), truth) < 2


@pytest.mark.long
def test_a_founder_is_compared_once_with_each_new_frame(
    ground: Image, other_ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    mosaic = Mosaic()
    fly(mosaic, other_ground, [Pose(500, 500)])
    asked = noted_pairs(monkeypatch)
    fly(mosaic, ground, line(400, 500, 4), first=1)
    assert mosaic.frame_counts() == {0: 1, 1: 4}
    assert asked.count({0, 4}) == 1


@pytest.mark.long
def test_a_frame_that_newer_frames_pushed_aside_is_placed_at_the_end(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that wait compete for the two tries beside a new frame; whoever loses always is asked at the end."""
    monkeypatch.setattr("gcs_mosaic.stitch.mapping.incremental_mapper.WAITING_TRIES", 0)
    mosaic = Mosaic()
    fly(mosaic, ground, [Pose(300, 600), Pose(1000, 600), *line(430, 600, 4)])
    assert [w.name for w in mosaic.waiting()] == ["001"]
    mosaic.retry_waiting()
    assert mosaic.waiting() == []
    assert len(mosaic.placements()) == 6


@pytest.mark.long
def test_islands_that_were_never_compared_are_joined_in_a_pause(ground: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_mosaic.stitch.mapping.incremental_mapper.BRIDGE_TRIES", 0)
    truth = [*line(300, 600, 4), *line(1300, 600, 4), *line(820, 600, 4)]
    mosaic = Mosaic()
    fly(mosaic, ground, truth)
    assert len(mosaic.frame_counts()) == 2
    while mosaic.connect_some():
        mosaic.adjust()
    mosaic.adjust(everything=True)
    assert mosaic.frame_counts() == {0: len(truth)}
    assert map_error(mosaic.placements(), truth) < 2
    assert not mosaic.connect_some()


@pytest.mark.thorough
@pytest.mark.long
def test_what_could_not_be_connected_is_looked_at_again_once_it_lies_elsewhere(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that lie awry agree with nothing; when their island has been adjusted they may."""
    monkeypatch.setattr("gcs_mosaic.stitch.mapping.incremental_mapper.BRIDGE_TRIES", 0)
    mosaic = Mosaic()
    truth = [*line(300, 600, 4), *line(1300, 600, 4), *line(820, 600, 4)]
    fly(mosaic, ground, truth)
    asked = noted_pairs(monkeypatch)
    with monkeypatch.context() as patch:
        patch.setattr(Bridges, "_agree", lambda *_: False)
        while mosaic.connect_some():
            pass
    first, graph = len(asked), mosaic._graph
    mosaic.add(photograph(ground, Pose(1800, 1800), SMALL_CAMERA), "far")
    asked.clear()
    while mosaic.connect_some():
        pass
    assert len(asked) < first
    assert len(mosaic.frame_counts()) == 2
    for frame in graph.placed().tolist():
        pose = graph.pose_of(frame)
        graph.put(frame, replace(pose, x=pose.x + 1), graph.island_of(frame))
    mosaic.add(photograph(ground, Pose(600, 2100), SMALL_CAMERA), "farther")
    while mosaic.connect_some():
        mosaic.adjust()
    assert mosaic.frame_counts() == {0: len(truth)}


@pytest.mark.thorough
@pytest.mark.long
def test_two_frames_that_raise_keep_no_others_from_being_compared(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_mosaic.stitch.mapping.incremental_mapper.BRIDGE_TRIES", 0)
    mosaic, compare = Mosaic(), Assembly._compare
    asked: list[set[int]] = []

    def failing(assembly: Assembly, frame: int, other: int, register: Register) -> list[int]:
        asked.append({frame, other})
        placed = compare(assembly, frame, other, register)
        if {frame, other} == asked[0]:
            raise MemoryError
        return placed

    monkeypatch.setattr(Assembly, "_compare", failing)
    truth = [*line(300, 600, 4), *line(1300, 600, 4), *line(820, 600, 4)]
    fly(mosaic, ground, truth)
    with pytest.raises(MemoryError):
        mosaic.connect_some()
    for _ in range(len(truth)):
        if not mosaic.connect_some():
            break
    assert not mosaic.connect_some()
    assert asked.count(asked[0]) == 1
    assert mosaic.frame_counts() == {0: len(truth)}


@pytest.mark.long
def test_a_waiting_frame_that_raises_keeps_no_other_from_its_place(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_mosaic.stitch.mapping.incremental_mapper.WAITING_TRIES", 0)
    mosaic = Mosaic()
    fly(mosaic, ground, [Pose(300, 600), Pose(1260, 600), Pose(780, 830), *line(430, 600, 6)])
    assert [w.name for w in mosaic.waiting()] == ["001", "002"]
    placed_waiting = Assembly._placed_waiting
    tried: list[int] = []

    def failing(assembly: Assembly, frame: int, among: Iterable[int]) -> Iterator[int]:
        yield from placed_waiting(assembly, frame, among)
        if frame == 2:
            tried.append(frame)
            raise MemoryError

    monkeypatch.setattr(Assembly, "_placed_waiting", failing)
    with pytest.raises(MemoryError):
        mosaic.retry_waiting()
    assert [w.name for w in mosaic.waiting()] == ["002"]
    assert len(tried) <= 2
    monkeypatch.undo()
    mosaic.retry_waiting()
    assert len(mosaic.placements()) == 9


@pytest.mark.long
def test_a_frame_that_comes_to_wait_is_compared_in_the_next_pause(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    mosaic = Mosaic()
    fly(mosaic, ground, line(400, 500, 3))
    while mosaic.connect_some():
        pass
    with monkeypatch.context() as patch:
        patch.setattr(Search, "first_links", lambda *_: iter(()))
        assert isinstance(mosaic.add(photograph(ground, Pose(790, 500), SMALL_CAMERA), "late"), Waiting)
    while mosaic.connect_some():
        pass
    assert mosaic.waiting() == []

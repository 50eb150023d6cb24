"""What shows nothing new is kept beside its keyframe; what shows more, or shows it better, is placed."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, fly, photograph

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixel_grid
from gcs_mosaic.stitch.graph.placement import Covered, Outcome, Placement
from gcs_mosaic.stitch.mapping.covering import CoverSettings
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

PLACED_ALL = StitchSettings(cover=CoverSettings(enabled=False))
WIDTH = SMALL_CAMERA.width
GRID = pixel_grid(SMALL_CAMERA, 5, 4)


def hover(count: int, x: float = 900.0, y: float = 900.0, seed: int = 4) -> list[Pose]:
    """Around one place, never off it by more than one per cent of a picture."""
    rng = np.random.default_rng(seed)
    swings = rng.uniform(-1, 1, (count, 5)) * [2, 2, 0.002, 0.004, 0.002]
    return [Pose(x + dx, y + dy, zoom, yaw, pitch) for dx, dy, zoom, yaw, pitch in swings]


def moved_along(count: int, step: float) -> list[Pose]:
    return [Pose(500 + step * i, 900) for i in range(count)]


def followed(covered: Covered, placements: Iterable[Placement]) -> Array:
    """Where a covered frame's grid lies on the canvas."""
    keyframe = next(p for p in placements if p.name == covered.by)
    return np.asarray(cv2.perspectiveTransform(GRID[None], covered.canvas_from_frame(keyframe))[0])


def all_covered(outcomes: list[Outcome]) -> list[Covered]:
    covered = [outcome for outcome in outcomes if isinstance(outcome, Covered)]
    assert covered == outcomes
    return covered


@pytest.mark.long
def test_a_hover_is_one_keyframe(ground: Image) -> None:
    mosaic = Mosaic()
    outcomes = fly(mosaic, ground, hover(10))
    assert isinstance(outcomes[0], Placement)
    assert [(o.name, o.by) for o in all_covered(outcomes[1:])] == [(f"{i:03}", "000") for i in range(1, 10)]
    assert mosaic.covered() == outcomes[1:]
    assert mosaic.frame_counts() == {0: 1}


@pytest.mark.long
def test_covered_frames_take_no_part(ground: Image) -> None:
    """What comes after a hover is placed as if there had been no hover."""
    line, still = moved_along(4, 130), hover(6, 500, 900)
    with_hover, without = Mosaic(), Mosaic()
    fly(with_hover, ground, [*line[:1], *still, *line[1:]])
    fly(without, ground, line)
    poses = [[p.pose for p in mosaic.placements()] for mosaic in (with_hover, without)]
    assert poses[0] == poses[1]
    assert len(with_hover.covered()) == 6


@pytest.mark.long
def test_covered_frames_lie_where_they_were_taken(ground: Image) -> None:
    poses = [*moved_along(3, 130), *hover(8, 760 + 4, 900)]
    mosaic = Mosaic()
    covered = [o for o in fly(mosaic, ground, poses) if isinstance(o, Covered)]
    placements = mosaic.placements()
    assert len(covered) == 8
    for one in covered:
        true, of_key = poses[int(one.name)], poses[int(one.by)]
        shift = followed(one, placements) - canvas_from_pixels(*where(placements, one.by), GRID)
        true_shift = canvas_from_pixels(true, SMALL_CAMERA, GRID) - canvas_from_pixels(of_key, SMALL_CAMERA, GRID)
        assert np.abs(shift - true_shift).max() < 1.0


def where(placements: Iterable[Placement], name: str) -> tuple[Pose, Camera]:
    placement = next(p for p in placements if p.name == name)
    return placement.pose, placement.camera


@pytest.mark.long
@pytest.mark.thorough
def test_a_slow_drift_does_not_add_up(ground: Image) -> None:
    """One per cent of a picture a frame: each is judged against its keyframe, and every third is one."""
    poses = moved_along(31, 0.01 * WIDTH)
    mosaic = Mosaic()
    outcomes = fly(mosaic, ground, poses)
    most = CoverSettings().most_new * WIDTH
    apart = [abs(poses[int(o.name)].x - poses[int(o.by)].x) for o in outcomes if isinstance(o, Covered)]
    assert max(apart) < most + 1
    places = [poses[int(p.name)].x for p in mosaic.placements()]
    assert 8 <= len(places) <= 16
    assert max(np.diff(places)) < most + 0.01 * WIDTH + 1


@pytest.mark.long
def test_a_return_is_covered_by_what_was_placed_before(ground: Image) -> None:
    """To and fro: the keyframe placed last is too far, an earlier one is not."""
    there = moved_along(4, 0.1 * WIDTH)
    mosaic = Mosaic()
    fly(mosaic, ground, there)
    assert [o.by for o in all_covered(fly(mosaic, ground, [replace(p, y=902) for p in there[::-1]], first=4))] == [
        "003",
        "002",
        "001",
        "000",
    ]


@pytest.mark.parametrize("blur", [lambda p: cv2.GaussianBlur(p, (0, 0), 1.0), lambda p: cv2.blur(p, (5, 1))])
def test_a_sharper_frame_is_placed_and_covers_the_next(ground: Image, blur: Callable[[Image], Image]) -> None:
    pictures = [photograph(ground, pose, SMALL_CAMERA) for pose in hover(4)]
    mosaic = Mosaic()
    outcomes = [mosaic.add(p, str(i)) for i, p in enumerate([blur(pictures[0]), *pictures[1:3], blur(pictures[3])])]
    assert [type(o) for o in outcomes] == [Placement, Placement, Covered, Covered]
    assert [o.by for o in all_covered(outcomes[2:])] == ["1", "1"]


def test_a_finer_frame_is_placed(ground: Image) -> None:
    mosaic = Mosaic()
    near = [Pose(900, 900, math.log(scale)) for scale in (1.0, 0.99, 0.92)]
    assert [type(o) for o in fly(mosaic, ground, near)] == [Placement, Covered, Placement]


def test_another_camera_is_not_covered(ground: Image) -> None:
    picture = photograph(ground, Pose(900, 900), SMALL_CAMERA)
    mosaic = Mosaic()
    mosaic.add(picture, "whole")
    assert isinstance(mosaic.add(picture[2:-2, 2:-2].copy(), "cropped"), Placement)


def test_what_only_looks_alike_in_part_is_not_covered(ground: Image, other_ground: Image) -> None:
    """Half of the picture has changed: matches bear out too little of it."""
    before = photograph(ground, Pose(900, 900), SMALL_CAMERA)
    after = before.copy()
    after[:, 200:] = photograph(other_ground, Pose(600, 600), SMALL_CAMERA)[:, 200:]
    mosaic = Mosaic()
    mosaic.add(before, "before")
    assert not isinstance(mosaic.add(after, "after"), Covered)


@pytest.mark.long
def test_covered_frames_go_along_when_their_keyframe_moves(ground: Image) -> None:
    line = moved_along(8, 130)
    mosaic = Mosaic()
    fly(mosaic, ground, [*line[:3], *hover(3, 760, 900)])
    covered, before = mosaic.covered(), mosaic.placements()
    fly(mosaic, ground, [*line[3:], *(replace(p, y=1080) for p in line)], first=6)
    mosaic.adjust(everything=True)
    after = mosaic.placements()
    key_moved = canvas_from_pixels(*where(after, "002"), GRID) - canvas_from_pixels(*where(before, "002"), GRID)
    assert np.abs(key_moved).max() > 0.01
    assert mosaic.covered()[:3] == covered
    for one in covered:
        assert one.by == "002"
        assert np.allclose(followed(one, after) - followed(one, before), key_moved, atol=0.2)


@pytest.mark.thorough
@pytest.mark.long
def test_an_ordinary_flight_has_none_and_is_as_it_was(ground: Image) -> None:
    rng = np.random.default_rng(5)
    level = [*moved_along(6, 100), *(replace(p, y=1050) for p in moved_along(6, 100)[::-1])]
    poses = [Pose(p.x, p.y, *rng.normal(0, [0.05, 0.1, 0.05, 0.05])) for p in level]
    with_covering, without = Mosaic(), Mosaic(PLACED_ALL)
    for mosaic in (with_covering, without):
        fly(mosaic, ground, poses)
        mosaic.adjust(everything=True)
    assert with_covering.covered() == []
    assert with_covering.placements() == without.placements()


@pytest.mark.long
def test_the_same_frames_give_the_same_outcomes(ground: Image) -> None:
    poses = [*hover(4), *moved_along(8, 4.0)]
    assert fly(Mosaic(), ground, poses) == fly(Mosaic(), ground, poses)


@pytest.mark.long
def test_covering_can_be_switched_off(ground: Image) -> None:
    assert all(isinstance(o, Placement) for o in fly(Mosaic(PLACED_ALL), ground, hover(4)))


def test_a_call_that_raises_leaves_no_covered_frame(ground: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    mosaic = Mosaic()
    pictures = [photograph(ground, pose, SMALL_CAMERA) for pose in hover(2)]
    mosaic.add(pictures[0], "a")
    with monkeypatch.context() as broken:
        broken.setattr("gcs_mosaic.stitch.mapping.covering.confirmed", None)
        with pytest.raises(TypeError):
            mosaic.add(pictures[1], "b")
    assert mosaic.covered() == []
    assert isinstance(mosaic.add(pictures[1], "b"), Covered)

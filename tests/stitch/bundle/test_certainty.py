"""What each placement says of its support, in small flights over a known ground."""

import math
from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, seen

from gcs_mosaic.stitch.camera.geometry import Pose, canvas_from_pixels, frame_border, similarity_between
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import Mosaic
from tests.tiers import thorough


def flown(
    ground: Image, poses: Iterable[Pose], mosaic: Mosaic, first: int = 0, adjusted: bool = True
) -> dict[str, Placement]:
    for i, pose in enumerate(poses, start=first):
        mosaic.place(seen(ground, pose, mosaic.settings.features), f"{i:03}")
        if adjusted:
            mosaic.adjust()
    return {placement.name: placement for placement in mosaic.placements()}


def line(x: float, y: float, count: int, step: float = 130) -> list[Pose]:
    rng = np.random.default_rng(int(x + y))
    return [Pose(x + step * i, y, *rng.normal(0, [0.03, 0.1, 0.03, 0.03])) for i in range(count)]


def shortest_ways(placements: Mapping[str, Placement], root: str) -> dict[str, int]:
    """Hops to the root, from the neighbours that the placements name."""
    hops, waiting = {root: 0}, deque([root])
    while waiting:
        name = waiting.popleft()
        for other in set(placements[name].neighbours) - set(hops):
            hops[other] = hops[name] + 1
            waiting.append(other)
    return hops


@pytest.mark.long
@pytest.mark.parametrize("adjusted", [True, thorough(False)])
def test_hops_are_the_shortest_way_to_the_root(ground: Image, adjusted: bool) -> None:
    placements = flown(ground, line(300, 500, 9), Mosaic(), adjusted=adjusted)
    assert {name: p.hops for name, p in placements.items()} == shortest_ways(placements, "000")
    assert placements["008"].hops > 1


@pytest.mark.long
def test_after_a_join_the_root_is_that_of_the_island_that_stays(ground: Image) -> None:
    mosaic = Mosaic()
    flown(ground, line(300, 600, 3), mosaic)
    flown(ground, line(1200, 600, 5), mosaic, first=3)
    placements = flown(ground, line(1070, 600, 6, step=-130), mosaic, first=8)
    assert {p.island for p in placements.values()} == {1}
    root = next(name for name, p in placements.items() if p.hops == 0)
    assert root in ("003", "004")  # whichever of the two that founded the second island was its first
    assert {name: p.hops for name, p in placements.items()} == shortest_ways(placements, root)


@pytest.mark.long
def test_frames_far_from_the_root_are_less_sure(ground: Image) -> None:
    placements = list(flown(ground, line(300, 500, 11), Mosaic()).values())
    assert 0 < placements[0].corner_deviation_px < placements[5].corner_deviation_px / 2
    assert placements[5].corner_deviation_px < placements[10].corner_deviation_px


def test_a_founder_is_where_it_is(ground: Image) -> None:
    (founder,) = flown(ground, line(300, 500, 1), Mosaic()).values()
    assert (founder.hops, founder.corner_deviation_px, founder.neighbours) == (0, 0, ())


@pytest.mark.long
@pytest.mark.parametrize("adjusted", [True, thorough(False)])
def test_the_true_errors_are_of_the_size_that_is_stated(ground: Image, adjusted: bool) -> None:
    """Before the adjustment of the whole (of the last six frames), and after it."""
    truth = line(300, 500, 7) + line(300, 720, 7)[::-1]
    mosaic = Mosaic()
    flown(ground, truth[:8], mosaic)
    flown(ground, truth[8:], mosaic, first=8, adjusted=adjusted)
    placements = mosaic.placements()
    corners = frame_border(SMALL_CAMERA, 1)
    found = np.array([canvas_from_pixels(p.pose, p.camera, corners) for p in placements])
    true = np.array([canvas_from_pixels(pose, SMALL_CAMERA, corners) for pose in truth])
    scale, angle, shift = similarity_between(found[0], true[0])
    c, s = math.cos(angle), math.sin(angle)
    off = np.linalg.norm(scale * found @ np.array([[c, s], [-s, c]]) + shift - true, axis=2)
    errors = off.max(axis=1) / np.exp([pose.log_gsd for pose in truth])
    ratio = errors / [p.corner_deviation_px for p in placements]
    assert 0.3 < math.sqrt((ratio[8:] ** 2).mean()) < 2

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sitl.camera import Camera, Scene
from sitl.flight import Flight, plan
from sitl.geometry import CameraState, Lens
from sitl.path import Plan
from sitl.targets import MARK_PX, Crowd, Target, spread

LEVEL = CameraState(time=0, x=0, y=0, height=60)
NORTHWARD = Target(kind="person", x=1, y=2, length=2, width=1, heading=0, colour=(0, 0, 255), speed=2, way=10)


@pytest.fixture(scope="module")
def crowded() -> Flight:
    crowd = Crowd(people=12, vehicles=2, marks=5)
    return plan("survey", (640, 480), seed=3, world_size=2048, route=Plan(frames=12, height=60), crowd=crowd)


def test_a_target_goes_to_and_fro() -> None:
    assert [tuple(NORTHWARD.place(time)) for time in (0, 3, 5, 8, 10)] == [(1, 2), (1, -4), (1, -8), (1, -2), (1, 2)]
    assert np.ptp(NORTHWARD.corners(3), axis=0) == pytest.approx([1, 2])


@pytest.mark.long
def test_it_is_painted_where_the_truth_says(crowded: Flight) -> None:
    """The pictures with and without targets differ around the sightings and nowhere else."""
    bare = replace(crowded.scene, targets=())
    for index in (0, 5):
        state = crowded.states[index]
        changed = np.abs(crowded.scene.light(state) - bare.light(state)).max(axis=2)
        frame = crowded.truth().frames[index]
        assert frame.sightings
        assert all(changed[tuple(np.rint(seen.px[::-1]).astype(int))] > 20 for seen in frame.sightings)
        sizes = [max(crowded.scene.targets[seen.target].length, 0.6) for seen in frame.sightings]
        rows, columns = np.nonzero(changed > 0)
        inner = (rows > 40) & (rows < 440) & (columns > 40) & (columns < 600)  # some stand on the border
        for row, column in zip(rows[inner], columns[inner], strict=True):
            off = [
                np.hypot(*(seen.px - (column, row))) / size for seen, size in zip(frame.sightings, sizes, strict=True)
            ]
            assert min(off) < 10  # px of 0.1 m for each metre of length: nothing lies farther from a middle


def test_a_pixel_that_is_half_covered_is_half_coloured(scene: Scene) -> None:
    camera = Camera(lens=Lens(width=320, height=240, k1=0), noise=0, vignetting=0)
    gsd = 60 / camera.lens.focal_px
    wide = Target(kind="mark", x=0, y=0, length=4 * gsd, width=4 * gsd, heading=0, colour=(255, 0, 0))
    light, bare = (replace(scene, camera=camera, targets=targets).light(LEVEL) for targets in ((wide,), ()))
    share = (light - bare)[..., 0] / (255 - bare[..., 0])
    row = share[119, 155:165]  # the optical axis passes between the pixels 159 and 160
    assert row == pytest.approx([0, 0, 0, 1, 1, 1, 1, 0, 0, 0], abs=0.2)
    assert share.sum() == pytest.approx(16, rel=0.08)


def test_everyone_is_seen_and_people_move_between_sightings(crowded: Flight) -> None:
    truth = crowded.truth()
    seen: dict[int, list[tuple[float, float]]] = {}
    for frame in truth.frames:
        for sighting in frame.sightings:
            seen.setdefault(sighting.target, []).append((float(sighting.ground[0]), float(sighting.ground[1])))
    assert set(seen) == set(range(len(truth.targets)))
    for number, target in enumerate(truth.targets):
        assert (len(set(seen[number])) == 1) == (target.kind == "mark" or len(seen[number]) == 1)


def test_a_mark_is_so_many_pixels_wide(crowded: Flight) -> None:
    marks = [target for target in crowded.scene.targets if target.kind == "mark"]
    gsd = 60 / crowded.scene.camera.lens.focal_px
    assert [mark.length / gsd for mark in marks] == pytest.approx([MARK_PX] * 5)


def test_targets_are_their_seed(crowded: Flight) -> None:
    lens, states = crowded.scene.camera.lens, crowded.states
    first, again, other = (spread(Crowd(people=3), lens, states, 60, seed) for seed in (1, 1, 2))
    assert first == again != other

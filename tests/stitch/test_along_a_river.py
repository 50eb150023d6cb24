"""Flights in which most of what a frame shows is never found again, because it is water that moves; and how those that look like
it in a pair of pictures are told from them: halls of one make on different lawns."""

from __future__ import annotations

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, map_error, photograph, textured_ground

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.mosaic import Mosaic

pytestmark = pytest.mark.long

LAND = 170  # columns of a frame's 480 that show the bank, or the hall
STEP = 110  # rows of a frame's 360 from frame to frame
FRAMES = 7
EARTH, WATER = (0.8, 1.0, 1.1), (1.3, 0.9, 0.5)  # of blue, green and red


def coloured(grey: Image, shares: tuple[float, ...]) -> Image:
    return np.asarray(np.clip(grey[..., None] * np.array(shares), 0, 255), np.uint8)


def strip(line: Image, beside: list[Image], colour: tuple[float, ...]) -> list[Image]:
    """Frames one after the other along a line, with these beside what all of them show."""
    taken = []
    for image, other in zip(frames_along(line), beside, strict=True):
        frame = coloured(image, EARTH)
        frame[:, LAND:] = coloured(other, colour)[:, LAND:]
        taken.append(frame)
    return taken


def poses() -> list[Pose]:
    return [Pose(300, 250 + STEP * k) for k in range(FRAMES)]


def frames_along(ground: Image) -> list[Image]:
    return [photograph(ground, pose, SMALL_CAMERA) for pose in poses()]


def mapped(frames: list[Image]) -> Mosaic:
    mosaic = Mosaic()
    for number, image in enumerate(frames):
        mosaic.add(image, f"{number:03}")
        mosaic.adjust()
    mosaic.retry_waiting()
    mosaic.adjust(everything=True)
    return mosaic


def test_a_flight_along_a_river_is_one_map(ground: Image) -> None:
    waves = [textured_ground(480, 100 + number)[:360] for number in range(FRAMES)]
    mosaic = mapped(strip(ground, waves, WATER))
    assert list(mosaic.frame_counts().values()) == [FRAMES]
    assert map_error(mosaic.placements(), poses()) < 3.0


@pytest.mark.thorough
def test_halls_of_one_make_on_different_lawns_stay_apart(ground: Image) -> None:
    """Each row of halls is its like's to the last grey level, and the lawns around, which are found again beside each row,
    are not."""
    rows = [strip(ground, frames_along(textured_ground(1400, seed)), (0.6, 1.2, 0.7)) for seed in (41, 42)]
    mosaic = mapped([*rows[0], *rows[1]])
    assert len({placed.island for placed in mosaic.placements() if int(placed.name) < FRAMES}) == 1
    assert sorted(mosaic.frame_counts().values()) == [FRAMES, FRAMES]

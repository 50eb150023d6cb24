"""The height at which looks agree is found, the lowest of several, and none where they show unrelated things."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from gcs_mosaic.integral.aperture import aperture_of
from gcs_mosaic.integral.focal_plane import camera_height
from gcs_mosaic.integral.focus import Focus, agreement, ground_focus
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, LookStack
from gcs_mosaic.stitch.camera.geometry import Camera, Pose

CAMERA = Camera(320, 240, focal=1.45)
POSES = [Pose(float(x), float(y)) for x in (-75, -25, 25, 75) for y in (-60, 0, 60)]
WINDOW = GroundWindow(0.0, 0.0, 90.0, 90)
ABOVE = camera_height(POSES[0], CAMERA)
Noise = np.ndarray


def texture(seed: int) -> Noise:
    """Blobs of some pixels, of deviation 1."""
    rough = np.random.default_rng(seed).standard_normal((512, 512)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 1.5)
    return np.asarray(smooth / smooth.std(), np.float32)


def seen(pose: Pose, texture: Noise, height: float) -> Noise:
    """What a level camera sees of a texture at a height (share of its own)."""
    columns, rows = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    drop = (1 - height) * ABOVE / CAMERA.focal_px
    x = pose.x + (columns - CAMERA.principal_point[0]) * drop
    y = pose.y + (rows - CAMERA.principal_point[1]) * drop
    across, down = (np.asarray((one + 256) % 512, np.float32) for one in (x, y))
    return np.asarray(cv2.remap(texture, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.float32)


def looks(ground: float | None, crowns: float | None, cover: float = 0.5) -> list[GroundLook]:
    """Frames of textured ground beneath clumps at another height; None: unrelated noise instead of the ground, no clumps."""
    found = []
    for number, pose in enumerate(POSES):
        image = texture(100 + number) if ground is None else seen(pose, texture(1), ground)
        image = image[: CAMERA.height, : CAMERA.width]
        if crowns is not None:
            hides = seen(pose, texture(2), crowns) > np.quantile(texture(2), 1 - cover)
            image = np.where(hides, seen(pose, texture(3), crowns), image)
        found.append(GroundLook(str(number), pose, CAMERA, 100 + 10 * image[..., None].astype(np.float32)))
    return found


def focus_of(some: list[GroundLook]) -> Focus:
    return ground_focus(some, WINDOW, ABOVE, aperture_of(some, np.zeros(2), 0.0))


@pytest.mark.parametrize("height", [-0.15, 0.0, 0.1])
def test_open_ground_is_found_at_its_height(height: float) -> None:
    found = focus_of(looks(height, None))
    assert found.known
    assert found.height == pytest.approx(height, abs=0.01)


@pytest.mark.parametrize("ground", [-0.6, -1.0, -1.4])
def test_ground_is_found_far_below_a_map_of_crowns(ground: float) -> None:
    """As from low above high trees, where all that was matched lies by the tops."""
    found = focus_of(looks(ground, 0.0, 0.6))
    assert found.known
    assert found.height == pytest.approx(ground, abs=0.02 * (1 - ground))


@pytest.mark.parametrize("cover", [0.4, 0.7])
def test_beneath_clumps_the_ground_is_the_lowest_height_of_agreement(cover: float) -> None:
    found = focus_of(looks(-0.1, 0.12, cover))
    assert found.known
    assert found.height == pytest.approx(-0.1, abs=0.015)


def crowned(ground: float, tops: Sequence[float], bare: float, width: float) -> list[GroundLook]:
    """Frames of faint ground, of which a share lies bare between opaque crowns that become narrower at each of these heights."""
    stand = cv2.GaussianBlur(np.random.default_rng(7).standard_normal((512, 512)).astype(np.float32), (0, 0), width)
    found = []
    for number, pose in enumerate(POSES):
        image = 0.4 * seen(pose, texture(1), ground)
        for layer, height in enumerate(tops):
            hides = seen(pose, stand, height) > np.quantile(stand, bare + (0.95 - bare) * layer / len(tops))
            image = np.where(hides, seen(pose, texture(50 + layer), height), image)
        found.append(GroundLook(str(number), pose, CAMERA, 100 + 10 * image[..., None].astype(np.float32)))
    return found


def test_ground_between_crowns_is_found_though_all_of_them_agree_better() -> None:
    """Together the looks have one peak, at the crowns, of which the ground is a shoulder."""
    found = focus_of(crowned(-0.08, [0.008 * one for one in range(8)], 0.2, 12))
    assert found.height == pytest.approx(-0.08, abs=0.025)  # a step of the search is 1.5 %


def test_crowns_as_far_apart_as_the_looks_make_no_ground_far_below_them() -> None:
    assert focus_of(crowned(-0.1, [0.008 * one for one in range(8)], 0.12, 6)).height > -0.2


@pytest.mark.long
def test_crowns_of_many_heights_are_no_ground() -> None:
    """Domes that rise from 5 to 25 %; what is dark between them shows each look something else, and nothing of the ground. The
    lower end of the crowns is told, and that it is a guess."""
    domes = cv2.GaussianBlur(np.random.default_rng(2).standard_normal((512, 512)).astype(np.float32), (0, 0), 6)
    heights, found, dark = np.linspace(0.05, 0.25, 21), [], []
    for number, pose in enumerate(POSES):
        image, hidden = texture(100 + number)[: CAMERA.height, : CAMERA.width], np.zeros((CAMERA.height, CAMERA.width))
        for layer, height in enumerate(heights.tolist()):
            hides = seen(pose, domes, height) > np.quantile(domes, 0.04 + 0.93 * layer / len(heights))
            image = np.where(hides, seen(pose, texture(50 + layer), height), image)
            hidden[hides] = 1
        dark.append(1 - hidden.mean())
        found.append(GroundLook(str(number), pose, CAMERA, 100 + 10 * image[..., None].astype(np.float32)))
    assert 0 < np.mean(dark) < 0.05
    told = focus_of(found)
    assert not told.known
    assert told.height == pytest.approx(heights[0], abs=0.02)  # a step of the search is 1.5 %


def test_where_looks_agree_nowhere_it_is_said() -> None:
    found = focus_of(looks(None, None))
    assert not found.known
    assert found.height == 0.0


def test_two_looks_tell_no_height() -> None:
    assert not focus_of(looks(0.0, None)[:2]).known


def test_unrelated_looks_agree_as_much_as_chance_has_it() -> None:
    noise = np.random.default_rng(5).standard_normal((10, 90, 90, 1)).astype(np.float32)
    assert agreement(LookStack([""] * 10, noise)) == pytest.approx(1.0, abs=0.05)
    same = np.repeat(noise[:1], 10, axis=0) + 0.3 * noise
    assert agreement(LookStack([""] * 10, same)) > 20

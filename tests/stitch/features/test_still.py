"""What covers the ground at the same place of every frame is found, and nothing else is."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from stitch_ground import Image, textured_ground

from gcs_mosaic.stitch.arrays import Mask
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.features.still import LEAST_GROUNDS, Grounds
from gcs_mosaic.stitch.features.texture import texture
from tests.tiers import thorough

WIDTH, HEIGHT = 480, 360
GROUND = textured_ground(2400, 3)

Draw = Callable[[Image, int], None]


def taken(count: int, draw: Draw, contrast: float = 1.0) -> list[Image]:
    """Frames of different ground, drawn over by `draw`."""
    places, noise = np.random.default_rng(0).integers(0, 1900, (count, 2)), np.random.default_rng(1)
    frames = []
    for k, (x, y) in enumerate(places):
        seen = 128 + contrast * (GROUND[y : y + HEIGHT, x : x + WIDTH].astype(np.float32) - 128)
        image = np.clip(np.rint(seen + noise.normal(0, 1, seen.shape)), 0, 255).astype(np.uint8)
        draw(image, k)
        frames.append(image)
    return frames


def found(frames: list[Image]) -> StillMask | None:
    first, *others = (texture(image) for image in frames)
    grounds = Grounds.of(first)
    for other in others:
        grounds = grounds.after(other)
    return grounds.still()


def covered(frames: list[Image]) -> Mask:
    """Which pixels (h, w) are covered."""
    still = found(frames)
    return np.zeros((HEIGHT, WIDTH), bool) if still is None else still.pixels(HEIGHT, WIDTH)


def nothing(image: Image, k: int) -> None:
    pass


def display(image: Image, k: int) -> None:
    """One line of writing in (40, 40) to (300, 66), whose digits change."""
    cv2.putText(image, f"ALT {10 + 37 * k % 90} HDG {100 + 71 * k % 260}", (40, 62), 0, 0.9, 255, 2, cv2.LINE_AA)


def logo(image: Image, k: int) -> None:
    cv2.circle(image, (400, 80), 36, 230, -1)
    cv2.putText(image, "CAM", (374, 88), 0, 0.8, 20, 2)


def bars(image: Image, k: int) -> None:
    image[:40] = image[-40:] = 0


def leg(image: Image, k: int) -> None:
    cv2.fillPoly(image, [np.array([(0, 200), (90, 240), (90, 262), (0, 230)])], 30)


def dirt(image: Image, k: int) -> None:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    image[:] = image * (1 - 0.8 * np.exp(-((x - 150) ** 2 + (y - 250) ** 2) / 14**2))


BOXES: dict[Draw, tuple[slice, slice]] = {
    display: (slice(42, 62), slice(40, 290)),
    logo: (slice(50, 110), slice(370, 430)),
    bars: (slice(0, 38), slice(0, WIDTH)),
    leg: (slice(222, 238), slice(10, 80)),
    dirt: (slice(242, 258), slice(142, 158)),
}


@pytest.mark.parametrize("contrast", [0.1, 1.0])
@pytest.mark.parametrize("draw", BOXES)
def test_an_overlay_is_found_as_a_whole_and_the_ground_beyond_it_is_not(draw: Draw, contrast: float) -> None:
    mask = covered(taken(16, draw, contrast))
    assert mask[BOXES[draw]].mean() > (
        0.6 if draw is display else 0.8
    )  # its last digits change, with nothing beyond them
    clean = np.ones_like(mask)
    drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
    for k in range(16):
        before = np.full((HEIGHT, WIDTH), 128, np.uint8)
        after = before.copy()
        draw(after, k)
        drawn |= (after != before).astype(np.uint8)
    clean[cv2.dilate(drawn, np.ones((161, 161), np.uint8)) > 0] = False  # the local mean reaches 64 px
    assert not mask[clean].any()


@pytest.mark.parametrize("draw", [display, logo, bars])
def test_a_few_frames_of_poor_ground_are_enough(draw: Draw) -> None:
    assert covered(taken(LEAST_GROUNDS, draw, 0.1))[BOXES[draw]].mean() > 0.7


@pytest.mark.long
@pytest.mark.parametrize("contrast", [0.02, 0.1, 1.0])
@pytest.mark.parametrize("count", [LEAST_GROUNDS, thorough(6), thorough(12), 40])
def test_without_an_overlay_next_to_nothing_is_masked(count: int, contrast: float) -> None:
    assert covered(taken(count, nothing, contrast)).mean() < 0.005


@pytest.mark.long
def test_a_pattern_all_over_the_frame_is_no_overlay_and_writing_on_it_is() -> None:
    noise = np.random.default_rng(2).normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    pattern = 60 * cv2.GaussianBlur(noise, (0, 0), 2)

    def thermal(image: Image, k: int) -> None:
        image[:] = np.clip(image + pattern, 0, 255)

    def thermal_display(image: Image, k: int) -> None:
        thermal(image, k)
        display(image, k)

    assert covered(taken(16, thermal, 0.1)).mean() < 0.005
    mask = covered(taken(16, thermal_display, 0.1))
    assert mask[BOXES[display]].mean() > 0.4
    assert mask[200:].mean() < 0.005


@pytest.mark.long
def test_an_overlay_that_is_switched_off_is_forgotten() -> None:
    on, off = taken(6, logo), taken(60, nothing)
    assert covered(on)[BOXES[logo]].all()
    assert covered(on + off).mean() < 0.005


def test_a_mask_tells_of_points_what_it_tells_of_pixels() -> None:
    blocks = np.random.default_rng(0).random((9, 12)) < 0.5
    mask = StillMask.of(blocks)
    assert np.array_equal(mask.blocks, blocks)
    y, x = np.mgrid[:90, :120]
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    assert np.array_equal(mask.covers(points, 120, 90), mask.pixels(90, 120).ravel())
    assert np.array_equal(mask.covers(points * 4 + 1.5, 480, 360), mask.pixels(90, 120).ravel())
    assert mask.differs(mask) == 0.0
    assert mask.differs(StillMask.of(~blocks)) == 1.0
    assert mask.differs(StillMask.of(blocks[:5])) == 1.0

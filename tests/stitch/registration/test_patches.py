"""Where patches are sought, and which are believed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import AnyArray, FloatImage, Matrix3x3
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration import patches as module
from gcs_mosaic.stitch.registration.patches import ENOUGH, Patches, PatchSize, patches

WIDTH, HEIGHT = 200, 150


def frame(picture: AnyArray) -> Features:
    texture = np.clip(np.rint(picture), -127, 127).astype(np.int8)
    height, width = picture.shape
    none = np.empty((0, 2), np.float32), np.empty((0, 128), np.uint8)
    return Features(*none, width, height, 1.0, kept_texture=texture)


def ground(seed: int = 0, size: tuple[int, int] = (HEIGHT + 140, WIDTH + 140)) -> FloatImage:
    noise = np.random.default_rng(seed).normal(0, 1, size).astype(np.float32)
    soft = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.asarray(40 * soft / soft.std(), np.float32)


def moved(x: float, y: float) -> Matrix3x3:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def cut(x: int, y: int) -> Features:
    return frame(ground()[70 + y : 70 + y + HEIGHT, 70 + x : 70 + x + WIDTH])


def test_patches_are_sought_where_both_frames_show_all_around_them() -> None:
    """A square of 24 px and 7 px around it, in the texture of each."""
    found = patches(cut(0, 0), cut(20, 10), moved(-20, -10))
    assert found.tried == len(found.pixels_a) >= ENOUGH
    assert np.abs(found.pixels_b - found.pixels_a - [-20, -10]).max() < 0.1
    for pixels in (found.pixels_a, found.pixels_b):
        assert (pixels >= 7 + 11.5).all()
        assert (pixels <= np.array([WIDTH, HEIGHT]) - 1 - 7 - 11.5 + 1).all()
    assert (np.diff(np.unique(found.pixels_a[:, 0])) == 28).all()


@pytest.mark.parametrize(("x", "y"), [(60, 0), (-60, 0), (0, 50), (0, -50)])
def test_a_frame_that_ends_within_a_patch_or_around_it_does_not_show_it(x: int, y: int) -> None:
    found = patches(cut(0, 0), cut(x, y), moved(-x, -y))
    inside = (found.pixels_b >= 7 + 11) & (found.pixels_b <= np.array([WIDTH, HEIGHT]) - 7 - 11)
    assert found.tried
    assert inside.all()


@pytest.mark.parametrize("corner", [(0, 0), (0, -1), (-1, 0), (-1, -1)])
@pytest.mark.parametrize(("seen", "shows"), [(1.0, True), (0.995, True), (0.5, False)])
def test_a_patch_is_shown_if_all_its_corners_are(corner: tuple[int, int], seen: float, shows: bool) -> None:
    around = np.ones((38, 38), np.float32)
    around[corner] = seen
    assert module._shows(around) is shows


def test_what_two_places_show_alike_is_not_believed() -> None:
    """Rows agree along themselves: no place stands out."""
    rows = np.asarray(40 * np.sin(np.arange(WIDTH) / 3)[None] * np.ones((HEIGHT, 1)), np.float32)
    noise = ground()[:HEIGHT, :WIDTH] * 0.05
    assert not len(patches(frame(rows + noise), frame(rows), np.eye(3)).pixels_a)


def test_what_is_displaced_as_far_as_is_looked_is_not_believed() -> None:
    """The best place at the edge may be the flank of a better one beyond."""
    here = len(patches(cut(0, 0), cut(0, 0), moved(6, 0)).pixels_a)
    edge = len(patches(cut(0, 0), cut(0, 0), moved(7, 0)).pixels_a)
    assert here >= ENOUGH
    assert edge < here / 2


def test_other_ground_has_no_patch_in_common() -> None:
    other = frame(ground(seed=9)[:HEIGHT, :WIDTH])
    assert len(patches(cut(0, 0), other, np.eye(3)).pixels_a) <= 2


@pytest.mark.parametrize(
    ("found", "sizes_tried", "taken"),
    [((12, 20, 20), 1, 12), ((11, 12, 20), 2, 12), ((11, 5, 8), 3, 11), ((0, 0, 3), 3, 3), ((4, 4, 4), 3, 4)],
)
def test_the_smallest_patches_that_are_enough_are_taken_else_the_most(
    monkeypatch: pytest.MonkeyPatch, found: tuple[int, ...], sizes_tried: int, taken: int
) -> None:
    tried: list[PatchSize] = []

    def some(a: Features, b: Features, b_from_a: Matrix3x3, size: PatchSize) -> Patches:
        tried.append(size)
        return Patches(np.full((found[len(tried) - 1], 2), float(len(tried))), np.empty((0, 2)), 30)

    monkeypatch.setattr(module, "_found", some)
    kept = patches(cut(0, 0), cut(0, 0), np.eye(3))
    assert (len(tried), len(kept.pixels_a)) == (sizes_tried, taken)
    assert kept.pixels_a[0, 0] == 1.0 + found.index(taken)  # of as many the smallest


@pytest.mark.parametrize(
    ("values", "top"),
    [((0, 1, 0), 0.0), ((0, 1, 0.5), 1 / 6), ((0.5, 1, 0), -1 / 6), ((1, 1, 1), 0.0), ((0, 1, 1), 0.5)],
)
def test_the_top_of_a_parabola(values: tuple[float, ...], top: float) -> None:
    assert module._vertex(np.array(values)) == pytest.approx(top)


@pytest.mark.parametrize("is_coarse", [False, True])
def test_pixel_noise_is_blurred_alike_in_both_directions(is_coarse: bool) -> None:
    noise = np.random.default_rng(0).normal(0, 30, (120, 160))
    along, across = (module._picture(frame(one), is_coarse) for one in (noise, noise.T))
    assert np.allclose(along, across.T, atol=1e-3)
    assert along.std() < 12

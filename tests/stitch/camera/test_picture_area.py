"""Where a frame holds a picture: distances from where it does not, and how that is filled."""

import numpy as np

from gcs_mosaic.stitch.arrays import Mask
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from tests.sure import sure

HEIGHT, WIDTH, EDGE = 300, 400, 100


def left_part_empty() -> Mask:
    holds = np.ones((HEIGHT, WIDTH), bool)
    holds[:, :EDGE] = False
    return holds


def test_a_picture_all_over_the_frame_needs_no_mask() -> None:
    assert PictureArea.of(np.ones((HEIGHT, WIDTH), bool)) is None


def test_depth_is_the_distance_from_the_edge_but_for_a_margin() -> None:
    area = sure(PictureArea.of(left_part_empty()))
    points = np.array([[EDGE + 49.5, 150.0], [EDGE - 50.5, 150.0], [WIDTH - 1.0, 0.0], [np.nan, 3.0]])
    inside, outside, far, nowhere = area.depth(points, WIDTH, HEIGHT)
    assert abs(inside - 49) < 1
    assert abs(outside + 51) < 1
    assert far > 290  # the frame's own border is no edge
    assert nowhere < -1000


def test_depth_is_in_pixels_of_whatever_size_the_frame_is_asked_for() -> None:
    area = sure(PictureArea.of(left_part_empty()))
    assert abs(area.depth(np.array([[10 * EDGE + 500.0, 1500.0]]), 10 * WIDTH, 10 * HEIGHT)[0] - 500) < 10


def test_no_pixel_without_a_picture_lies_within() -> None:
    rng = np.random.default_rng(1)
    holds = rng.random((60, 1700)) < 0.9
    holds[:, :900] = True
    area, (y, x) = sure(PictureArea.of(holds)), np.nonzero(~holds)
    assert area.depth(np.column_stack([x, y]).astype(float), 1700, 60).max() < 0
    assert area.pixels(*holds.shape)[:, :890].all()


def test_filling_depends_on_nothing_that_is_there_and_continues_the_picture() -> None:
    area, rng = sure(PictureArea.of(left_part_empty())), np.random.default_rng(1)
    image = np.full((HEIGHT, WIDTH, 3), (40, 90, 200), np.uint8)
    image[:, :EDGE] = rng.integers(0, 255, (HEIGHT, EDGE, 3))
    once = area.filled(image)
    np.testing.assert_array_equal(once, np.full_like(image, (40, 90, 200)))
    np.testing.assert_array_equal(area.filled(once), once)
    counts = np.full((HEIGHT, WIDTH, 5), 30_000, np.uint16)
    np.testing.assert_array_equal(
        area.filled(np.where(left_part_empty()[..., None], counts, 0).astype(np.uint16)), counts
    )

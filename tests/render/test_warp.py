import cv2
import numpy as np
import pytest
from painting_parts import painted, picture

from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.render.warp import tile_picture, upscale
from gcs_mosaic.render.warp_grid import USEFUL_RATIO, frame_lattice, useful_ground
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, ground_sampling_distance, pixels_from_canvas
from tests.sure import sure
from tests.tile_parts import own_level, pixel_centres

FULL = Camera(4000, 3000)


@pytest.mark.long
@pytest.mark.parametrize("k1", [-0.2, 0.0, 0.2])
@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_interpolated_places_are_right_to_a_tenth_of_a_pixel(k1: float, tilt: float) -> None:
    camera, pose = Camera(4000, 3000, 1.2, k1), Pose(100.3, -70.7, 0.05, 0.4, tilt, -0.1)
    lattice = sure(frame_lattice(pose, camera, own_level(pose, camera)))
    for tile in list(lattice.tiles())[::7]:
        exact = pixels_from_canvas(pose, camera, pixel_centres(tile).reshape(-1, 2)).reshape(TILE_SIZE, TILE_SIZE, 2)
        inside = ((exact > -0.5) & (exact < [3999.5, 2999.5])).all(axis=-1)
        error = np.abs(upscale(lattice.pixels[lattice.window(tile)]) - exact)[inside]
        assert not inside.any() or error.max() < 0.1


def test_a_frame_that_lies_on_the_grid_is_copied_exactly() -> None:
    frame = painted(0, 79.5, 59.5, camera=Camera(160, 120))
    image = picture(1)
    lattice = sure(frame_lattice(frame.pose, frame.camera, 16))
    colour, coverage = tile_picture(lattice, image, Tile(16, 1 << 15, 1 << 15), cv2.INTER_CUBIC)
    np.testing.assert_array_equal(colour[:120, :160], image)
    assert coverage is not None
    assert (coverage[:120, :160] == 255).all()
    assert coverage.sum() == 255 * 120 * 160


@pytest.mark.parametrize("interpolation", [cv2.INTER_LINEAR, cv2.INTER_CUBIC])
def test_no_border_is_darker_than_the_frame(interpolation: int) -> None:
    frame = painted(0, 30, 40, yaw=0.5, pitch=0.1, gsd=1.3)
    lattice = sure(frame_lattice(frame.pose, frame.camera, frame.level))
    grey = np.full((120, 160, 3), 120, np.uint8)
    for tile in lattice.tiles():
        colour, coverage = tile_picture(lattice, grey, tile, interpolation)
        shown = np.ones((TILE_SIZE, TILE_SIZE), bool) if coverage is None else coverage == 255
        assert (colour[shown] == 120).all()
        assert (colour[~shown] == 0).all()


def test_a_frame_that_sees_the_horizon_is_painted_where_it_resolves_the_ground() -> None:
    pose = Pose(0, 0, 0.0, 0.0, 0.0, np.radians(65))
    lattice = sure(frame_lattice(pose, FULL, own_level(pose, FULL)))
    tiles = list(lattice.tiles())
    assert 0.3 < len(tiles) * TILE_SIZE**2 / (4000 * 3000) < 4.5
    _, best = sure(useful_ground(pose, FULL))
    image = np.full((3000, 4000, 3), 9, np.uint8)
    for tile in tiles[::9]:
        _, coverage = tile_picture(lattice, image, tile, cv2.INTER_LINEAR)
        shown = pixel_centres(tile)[slice(None) if coverage is None else coverage == 255].reshape(-1, 2)
        gsd = ground_sampling_distance(pose, FULL, pixels_from_canvas(pose, FULL, shown))
        assert not len(gsd) or gsd.max() < 1.05 * USEFUL_RATIO * best


def test_a_frame_that_looks_at_the_sky_has_no_lattice() -> None:
    assert frame_lattice(Pose(0, 0, 0.0, 0.0, 0.0, np.radians(175)), FULL, 16) is None


def test_a_level_far_too_fine_is_refused() -> None:
    with pytest.raises(ValueError, match="tiles at level 21"):
        frame_lattice(Pose(0, 0), FULL, 21)


def test_weight_is_greatest_in_the_middle_and_nothing_at_the_border() -> None:
    lattice = sure(frame_lattice(Pose(0, 0), FULL, 16))
    middle = np.unravel_index(lattice.weight.argmax(), lattice.weight.shape)
    np.testing.assert_allclose(lattice.pixels[middle], [1999.5, 1499.5], atol=510)
    assert (lattice.weight[~lattice.inside()] == 0).all()


def test_a_coarser_frame_weighs_less_on_the_same_level() -> None:
    fine, coarse = (sure(frame_lattice(Pose(0, 0, np.log(gsd)), FULL, 16)) for gsd in (1.0, 1.6))
    assert coarse.weight.max() == pytest.approx(fine.weight.max() / 1.6**2, rel=0.05)

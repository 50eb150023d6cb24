from __future__ import annotations

import io
from dataclasses import replace

import cv2
import numpy as np
import pytest
import tifffile

from sitl.camera import Scene
from sitl.geometry import CameraState
from sitl.sensor import MOST_BANDS, Sensor

ABOVE = CameraState(time=0, x=-8, y=5, height=60, yaw=0.1)


def seen(scene: Scene, **sensor: int) -> tuple[Sensor, np.ndarray, bytes]:
    """A sensor, its picture, and the file of it."""
    camera = replace(scene.camera, sensor=Sensor(**sensor), noise=0.0)
    noiseless = replace(scene, camera=camera)
    return camera.sensor, noiseless.picture(ABOVE, 0), noiseless.encoded(ABOVE, 0)


@pytest.mark.parametrize("bands", [2, 4, 5, MOST_BANDS])
@pytest.mark.parametrize("depth", [8, 16])
def test_many_bands_are_a_tiff_that_keeps_every_count(scene: Scene, bands: int, depth: int) -> None:
    _, picture, data = seen(scene, bands=bands, depth=depth)
    assert picture.shape == (480, 640, bands)
    np.testing.assert_array_equal(tifffile.imread(io.BytesIO(data)), picture)


def test_deep_colour_is_stored_as_red_green_blue(scene: Scene) -> None:
    _, picture, data = seen(scene, bands=3, depth=16)
    np.testing.assert_array_equal(tifffile.imread(io.BytesIO(data)), picture[..., ::-1])
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), picture)


def test_bands_are_sums_of_the_colours(scene: Scene) -> None:
    """The truth of every band is known from that of the ground's picture."""
    _, colour, _ = seen(scene, bands=3, depth=16)
    _, five, _ = seen(scene, bands=5, depth=16)
    levels = (colour.astype(float) - 200) / 40
    np.testing.assert_array_equal(five[..., :3], colour)
    infrared = np.maximum(levels @ [-0.4, 1.9, -0.5], 0)
    np.testing.assert_allclose((five[..., 4] - 200.0) / 40, infrared, atol=0.1)


def test_one_deep_band_is_like_a_thermal_camera(scene: Scene) -> None:
    sensor, picture, _ = seen(scene, bands=1, depth=16)
    assert sensor.suffix == ".TIF"
    assert 29_000 <= picture.min() < picture.max() < 29_400


def test_colour_in_eight_bits_stays_a_jpeg(scene: Scene) -> None:
    sensor, picture, data = seen(scene)
    assert (sensor.suffix, picture.dtype, data[:2]) == (".JPG", np.dtype(np.uint8), b"\xff\xd8")


@pytest.mark.parametrize("wrong", [{"bands": 0}, {"bands": MOST_BANDS + 1}, {"depth": 12}])
def test_what_no_sensor_has_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="bands of"):
        Sensor(**wrong)

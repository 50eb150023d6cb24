"""White stays white, whatever a correction does to the light around it."""

import numpy as np
import pytest
from painting_parts import Looks, painted

from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.light_field import COLUMNS, ROWS, STEPS, LightField
from gcs_mosaic.render.pixels import NEARS_WHITE, with_whites
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Camera
from tests.sure import sure

GREYS = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)


@pytest.mark.parametrize("factor", [0.4, 0.7, 0.95])
def test_a_ramp_that_is_darkened_stays_a_ramp_up_to_white(factor: float) -> None:
    dark = np.rint(GREYS * factor).astype(np.uint8)
    shown = with_whites(dark, GREYS)[0, :, 0].astype(int)
    assert (np.diff(shown) >= 0).all()
    assert (shown[: NEARS_WHITE + 1] == dark[0, : NEARS_WHITE + 1, 0]).all()
    assert (shown[250:] == np.arange(250, 256)).all()


def test_light_of_which_one_channel_is_saturated_keeps_its_hue() -> None:
    red = np.full((2, 2, 3), (60, 80, 255), np.uint8)
    dark = (red * 0.5).astype(np.uint8)
    assert with_whites(dark, red) is dark


FIELD = LightField(np.full((ROWS, COLUMNS, 3), round(np.log(0.7) * STEPS), np.int8).tobytes())


@pytest.mark.parametrize("looks", [Looks(gain=(0.7, 0.7, 0.7)), Looks(light=FIELD), Looks(gain=(1.4, 1.4, 1.4))])
def test_a_frame_shows_white_as_white_and_all_else_corrected(looks: Looks) -> None:
    camera, picture = Camera(512, 512, focal=1.2), np.full((512, 512, 3), 120, np.uint8)
    picture[:, 200:300] = 255
    with TileCompositor(lambda name: None, CompositorSettings(interpolation="linear")) as canvas:
        canvas.paint(picture, painted(0, 256.0, 256.0, camera=camera, **looks))
        row = sure(canvas.tile(0, Tile(16, 1 << 15, 1 << 15))).colour[128]
    assert (row[210:250] >= 250).all()
    assert abs(row[100].astype(float) - 120 * (1.4 if looks.get("gain", (0,))[0] > 1 else 0.7)).max() <= 2

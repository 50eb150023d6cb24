"""What holds no picture is painted nowhere, and hides no other frame's ground."""

from dataclasses import replace

import numpy as np

from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.picture_area import PictureArea

WIDTH, HEIGHT = 512, 384
CORNER = np.add.outer(np.arange(HEIGHT), np.arange(WIDTH)) < 250
AREA = PictureArea.of(~CORNER)


def ground() -> Bands:
    rng = np.random.default_rng(0)
    return rng.integers(60, 200, (HEIGHT, WIDTH, 3), dtype=np.uint8)


IMAGES = {"whole": ground(), "cut": np.where(CORNER[..., None], np.uint8(0), ground())}


def one(name: str, order: int) -> RenderItem:
    area = AREA if name == "cut" else None
    camera = Camera(WIDTH, HEIGHT)
    return RenderItem(name=name, order=order, island=0, pose=Pose(0.0, 0.0, 0.0), camera=camera, area=area, level=16)


def colours(*frames: RenderItem) -> tuple[int, int]:
    """How many pixels of the map are shown, and how many of these are black."""
    with TileCompositor(lambda name: IMAGES[name]) as canvas:
        tiles = {key for frame in frames for key in canvas.paint(IMAGES[frame.name], frame) if key[1].z == 16}
        for _ in canvas.repaint():
            pass
        pictures = [picture for key in tiles if (picture := canvas.tile(*key)) is not None]
    seen = [(picture.coverage > 0, picture.colour.max(axis=2) < 40) for picture in pictures]
    return sum(int(shown.sum()) for shown, _ in seen), sum(int((shown & dark).sum()) for shown, dark in seen)


def test_it_is_not_painted() -> None:
    shown, black = colours(one("cut", 0))
    whole, _ = colours(replace(one("cut", 0), area=None))
    assert black == 0
    assert 0.95 * (~CORNER).mean() * whole < shown <= (~CORNER).mean() * whole


def test_it_hides_no_other_frame() -> None:
    alone = colours(one("whole", 0))
    assert colours(one("whole", 0), one("cut", 1)) == alone
    assert alone[1] == 0

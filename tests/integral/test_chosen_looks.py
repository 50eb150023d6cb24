"""Of many looks as few are laid together as tell nearly all, and none is left out that a place needs."""

import numpy as np

from gcs_mosaic.integral.chosen_looks import MOST_LOOKS, chosen
from gcs_mosaic.integral.focal_plane import pixels_at
from gcs_mosaic.integral.stack import GroundWindow
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose

CAMERA = Camera(640, 480)
WINDOW = GroundWindow(0.0, 0.0, 512.0, 512)


def looks(step: float, count: int) -> list[RenderItem]:
    """One line of frames over the window, each `step` canvas units further."""
    along = (np.arange(count) - (count - 1) / 2) * step
    return [
        RenderItem(name=str(k), order=k, island=0, pose=Pose(float(x), 0.0), camera=CAMERA, level=0)
        for k, x in enumerate(along)
    ]


def counts(some: list[RenderItem], indices: list[int]) -> np.ndarray:
    """How many of the looks see each of many places of the window."""
    x, y = np.meshgrid(*[np.linspace(-220, 220, 89)] * 2)  # within the frames' line
    places = np.column_stack([x.ravel(), y.ravel()])
    found = np.zeros(len(places), int)
    for index in indices:
        pixels = pixels_at(some[index].pose, CAMERA, None, places, 0.0)
        found += ((pixels > 0) & (pixels < [CAMERA.width, CAMERA.height])).all(axis=1)
    return found


def test_few_looks_are_all_taken() -> None:
    assert chosen(looks(40.0, MOST_LOOKS), WINDOW) == list(range(MOST_LOOKS))


def test_of_many_looks_few_are_taken_and_the_widest_apart() -> None:
    some = looks(2.0, 120)
    indices = chosen(some, WINDOW)
    assert len(indices) < len(some) / 2
    assert indices == sorted(indices)
    assert {0, len(some) - 1} <= set(indices)


def test_no_place_has_fewer_looks_than_are_wanted_if_there_are_so_many() -> None:
    some = looks(6.0, 150)
    every, taken = counts(some, list(range(len(some)))), counts(some, chosen(some, WINDOW))
    assert (taken >= np.minimum(every, MOST_LOOKS)).all()
    assert taken.sum() < 0.8 * every.sum()

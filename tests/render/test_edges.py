import cv2
import numpy as np
import pytest

from gcs_mosaic.render.cells import WHOLLY, Owned, Seen, lay_over, unknown
from gcs_mosaic.render.edges import decide, edge_density, mixed

SHAPE = 4, 4


def seen(weight: float, density: float = 0.0) -> Seen:
    score = np.full(SHAPE, np.log(weight), np.float32)
    return Seen(np.full(SHAPE, WHOLLY, np.uint8), score, np.full((1, *SHAPE), round(255 * density), np.uint8))


def owned(*frames: Seen) -> Owned:
    cells = unknown(SHAPE, 1)
    for number, new in enumerate(frames):
        cells, _ = lay_over(cells, new, number, decide(cells, new))
    return mixed(cells)


def share_of_new(weight: float, density: float = 0.0) -> float:
    """Of the second of two frames, the first of which weighs 0.5."""
    found = owned(seen(0.5), seen(weight, density))
    return float((found.share if found.first[0, 0] == 1 else 255 - found.share)[0, 0] / 255)


def test_on_smooth_ground_the_heavier_frame_shows_more() -> None:
    shares = [share_of_new(weight) for weight in (0.3, 0.5, 0.7)]
    assert 0 < shares[0] < 0.2
    assert shares[1] == pytest.approx(0.5, abs=0.01)
    assert 0.75 < shares[2] < 1


def test_where_edges_are_dense_one_frame_shows_alone() -> None:
    shares = [share_of_new(weight, 1.0) for weight in (0.3, 0.5, 0.7)]
    assert shares == pytest.approx([0, 1, 1], abs=0.01)


def test_of_three_frames_the_two_best_show() -> None:
    found = owned(seen(0.5), seen(0.02), seen(0.45))
    assert (found.first == 0).all()
    assert (found.second == 2).all()
    assert (found.share < 160).all()


@pytest.mark.parametrize("contrast", [0.3, 1.0])
def test_edges_are_found_where_they_are_dense_in_dim_light_too(contrast: float) -> None:
    rng = np.random.default_rng(1)
    ground = np.full((600, 800, 3), 100, np.float32) + rng.normal(0, 2, (600, 800, 3))
    ground[:, 500:] += cv2.GaussianBlur(rng.normal(0, 600, (600, 300, 3)), (0, 0), 2)
    density = edge_density(np.clip(ground * contrast, 0, 255).astype(np.uint8))
    assert density.shape == (150, 200, 1)
    assert density[20:-20, 150:180].mean() > 0.8
    assert density[20:-20, 20:100].mean() < 0.1

"""The curves lie where the axes say."""

import numpy as np
import pytest

from tests.benchmarks.error_chart import BOTTOM, COLOURS, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Curve, Panel, draw_errors

pytestmark = pytest.mark.long


PIXELS_PER_DECADE = (HEIGHT - TOP - BOTTOM) / 2


def heights(picture: np.ndarray, number: int, frame: int, of: int, panel: int = 0) -> list[float]:
    """Errors in pixels that the picture shows for a frame on a curve, read off the axis from 1 to 100."""
    left = panel * WIDTH + LEFT
    x = round(left + (frame + 0.5) / of * (WIDTH - LEFT - RIGHT))
    column = picture[TOP : HEIGHT - BOTTOM + 1, x].astype(int)
    rows = np.flatnonzero((np.abs(column - COLOURS[number]) < 40).all(axis=1))
    return [float(error) for error in 100 / 10 ** (rows / PIXELS_PER_DECADE)]


def test_errors_are_drawn_at_their_size_and_frames_that_were_not_placed_leave_a_gap() -> None:
    before = np.concatenate([np.full(20, 50.0), np.full(20, 99.0)])
    after = np.where((np.arange(40) > 9) & (np.arange(40) < 20), np.nan, 2.0)
    picture = draw_errors([Panel("a flight", [Curve("before", before), Curve("after", after)])])
    assert heights(picture, 0, 10, 40) == pytest.approx([50] * len(heights(picture, 0, 10, 40)), rel=0.05)
    assert heights(picture, 0, 30, 40) == pytest.approx([99] * len(heights(picture, 0, 30, 40)), rel=0.05)
    assert heights(picture, 1, 30, 40) == pytest.approx([2] * len(heights(picture, 1, 30, 40)), rel=0.05)
    assert heights(picture, 0, 10, 40)
    assert heights(picture, 0, 30, 40)
    assert heights(picture, 1, 30, 40)
    assert not heights(picture, 1, 15, 40)


def test_all_panels_have_one_scale() -> None:
    small, large = (Panel("", [Curve("", np.full(10, error))]) for error in (2.0, 90.0))
    picture = draw_errors([small, large])
    assert picture.shape == (HEIGHT, 2 * WIDTH, 3)
    assert np.median(heights(picture, 0, 5, 10, panel=0)) == pytest.approx(2, rel=0.03)
    assert np.median(heights(picture, 0, 5, 10, panel=1)) == pytest.approx(90, rel=0.03)

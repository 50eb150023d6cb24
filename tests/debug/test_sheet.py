"""What is drawn is where it should be, and nowhere else."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.debug.sheet import PAPER, Anchor, Sheet, nice_length, rainbow

RED, BLACK = (0, 0, 255), (0, 0, 0)


def drawn(sheet: Sheet) -> NDArray[np.bool_]:
    """(h, w): which pixels are no longer paper."""
    return np.asarray((np.abs(sheet.picture().astype(int) - PAPER) > 8).any(axis=2))


def test_a_line_is_drawn_where_it_runs_and_broken_by_nan() -> None:
    sheet = Sheet(100, 60)
    sheet.lines(np.array([[10, 20], [40, 20], [np.nan, np.nan], [60, 20], [90, 20.0]]), BLACK, 2)
    row = drawn(sheet)[20]
    assert row[10:41].all()
    assert row[60:91].all()
    assert not row[43:58].any()
    assert not drawn(sheet)[:17].any()
    assert not drawn(sheet)[24:].any()


def test_a_filled_polygon_is_tinted_inside_only_even_where_it_leaves_the_sheet() -> None:
    sheet = Sheet(100, 60)
    sheet.fill(np.array([[50, 10], [140, 10], [140, 40], [50, 40.0]]), RED, 0.5)
    picture = sheet.picture()
    assert picture[25, 75].tolist() == pytest.approx([125, 125, 252], abs=2)
    assert picture[12, 52].tolist() == picture[38, 97].tolist() == picture[25, 75].tolist()
    assert not drawn(sheet)[:, :48].any()
    assert not drawn(sheet)[43:].any()


def test_an_arrow_has_its_head_at_its_end() -> None:
    sheet = Sheet(100, 60)
    sheet.arrow(np.array([20.0, 30]), np.array([60.0, 30]), BLACK, 1)
    ink = drawn(sheet)
    assert ink[30, 20:60].all()
    assert ink[25:36, 45:60].sum() > ink[25:36, 20:35].sum() * 1.5
    assert not ink[:, 64:].any()
    sheet.arrow(np.array([20.0, np.nan]), np.array([60.0, 50]), BLACK, 1)  # nowhere: nothing
    assert (drawn(sheet) == ink).all()


@pytest.mark.parametrize(("anchor", "left", "right"), [("left", 100, 180), ("middle", 60, 140), ("right", 20, 100)])
def test_words_stand_where_they_are_anchored(anchor: Anchor, left: int, right: int) -> None:
    sheet = Sheet(200, 40)
    sheet.words((100, 25), "words", BLACK, 16, anchor)
    columns = np.flatnonzero(drawn(sheet).any(axis=0))
    assert left - 3 <= columns[0] <= columns[-1] <= right + 3
    assert len(columns) > 20


def test_a_picture_is_pasted_where_it_belongs() -> None:
    sheet = Sheet(50, 40)
    sheet.paste(np.full((10, 20, 3), (0, 90, 200), np.uint8), 5, 7)
    inside = np.zeros((40, 50), bool)
    inside[7:17, 5:25] = True
    assert (drawn(sheet) == inside).all()
    assert sheet.picture()[10, 10].tolist() == [0, 90, 200]


def test_the_rainbow_goes_from_blue_to_red() -> None:
    first, last = rainbow(np.array([0.0, 1.0]))
    assert first[0] > 2 * first[2]
    assert last[2] > 2 * last[0]


@pytest.mark.parametrize(("longest", "nice"), [(1, 1), (1.9, 1), (2.5, 2), (70, 50), (0.3, 0.2), (999, 500)])
def test_nice_lengths(longest: float, nice: float) -> None:
    assert nice_length(longest) == pytest.approx(nice)

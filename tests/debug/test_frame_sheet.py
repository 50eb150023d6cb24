"""Frames beside each other, and what is drawn on them."""

import numpy as np

from gcs_mosaic.debug.frame_sheet import (
    ARROW_GRID,
    FRAME_WIDTH,
    GAP,
    HEAD,
    PANEL_WIDTH,
    PairSeen,
    draw_matches,
    draw_relief,
)
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.graph.placement import Placement

GREY = np.full((300, 400, 3), 128, np.uint8)
STARTS, ENDS = np.array([[100.0, 50], [300, 200]]), np.array([[50.0, 60], [250, 210]])


def off_grey(picture: ImageBGR, x: int, y: int) -> bool:
    return bool((np.abs(picture[y - 1 : y + 2, x - 1 : x + 2].astype(int) - 128) > 20).any())


def pair(doubt: str) -> PairSeen:
    return PairSeen("a/one.jpg", "a/two.jpg", STARTS, ENDS, 9, 2, doubt)


def test_what_agrees_is_connected() -> None:
    picture = draw_matches(pair(""), GREY, GREY)
    zoom = FRAME_WIDTH / 400
    assert picture.shape == (HEAD + 600, 2 * FRAME_WIDTH + GAP, 3)
    for start, end in zip(STARTS, ENDS, strict=True):
        a, b = start * zoom + [0, HEAD], end * zoom + [FRAME_WIDTH + GAP, HEAD]
        for share in (0, 0.25, 0.75, 1):
            assert off_grey(picture, *np.rint(a + share * (b - a)).astype(int).tolist())
    assert not off_grey(picture, 100, HEAD + 500)
    assert not off_grey(picture, FRAME_WIDTH + GAP + 700, HEAD + 50)


def test_a_refusal_is_said_in_red_and_belief_in_green() -> None:
    refused, believed = (draw_matches(pair(doubt), GREY, GREY)[: HEAD - 4].astype(int) for doubt in ("no", ""))
    (red, no_green), (no_red, green) = (
        ((p[..., 2] - p[..., 1] > 80).sum(), (p[..., 1] - p[..., 2] > 60).sum()) for p in (refused, believed)
    )
    assert red > 100
    assert no_green == 0
    assert green > 100
    assert no_red == 0


def test_relief_is_drawn_as_arrows_in_its_direction(two_placements: list[Placement]) -> None:
    picture = draw_relief([(placement, GREY) for placement in two_placements]).astype(int)
    top, height = HEAD + 30, round(300 * PANEL_WIDTH / 400)
    flat, shifted = (picture[top : top + height, x : x + PANEL_WIDTH] for x in (GAP, GAP + PANEL_WIDTH + GAP))
    ink = (np.abs(shifted - shifted[0, 0]) > 25).any(axis=2)
    cell = PANEL_WIDTH / ARROW_GRID[0]
    row = round(height * 4.5 / ARROW_GRID[1])
    start = round(cell * 5.5)  # of the sixth arrow; it points to the right by about a cell
    assert ink[row - 1 : row + 2, start : start + round(cell * 0.7)].any(axis=0).all()
    assert not ink[row - 12 : row - 8, :].any()
    assert ink.sum() > 10 * (np.abs(flat - flat[0, 0]) > 25).any(axis=2).sum()

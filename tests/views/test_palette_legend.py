"""The legend of a palette is found where a camera has burnt it in, and nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gcs_mosaic.views.palette_legend import PARTS, legend_in
from tests.palette_flight import IRON, RAINBOW, Colours, coloured, survey
from tests.sure import sure

PALETTES = {"iron": IRON, "rainbow": RAINBOW}
SEEN = list(survey(1, 7).frames())[::3]


def taken(palette: Colours, *, legend: bool = True, quality: int = 90, times: int = 1) -> list[Colours]:
    pictures = []
    for counts in SEEN:
        picture = cv2.resize(coloured(palette, legend=legend)(counts), None, fx=times, fy=times)
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        pictures.append(np.asarray(sure(cv2.imdecode(data, cv2.IMREAD_COLOR)), np.uint8))
    return pictures


def beside(told: list[tuple[int, int, int]], palette: Colours) -> float:
    """Grey levels, from the palette from cold to hot."""
    steps = palette[np.linspace(0, 255, PARTS).astype(int)].astype(float)
    return float(np.abs(np.array(told) - steps).mean())


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("quality", [80, 95])
@pytest.mark.parametrize("name", PALETTES)
def test_its_colours_are_told_from_cold_to_hot(name: str, quality: int, times: int) -> None:
    pictures = taken(PALETTES[name], quality=quality, times=times)
    told = legend_in(pictures)
    assert beside(told, PALETTES[name]) < 15
    lying = legend_in([np.ascontiguousarray(np.rot90(one, -1)) for one in pictures])
    assert beside(lying, PALETTES[name]) < 15


@pytest.mark.parametrize("name", PALETTES)
def test_without_a_bar_none_is_told(name: str) -> None:
    assert legend_in(taken(PALETTES[name], legend=False)) == []


def test_one_picture_does_not_tell_what_stands_still() -> None:
    one, other, _ = taken(IRON)
    assert legend_in([one]) == []
    assert legend_in([one, np.ascontiguousarray(other[:-2])]) == []
    assert legend_in([]) == []


def test_bars_of_one_colour_are_no_legend() -> None:
    pictures = taken(IRON, legend=False)
    for one in pictures:
        one[:, :16] = 0
        one[40:200, 298:310] = 128
    assert legend_in(pictures) == []


def test_the_same_picture_again_has_no_legend() -> None:
    still = taken(IRON, legend=False)[0]
    assert legend_in([still, still, still]) == []

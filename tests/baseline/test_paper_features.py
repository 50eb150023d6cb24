"""Features of the region of interest, block by block."""

from itertools import pairwise

import numpy as np
import pytest

from gcs_mosaic.baseline import features as paper_features
from gcs_mosaic.baseline.features import frame_features, region_features
from gcs_mosaic.stitch.arrays import ImageBGR


def colour(grey: ImageBGR) -> ImageBGR:
    return np.repeat(grey[..., None], 3, axis=2)


def test_blocks_find_what_the_whole_picture_shows(ground: ImageBGR, monkeypatch: pytest.MonkeyPatch) -> None:
    picture, everywhere = colour(ground[:700, :900]), np.full((700, 900), 255, np.uint8)
    whole = region_features(picture, everywhere, "sift")
    monkeypatch.setattr(paper_features, "BLOCK", 256)
    pieces = region_features(picture, everywhere, "sift")
    known = {tuple(p) for p in whole.points.round(1)}
    again = [tuple(p) in known for p in pieces.points.round(1)]
    assert len(pieces.points) == pytest.approx(len(whole.points), rel=0.03)
    assert np.mean(again) > 0.95


@pytest.mark.parametrize("side", [1, 255, 384, 385, 640, 641, 1000, 2047, 5120])
def test_blocks_cover_a_side_without_gap_or_overlap(side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper_features, "BLOCK", 256)
    spans = paper_features._spans(side)
    assert [spans[0][0], spans[-1][1]] == [0, side]
    assert all(end == start for (_, end), (start, _) in pairwise(spans))
    assert max(end - start for start, end in spans) <= 384


def test_what_the_mosaic_does_not_show_has_no_features(ground: ImageBGR) -> None:
    coverage = np.full((400, 600), 255, np.uint8)
    coverage[:, 300:] = 0
    found = region_features(colour(ground[:400, :600]), coverage, "sift")
    assert len(found.points) > 100
    assert found.points[:, 0].max() < 300


def test_points_of_a_reduced_frame_are_in_full_pixels(ground: ImageBGR) -> None:
    picture = colour(ground[:360, :480])
    once, twice = (frame_features(picture, "orb", reduction) for reduction in (1, 2))
    assert np.allclose(twice.points, once.points * 2 + 0.5)
    assert (twice.width, twice.height) == (960, 720)

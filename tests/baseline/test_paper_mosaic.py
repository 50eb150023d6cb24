"""The paper's recipe on small frames of a known ground, and the bounds that stop it."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, photograph

from gcs_mosaic.baseline.mosaic import PaperMosaic, PaperSettings, footprint_window
from gcs_mosaic.baseline.raster import RasterBox
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.camera.geometry import Pose, canvas_from_pixels, pixel_grid, similarity_between
from gcs_mosaic.stitch.features.detectors import FeatureKind
from gcs_mosaic.stitch.graph.placement import Placement, Rejection
from tests.tiers import thorough

LINE = [Pose(600.0 + 90 * k, 700.0 + 20 * k, 0.0, 0.1 * k) for k in range(5)]


def frame(ground: ImageBGR, pose: Pose) -> ImageBGR:
    return np.asarray(cv2.cvtColor(photograph(ground, pose, SMALL_CAMERA), cv2.COLOR_GRAY2BGR), np.uint8)


def flown(
    ground: ImageBGR, poses: Iterable[Pose], settings: PaperSettings | None = None
) -> tuple[PaperMosaic, list[Placement | Rejection]]:
    mosaic = PaperMosaic(settings)
    return mosaic, [mosaic.add(frame(ground, pose), str(k)) for k, pose in enumerate(poses)]


def laid_error(placements: Sequence[Placement], poses: Sequence[Pose]) -> float:
    """RMS distance of the places of a grid of pixels from the truth after one similarity, ground pixels."""
    grid = pixel_grid(SMALL_CAMERA, 5, 4)
    found = np.concatenate([cv2.perspectiveTransform(grid[None], p.canvas_from_frame)[0] for p in placements])
    true = np.concatenate([canvas_from_pixels(poses[int(p.name)], SMALL_CAMERA, grid) for p in placements])
    scale, angle, shift = similarity_between(found, true)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return float(np.sqrt(((scale * found @ turn + shift - true) ** 2).sum(axis=1).mean()))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["sift", thorough("orb"), thorough("surf")])
def test_a_short_flight_lies_where_it_was_taken(ground: ImageBGR, kind: FeatureKind) -> None:
    if kind == "surf":
        pytest.importorskip("mahotas")
    mosaic, outcomes = flown(ground, LINE, PaperSettings(features=kind))
    placed = [one for one in outcomes if isinstance(one, Placement)]
    assert placed == outcomes
    assert laid_error(mosaic.placements(), LINE) < (1.5 if kind == "sift" else 6)  # what the paper says of ORB
    assert [one.hops for one in placed] == [0, 1, 2, 3, 4]
    assert all(one.inliers >= mosaic.recipe.least_inliers for one in placed[1:])


@pytest.mark.long
def test_the_picture_shows_the_ground_where_the_placements_say(ground: ImageBGR) -> None:
    mosaic, _ = flown(ground, LINE)
    there = RasterBox(0, 0, 480, 360)  # the first frame, which later ones were laid on
    colour, coverage = mosaic.raster.part(there)
    assert coverage.all()
    taken = frame(ground, LINE[0])
    assert np.abs(colour[20:-20, 20:-20].astype(int) - taken[20:-20, 20:-20]).mean() < 8


def test_a_reduced_flight_has_placements_in_full_pixels(ground: ImageBGR) -> None:
    mosaic = PaperMosaic(reduction=2)
    for k, pose in enumerate(LINE[:3]):
        small = cv2.resize(frame(ground, pose), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        assert isinstance(mosaic.add(small, str(k)), Placement)
    assert laid_error(mosaic.placements(), LINE) < 1.5
    assert mosaic.placements()[0].canvas_from_frame == pytest.approx(np.eye(3))
    assert mosaic.raster.level == 15


def test_a_stranger_is_rejected_and_changes_nothing(ground: ImageBGR, other_ground: ImageBGR) -> None:
    mosaic, _ = flown(ground, LINE[:2])
    before = [array.copy() for array in mosaic.raster.part(mosaic.raster.window)]
    outcome = mosaic.add(frame(other_ground, Pose(600.0, 600.0)), "stranger")
    assert isinstance(outcome, Rejection)
    assert "matches with the region of interest" in outcome.reason
    assert all((a == b).all() for a, b in zip(before, mosaic.raster.part(mosaic.raster.window), strict=True))
    assert isinstance(mosaic.add(frame(ground, LINE[2]), "2"), Placement)


def test_a_flight_does_not_begin_with_a_frame_that_shows_nothing(ground: ImageBGR) -> None:
    mosaic = PaperMosaic()
    outcome = mosaic.add(np.full((360, 480, 3), 90, np.uint8), "nothing")
    assert outcome == Rejection("nothing", "too little to see: 0 features")
    assert isinstance(mosaic.add(frame(ground, LINE[0]), "0"), Placement)


@pytest.mark.long
def test_ground_outside_the_region_of_interest_is_not_found_again(ground: ImageBGR) -> None:
    """The one thing that keeps the cost of a frame constant: what is farther off than a frame's width is not looked at."""
    away = [Pose(400.0 + 200 * k, 500.0) for k in range(8)]
    mosaic, outcomes = flown(ground, away)
    assert all(isinstance(one, Placement) for one in outcomes)
    assert isinstance(mosaic.add(frame(ground, away[0]), "again"), Rejection)


def test_a_mosaic_that_outgrows_its_bound_is_stopped_with_a_reason(ground: ImageBGR) -> None:
    _, outcomes = flown(
        ground, [Pose(400.0 + 150 * k, 500.0 + 20 * k) for k in range(6)], PaperSettings(most_megapixels=0.6)
    )
    assert [isinstance(one, Placement) for one in outcomes] == [True, True, True, True, False, False]
    assert outcomes[4] == Rejection("4", "the mosaic would have 0.655 megapixels, 0.6 allowed")


@pytest.mark.long
def test_frames_that_grow_and_grow_are_stopped_with_a_reason(ground: ImageBGR) -> None:
    climb = [Pose(1200.0, 1200.0, 0.35 * k) for k in range(5)]
    mosaic, outcomes = flown(ground, climb, PaperSettings(largest_growth=5.0))
    assert [isinstance(one, Placement) for one in outcomes] == [True, True, True, False, False]
    assert outcomes[3] == Rejection("3", "it would cover 8 times its own pixels, 5 allowed")
    assert len(mosaic.placements()) == 3


@pytest.mark.parametrize(
    "homography",
    [
        [[1, 0, 0], [0, 1, 0], [-0.003, 0, 1]],  # the right edge lies beyond the horizon
        [[-1, 0, 400], [0, 1, 0], [0, 0, 1]],  # a mirror
        [[1e7, 0, 0], [0, 1e7, 0], [0, 0, 1]],
    ],
)
def test_what_no_camera_sees_has_no_footprint(homography: list[list[float]]) -> None:
    assert footprint_window(np.array(homography, float), 480, 360) is None


def test_a_footprint_holds_whole_pixels() -> None:
    assert footprint_window(np.eye(3), 480, 360) == RasterBox(0, 0, 480, 360)
    shifted = np.array([[1, 0, 10.25], [0, 1, -3.0], [0, 0, 1]])
    assert footprint_window(shifted, 480, 360) == RasterBox(10, -3, 491, 357)
    assert footprint_window(-shifted, 480, 360) == RasterBox(10, -3, 491, 357)


def test_sixteen_bits_of_one_band_are_stitched_as_a_person_sees_them(ground: ImageBGR) -> None:
    mosaic = PaperMosaic()
    for k, pose in enumerate(LINE[:3]):
        thermal = photograph(ground, pose, SMALL_CAMERA).astype(np.uint16) * 4 + 7000
        assert isinstance(mosaic.add(thermal[..., None], str(k)), Placement)
    colour, _ = mosaic.raster.part(RasterBox(0, 0, 480, 360))
    assert (colour[..., 0] == colour[..., 2]).all()
    assert colour.std() > 20

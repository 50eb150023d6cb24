"""Ground of a kind that was never found again is no witness; ground of which some was, is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.arrays import Bands, Mask
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.features.frame_cells import CELLS, COLUMNS, ROWS, cell_of
from gcs_mosaic.stitch.features.looks import looks
from gcs_mosaic.stitch.graph.silent_ground import (
    FROM_FRAMES,
    KEPT_PAIRS,
    full_cells,
    note_found_again,
    silent_cells,
    telling,
)
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.outcome import Registration

FRAMES = 6
LEFT = np.tile(np.arange(COLUMNS) < COLUMNS // 2, ROWS)  # cells of one kind; the others are of another


@pytest.fixture(scope="module")
def seen(ground: Image) -> Features:
    """A frame whose halves look unlike each other, with features everywhere."""
    found = extract(photograph(ground, Pose(700, 700), SMALL_CAMERA), FeatureSettings())
    assert full_cells(found).all()
    rng = np.random.default_rng(5)
    return replace(found, looks=(np.where(LEFT, 0.0, 9.0)[:, None] + rng.normal(0, 0.3, (CELLS, 4))).astype(np.float32))


@pytest.fixture
def graph(seen: Features) -> ViewGraph:
    graph = ViewGraph(SMALL_CAMERA.focal, 24)
    for number in range(FRAMES):
        graph.append(str(number), seen)
    return graph


def agreeing(seen: Features, cells: Mask) -> Registration:
    """Two frames of one place, of which one matches in these cells alone."""
    pixels = seen.points.astype(np.float64)
    chosen = np.flatnonzero(cells[cell_of(pixels, seen.width, seen.height)])
    pairs = np.stack([chosen, chosen], axis=1)
    return Registration(pixels[chosen], pixels[chosen], pairs, np.eye(3), len(chosen), 100.0)


def note(graph: ViewGraph, found: Registration, frames: int) -> None:
    for frame in range(frames):
        note_found_again(graph, frame, frame + 1, found)


def test_what_was_never_found_again_is_silent(graph: ViewGraph, seen: Features) -> None:
    note(graph, agreeing(seen, LEFT), FROM_FRAMES)
    assert (silent_cells(graph, seen, None) == ~LEFT).all()
    mask = telling(graph, seen, None)
    right = seen.points[:, 0] > seen.width / 2
    assert (mask == ~right).mean() > 0.99


def test_a_few_frames_are_too_few_to_tell(graph: ViewGraph, seen: Features) -> None:
    note(graph, agreeing(seen, LEFT), FROM_FRAMES - 1)
    assert not silent_cells(graph, seen, None).any()


def test_a_frame_is_no_witness_of_itself(graph: ViewGraph, seen: Features) -> None:
    note(graph, agreeing(seen, LEFT), FROM_FRAMES)
    assert not silent_cells(graph, seen, 0).any()


def test_what_one_pair_in_a_few_found_again_tells(graph: ViewGraph, seen: Features) -> None:
    """As lawns of which most lie at another hall of one make."""
    note(graph, agreeing(seen, LEFT), FROM_FRAMES)
    note_found_again(graph, FROM_FRAMES, FROM_FRAMES + 1, agreeing(seen, LEFT | True))
    assert not silent_cells(graph, seen, None).any()


def test_ground_of_no_known_kind_tells(graph: ViewGraph, seen: Features) -> None:
    note(graph, agreeing(seen, LEFT), FROM_FRAMES)
    assert seen.looks is not None
    assert not silent_cells(graph, replace(seen, looks=seen.looks + 100), None).any()


def test_a_camera_with_other_bands_is_not_judged_by_this_one(graph: ViewGraph, seen: Features) -> None:
    note(graph, agreeing(seen, LEFT), FROM_FRAMES)
    assert seen.looks is not None
    assert not silent_cells(graph, replace(seen, looks=seen.looks[:, :3]), None).any()
    assert not silent_cells(graph, replace(seen, looks=None), None).any()


def test_of_a_long_flight_the_latest_pairs_are_kept(graph: ViewGraph, seen: Features) -> None:
    found = agreeing(seen, LEFT)
    for other in range(KEPT_PAIRS + 3):
        graph.found_again |= {(0, -1 - other): (b"", b"")}
    note_found_again(graph, 1, 2, found)
    assert len(graph.found_again) == KEPT_PAIRS
    assert next(reversed(graph.found_again)) == (1, 2)


@pytest.mark.parametrize("shape", [(360, 480), (360, 480, 3), (360, 480, 10)], ids=["grey", "colour", "bands"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_looks_tell_colour_brightness_and_detail(shape: tuple[int, ...], kind: type) -> None:
    flat: Bands = np.full(shape, 90, kind)
    rough = flat.copy()
    rough[:, 240:] += np.random.default_rng(1).integers(0, 20, rough[:, 240:].shape).astype(kind)
    smooth, detailed = (
        looks(image, image.reshape(360, 480, -1).mean(axis=2).astype(np.float32)) for image in (flat, rough)
    )
    assert np.isfinite(detailed).all()
    assert np.ptp(smooth, axis=0).max() < 1e-3
    assert (detailed[LEFT][:, -2] < detailed[~LEFT][:, -2].min()).mean() > 0.7

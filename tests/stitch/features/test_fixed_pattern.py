"""What stands still in the picture is taken out of it, and nothing else."""

from collections.abc import Iterable, Iterator

import cv2
import faint_frames
import numpy as np
import pytest
from faint_frames import Levels, motion
from numpy.typing import NDArray
from stitch_ground import SMALL_CAMERA, Image, map_error, photograph

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features import fixed_pattern as still
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.features.fixed_pattern import StillPattern
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings
from gcs_mosaic.stitch.transaction import Numbers
from tests.sure import sure
from tests.tiers import thorough

SETTINGS = FeatureSettings()

Place = tuple[int, int]


def flown(places: Iterable[Place], pattern: Levels | float, contrast: float = 2.0) -> Iterator[Features]:
    """Features of frames at these places (x, y) of one ground, as they are taken in one after the other."""
    scene, still = faint_frames.scene(), StillPattern()
    for number, (x, y) in enumerate(places):
        image = faint_frames.frame(scene, x, y, number, contrast, pattern=pattern)
        yield still.without(extract(image, SETTINGS), SETTINGS)


def moving(count: int, step: int) -> list[Place]:
    return [(10 + step * k, 10 + step * k // 4) for k in range(count)]


@pytest.mark.long
@pytest.mark.parametrize("step", [thorough(6), 40])
def test_the_ground_is_matched_and_not_the_pattern(step: int) -> None:
    found = list(flown(moving(18, step), faint_frames.fixed_pattern(3.0)))
    apart = -(-30 // step)
    for a, b in zip(found[-3 - apart :], found[-3:], strict=False):
        assert motion(a, b) == pytest.approx([-step * apart, -step * apart / 4], abs=1.5)


def test_with_the_pattern_in_it_the_ground_is_lost() -> None:
    """What the test above would be without `StillPattern`."""
    scene, pattern = faint_frames.scene(), faint_frames.fixed_pattern(3.0)
    a, b = (extract(faint_frames.frame(scene, x, y, x, pattern=pattern), SETTINGS) for x, y in moving(18, 40)[-2:])
    found = motion(a, b)
    assert found is None or abs(found).max() < 5


@pytest.mark.long
@pytest.mark.parametrize("contrast", [thorough(1.5), 3.0])
def test_hovering_takes_nothing_away(contrast: float) -> None:
    found = list(flown([(300, 300)] * 30, 0.0, contrast))
    assert len(found[-1]) > 0.9 * len(found[0])
    assert motion(found[0], found[-1]) == pytest.approx([0, 0], abs=0.5)


def first_two(places: Iterable[Place]) -> tuple[Features, Features, NDArray[np.intp]]:
    """Two frames of a strong pattern, from before it is known, and matches (n, 2) of each feature with the nearest one."""
    a, b = list(flown(places, faint_frames.fixed_pattern(3.0)))
    return nearest_of(a, b)


def test_before_the_pattern_is_known_what_has_not_moved_is_the_pattern() -> None:
    a, b, nearest = first_two(moving(2, 40))
    moved = np.linalg.norm(a.points[nearest[:, 0]] / a.scale - b.points[nearest[:, 1]] / b.scale, axis=1)
    kept = still.moving(a, b, nearest)
    assert 0 < kept.sum() < len(kept)
    assert np.array_equal(kept, moved > still.STILL_PX)


def test_an_aircraft_that_hovers_keeps_its_matches() -> None:
    a, b, nearest = first_two([(300, 300)] * 2)
    assert still.moving(a, b, nearest).all()


def test_frames_with_enough_to_see_pass_untouched(ground: Image) -> None:
    features = extract(ground[:600, :800], SETTINGS)
    assert StillPattern().without(features, SETTINGS) is features


@pytest.mark.long
def test_the_same_frames_give_the_same_features() -> None:
    first, second = (list(flown(moving(12, 40), faint_frames.fixed_pattern(2.0))) for _ in range(2))
    assert all(np.array_equal(a.descriptors, b.descriptors) for a, b in zip(first, second, strict=True))


def test_what_is_kept_is_never_changed_in_place() -> None:
    """Whoever keeps a copy of its attributes can go back to it."""
    scene, still = faint_frames.scene(), StillPattern()
    frames = [extract(faint_frames.frame(scene, x, y, x), SETTINGS) for x, y in moving(9, 40)]
    for features in frames[:8]:
        still.without(features, SETTINGS)
    before = dict(vars(still))
    first = still.without(frames[8], SETTINGS)
    vars(still).update(before)
    assert np.array_equal(still.without(frames[8], SETTINGS).descriptors, first.descriptors)


def test_what_is_saved_of_the_pattern_comes_back_and_is_no_lasting_value() -> None:
    one, other = StillPattern(), StillPattern()
    for number, (x, y) in enumerate(moving(2, 40)):
        one.without(extract(faint_frames.frame(faint_frames.scene(), x, y, number, 2.0), SETTINGS), SETTINGS)
    saved = one.saved()
    assert all(isinstance(kept, Numbers) for name in ("_patterns", "_last") for kept in saved[name].values())
    other.load(saved)
    assert other._counts == one._counts != {}
    assert (other._grounds, other._still) == (one._grounds, one._still)
    for name in still._PICTURES:
        for kind, array in getattr(one, name).items():
            assert np.array_equal(getattr(other, name)[kind], array)


# Overlays: of frames with enough to see, and of faint ones.


def marked(image: Image, number: int) -> Image:
    """With a display burnt in whose digits change."""
    image = image.copy()
    for line, y in enumerate((40, 180, 340)):
        cv2.putText(image, f"ALT {10 + (number * 37 + line) % 90} M  HDG {number % 360:03}", (20, y), 0, 0.9, 255, 2)
    return image


def overflown(count: int, step: int) -> list[Pose]:
    return [Pose(400 + step * k, 500 + step * k // 4, 0.0, 0.03 * k) for k in range(count)]


@pytest.mark.long
def test_a_flight_under_a_display_is_placed_as_without_and_its_frames_are_told(ground: Image) -> None:
    mosaic, poses = Mosaic(), overflown(10, 120)
    for number, pose in enumerate(poses):
        mosaic.add(marked(photograph(ground, pose, SMALL_CAMERA), number), f"{number:03}")
        mosaic.adjust()
    mosaic.adjust(everything=True)
    placements = mosaic.placements()
    assert len(placements) == len(poses)
    assert map_error(placements, poses) < 2
    masks = [placement.still for placement in placements]
    assert None not in masks
    one = sure(masks[0])
    assert 0.01 < one.blocks.mean() < 0.4
    texture = sure(mosaic._graph.frames[0].features.texture)
    assert not texture[one.pixels(texture.shape[0], texture.shape[1])].any()


@pytest.mark.long
def test_hovering_is_no_overlay_and_keeps_its_matches(ground: Image) -> None:
    pattern, rng = StillPattern(), np.random.default_rng(0)
    here = photograph(ground, Pose(700, 700), SMALL_CAMERA)
    seen = [np.clip(here + rng.normal(0, 4, here.shape), 0, 255).astype(np.uint8) for _ in range(12)]
    found = [pattern.without(extract(image, SETTINGS), SETTINGS) for image in seen]
    assert all(one.still is None for one in found)
    a, b, nearest = nearest_of(found[0], found[-1])
    assert still.moving(a, b, nearest).all()


def test_what_has_not_moved_over_other_ground_is_dropped_before_anything_is_known(ground: Image) -> None:
    a, b = (
        extract(marked(photograph(ground, pose, SMALL_CAMERA), k), SETTINGS)
        for k, pose in enumerate((Pose(500, 500), Pose(1500, 1500)))
    )
    a, b, nearest = nearest_of(a, b)
    moved = np.linalg.norm(a.points[nearest[:, 0]] / a.scale - b.points[nearest[:, 1]] / b.scale, axis=1)
    assert np.array_equal(still.moving(a, b, nearest), moved > still.STILL_PX)


@pytest.mark.parametrize("yaw", [0.005, 0.05, 0.5])
def test_a_turn_about_the_middle_of_the_picture_is_registered(ground: Image, yaw: float) -> None:
    a, b = (extract(photograph(ground, Pose(700, 700, 0.0, turn), SMALL_CAMERA), SETTINGS) for turn in (0.0, yaw))
    found = register(a, b, RegistrationSettings())
    assert isinstance(found, Registration)
    assert found.independent_inliers > 100


@pytest.mark.parametrize("motion_px", [2, 5, 9])
def test_slow_flight_is_registered(ground: Image, motion_px: int) -> None:
    a, b = (extract(photograph(ground, Pose(700 + x, 700), SMALL_CAMERA), SETTINGS) for x in (0, motion_px))
    found = motion(a, b)
    assert found == pytest.approx([-motion_px, 0], abs=0.5)


def nearest_of(a: Features, b: Features) -> tuple[Features, Features, NDArray[np.intp]]:
    """Two frames, and matches (n, 2) of each feature with the one that is nearest in the picture."""
    apart = np.linalg.norm(a.points[:, None] / a.scale - b.points[None] / b.scale, axis=2)
    return a, b, np.stack([np.arange(len(a)), apart.argmin(axis=1)], axis=1)

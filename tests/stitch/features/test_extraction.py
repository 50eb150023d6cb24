"""Features are found where they are, in full-resolution pixels."""

import cv2
import numpy as np
from stitch_ground import Image

from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract, reduced_grey, without_border


def test_points_are_in_full_resolution_pixels() -> None:
    image = np.full((900, 1200), 100, np.uint8)
    cv2.circle(image, (801, 402), 40, 255, -1)
    features = extract(cv2.GaussianBlur(image, (0, 0), 12), FeatureSettings(megapixels=0.27))
    assert features.scale == 2
    assert np.linalg.norm(features.points - [801, 402], axis=1).min() < 1


def test_the_number_is_bounded_and_the_strongest_come_first(ground: Image) -> None:
    few, many = (extract(ground[:600, :800], FeatureSettings(count=n)) for n in (100, 800))
    assert len(few) == 100
    assert {tuple(p) for p in few.points} <= {tuple(p) for p in many.points[:160]}


def test_nothing_to_see_gives_no_features() -> None:
    assert len(extract(np.full((300, 400, 3), 128, np.uint8), FeatureSettings())) == 0


def test_colour_and_grey_give_the_same(ground: Image) -> None:
    grey = ground[:300, :400]
    colour = extract(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), FeatureSettings())
    assert np.array_equal(colour.points, extract(grey, FeatureSettings()).points)


def test_descriptors_have_length_255(ground: Image) -> None:
    descriptors = extract(ground[:300, :400], FeatureSettings()).descriptors.astype(float)
    assert np.allclose(np.linalg.norm(descriptors, axis=1), 255, atol=6)


def test_a_small_picture_is_never_enlarged(ground: Image) -> None:
    assert reduced_grey(ground[:100, :100], 0.75).shape == (100, 100)


def test_what_a_descriptor_takes_from_a_dead_border_is_gone(ground: Image) -> None:
    """What is left looks the same whether the border is black or not."""
    alive = ground[:600, :800].copy()
    black = alive.copy()
    dead = DeadBorder(right=2, bottom=20)
    black[-20:] = black[:, -2:] = 0
    plain, touched = (extract(image, FeatureSettings(megapixels=0.27, count=10_000)) for image in (alive, black))
    kept = without_border(touched, dead)
    assert 0.8 * len(touched) < len(kept) < len(touched)
    assert kept.points[:, 1].max() < 580
    assert len(kept.points) == len(kept.descriptors)
    same = {(*point, *words) for point, words in zip(plain.points.tolist(), plain.descriptors.tolist(), strict=True)}
    found = [
        (*point, *words) in same for point, words in zip(kept.points.tolist(), kept.descriptors.tolist(), strict=True)
    ]
    assert np.mean(found) > 0.97
    assert without_border(touched, NO_BORDER) is touched

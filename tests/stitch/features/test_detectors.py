"""Each kind of feature lies where it is, is described so that bytes compare, and is matched."""

import cv2
import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.detectors import FeatureKind, detect, is_available
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract
from gcs_mosaic.stitch.features.matching import match
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

KINDS = [
    "sift",
    "orb",
    pytest.param("surf", marks=pytest.mark.skipif(not is_available("surf"), reason="mahotas is not installed")),
]


@pytest.mark.parametrize("kind", KINDS)
def test_points_do_not_depend_on_the_heading(ground: Image, kind: FeatureKind) -> None:
    """Turned by half a circle, a picture has its features at the same places; a detector with an offset fails this."""
    picture = np.ascontiguousarray(cv2.GaussianBlur(ground[:600, :800], (0, 0), 1.5))
    a, b = (extract(p, FeatureSettings(kind=kind)) for p in (picture, np.ascontiguousarray(picture[::-1, ::-1])))
    pairs = match(a.descriptors, b.descriptors, 0.8)
    off = a.points[pairs[:, 0]] + b.points[pairs[:, 1]] - [799, 599]
    off = off[np.linalg.norm(off, axis=1) < 3]
    assert len(off) > 200
    middle = np.median if kind == "surf" else np.mean  # mahotas looks for large features on a coarse grid
    assert np.abs(middle(off, axis=0)).max() < 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_there_are_no_more_than_wanted(ground: Image, kind: FeatureKind) -> None:
    found = detect(ground[:600, :800], kind, 100, 0.01)
    assert 80 <= len(found.points) == len(found.descriptors) <= 100  # SURF leaves out those at the border


@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_of_nothing_has_none(kind: FeatureKind) -> None:
    found = detect(np.full((300, 400), 128, np.uint8), kind, 100, 0.01)
    assert len(found.points) == len(found.descriptors) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_descriptors_of_a_kind_have_one_length(ground: Image, kind: FeatureKind) -> None:
    descriptors = extract(ground[:400, :500], FeatureSettings(kind=kind)).descriptors
    length = np.linalg.norm(descriptors.astype(float), axis=1)
    assert descriptors.dtype.itemsize == 1
    assert length == pytest.approx(np.full(len(length), length[0]), rel=0.03)


def test_distances_of_orb_are_hamming_distances(ground: Image) -> None:
    bits = detect(ground[:400, :500], "orb", 50, 0.01).descriptors
    signs = extract(ground[:400, :500], FeatureSettings(kind="orb", count=50)).descriptors.astype(float)
    hamming = [[cv2.norm(a, b, cv2.NORM_HAMMING) for b in bits] for a in bits]
    assert np.allclose(((signs[:, None] - signs[None]) ** 2).sum(axis=-1) / 4, hamming)


@pytest.mark.parametrize("kind", KINDS)
def test_matches_are_true(ground: Image, kind: FeatureKind) -> None:
    a, b = (
        extract(photograph(ground, Pose(x, 800.0, 0.0, yaw), SMALL_CAMERA), FeatureSettings(kind=kind))
        for x, yaw in ((800.0, 0.0), (860.0, 0.4))
    )
    pairs = match(a.descriptors, b.descriptors, 0.85)
    centre, turn = SMALL_CAMERA.centre, np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    true = (a.points[pairs[:, 0]] - centre - [60, 0]) @ turn + centre
    good = np.linalg.norm(b.points[pairs[:, 1]] - true, axis=1) < 3
    assert good.sum() > 60
    assert good.mean() > 0.6


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_the_default_method_stitches_with_it(ground: Image, kind: FeatureKind) -> None:
    mosaic = Mosaic(StitchSettings(features=FeatureSettings(kind=kind)))
    poses = [Pose(500.0 + 110 * k, 700.0 + 30 * k, 0.02 * k, 0.15 * k) for k in range(6)]
    outcomes = [mosaic.add(photograph(ground, pose, SMALL_CAMERA), str(k)) for k, pose in enumerate(poses)]
    assert all(isinstance(one, Placement) for one in outcomes)

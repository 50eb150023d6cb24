"""A frame is placed beside another only by what proves that both show the same ground."""

from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract
from gcs_mosaic.stitch.graph.candidates import Search, SearchSettings
from gcs_mosaic.stitch.graph.view_graph import LENS_KNOWN, ViewGraph
from gcs_mosaic.stitch.mapping.resection import Disbelief, Placing, PlausibilitySettings
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

PLACES = [(300 + 80 * k, 300) for k in range(LENS_KNOWN)]
NEW, BESIDE = Pose(430, 360), 1
CLUMP = 45  # pixels around the middle one: matches on one thing tell the place of a frame, but not how it lies


@pytest.fixture
def search(ground: Image) -> Search:
    """A line of placed frames, and a new one beside it."""
    graph = ViewGraph(SMALL_CAMERA.focal, 24)
    graph.found_island()
    for name, pose in enumerate([*(Pose(*place) for place in PLACES), NEW]):
        graph.append(str(name), extract(photograph(ground, pose, SMALL_CAMERA), FeatureSettings()))
        if pose is not NEW:
            graph.put(name, pose, 0)
    return Search(graph, SearchSettings(), RegistrationSettings())


def with_the_rest_as_patches(found: Registration) -> Registration:
    """Only the matches in the middle come of keypoints."""
    away = np.abs(found.pixels_a - np.median(found.pixels_a, axis=0)).max(axis=1)
    order, clump = np.argsort(away, kind="stable"), np.count_nonzero(away < CLUMP)
    assert 8 <= clump < len(order) / 2
    return replace(
        found, pixels_a=found.pixels_a[order], pixels_b=found.pixels_b[order], features=found.features[order[:clump]]
    )


@pytest.mark.long
@pytest.mark.parametrize("beyond", [0.0, 5.0])
def test_patches_make_a_pose_certain_only_where_the_pixels_prove_it(search: Search, beyond: float) -> None:
    """Two halls of one make agree wherever one looks: patches drawn along a wrong registration must not bear it out."""
    placing = Placing(search._graph, search, PlausibilitySettings(), AdjustmentSettings())
    found = search.register(len(PLACES), BESIDE)
    assert found is not None
    told = replace(with_the_rest_as_patches(found), beyond=beyond)
    pose = placing.pose_beside(len(PLACES), BESIDE, told)
    if beyond:
        assert isinstance(pose, Pose)
        assert (pose.x, pose.y) == pytest.approx((NEW.x, NEW.y), abs=2)
    else:
        assert isinstance(pose, Disbelief)
        assert "a corner is only known" in pose.reason

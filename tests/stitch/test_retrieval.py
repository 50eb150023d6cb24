"""Frames that show the same ground come first, wherever they lie in the flight."""

import numpy as np
from stitch_ground import SMALL_CAMERA, photograph

from gcs_mosaic.stitch.features import FeatureSettings, extract
from gcs_mosaic.stitch.geometry import Pose
from gcs_mosaic.stitch.retrieval import RetrievalIndex


def test_the_frame_of_the_same_ground_is_found_among_many(ground):
    index, places = RetrievalIndex(), [Pose(x, y) for y in (300, 900, 1500, 2100) for x in (300, 1000, 1700)]
    for pose in places:
        index.add(extract(photograph(ground, pose, SMALL_CAMERA), FeatureSettings()))
    for number, pose in enumerate(places):
        again = extract(photograph(ground, Pose(pose.x + 90, pose.y - 70, 0.1, 1.0), SMALL_CAMERA), FeatureSettings())
        assert index.likeliest(again, np.arange(len(places)), 3)[0] == number


def test_only_the_frames_asked_for_are_looked_at(ground):
    index = RetrievalIndex()
    features = extract(photograph(ground, Pose(700, 700), SMALL_CAMERA), FeatureSettings())
    for _ in range(70):
        index.add(features)
    assert set(index.likeliest(features, np.array([5, 66]), 9)) == {5, 66}
    assert index.likeliest(features, np.array([], dtype=np.intp), 9) == []

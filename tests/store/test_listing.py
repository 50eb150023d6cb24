from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels
from gcs_mosaic.store.listing import FrameNews, Listing
from gcs_mosaic.store.records import CoveredRecord
from tests.store.ledger_parts import NEARLY_THE_SAME, an_estimate

ESTIMATE = replace(
    an_estimate(Pose(5, 6, 0.1, 2), residual_px=0.5, corner_deviation_px=1.5), camera=Camera(40, 30, 1.2)
)


def listed(*news: FrameNews) -> dict[str, Any]:
    """The document after so many tellings."""
    listing = Listing()
    for one in news:
        listing.tell(one)
    document: dict[str, Any] = json.loads(listing.text(7))
    return document


def test_the_document_follows_the_contract() -> None:
    document = listed(FrameNews(estimates=[ESTIMATE], newest="a.jpg"))
    assert (document["format"], document["revision"], document["newest"]) == (1, 7, "a.jpg")
    assert {"cameras", "frames", "covered", "rejected", "waiting"} < document.keys()


def test_placement_is_the_homography_of_the_estimate() -> None:
    (frame,) = listed(FrameNews(estimates=[ESTIMATE]))["frames"]
    corner = np.array(frame["canvas_from_frame"]) @ [39, 0, 1]
    expected = canvas_from_pixels(ESTIMATE.pose, ESTIMATE.camera, np.array([[39.0, 0.0]]))[0]
    assert corner[:2] / corner[2] == pytest.approx(expected)
    assert (frame["name"], frame["island"], frame["width"], frame["height"]) == ("a.jpg", 0, 40, 30)
    assert (frame["inliers"], frame["residual_px"]) == (9, 0.5)
    assert (frame["neighbours"], frame["hops"], frame["corner_deviation_px"]) == (2, 1, 1.5)
    assert frame["focal_log_deviation"] is None


def test_a_free_homography_is_told_as_it_is() -> None:
    (frame,) = listed(FrameNews(estimates=[replace(ESTIMATE, homography=NEARLY_THE_SAME)]))["frames"]
    assert np.array_equal(frame["canvas_from_frame"], NEARLY_THE_SAME)


def test_infinity_is_null() -> None:
    (frame,) = listed(FrameNews(estimates=[replace(ESTIMATE, residual_px=float("inf"))]))["frames"]
    assert frame["residual_px"] is None


def test_frames_refer_to_their_cameras() -> None:
    other = replace(ESTIMATE, name="b.jpg", camera=Camera(20, 10))
    third = replace(ESTIMATE, name="c.jpg")
    document = listed(FrameNews(estimates=[ESTIMATE, other]), FrameNews(estimates=[third]))
    assert [document["cameras"][frame["camera"]]["width"] for frame in document["frames"]] == [40, 20, 40]
    assert len(document["cameras"]) == 2


def test_a_covered_frame_follows_its_keyframe() -> None:
    covered = CoveredRecord(name="b.jpg", by="a.jpg", by_from_frame=NEARLY_THE_SAME, width=40, height=30)
    lost = replace(covered, name="c.jpg", by="gone.jpg")
    moved = replace(ESTIMATE, island=2, pose=Pose(500, -3, 0.2, 1.0))
    first = FrameNews(estimates=[ESTIMATE], covered=[covered, lost], newest="b.jpg")
    for keyframe, news in ((ESTIMATE, [first]), (moved, [first, FrameNews(estimates=[moved], newest="b.jpg")])):
        document = listed(*news)
        assert [frame["name"] for frame in document["frames"]] == ["a.jpg"]
        entry, alone = document["covered"]
        assert (entry["name"], entry["covered_by"], entry["island"]) == ("b.jpg", "a.jpg", keyframe.island)
        assert (entry["width"], entry["height"], document["newest"]) == (40, 30, "b.jpg")
        assert np.array_equal(entry["keyframe_from_frame"], NEARLY_THE_SAME)
        middle_in_key = np.array(NEARLY_THE_SAME) @ [20, 15, 1]
        place = np.array(entry["canvas_from_frame"]) @ [20, 15, 1]
        expected = canvas_from_pixels(keyframe.pose, keyframe.camera, middle_in_key[None, :2] / middle_in_key[2])
        assert np.allclose(place[:2] / place[2], expected[0])
        assert (alone["covered_by"], alone["island"], alone["canvas_from_frame"]) == ("gone.jpg", None, None)


def test_rejected_and_waiting_frames_are_named() -> None:
    document = listed(FrameNews(rejected={"r.jpg": "grey"}, waiting=["w.jpg"]))
    assert document["rejected"] == [{"name": "r.jpg", "reason": "grey"}]
    assert document["waiting"] == [{"name": "w.jpg"}]


def test_a_frame_is_in_one_list_and_keeps_its_turn() -> None:
    """A frame that waited stands, once placed, where it came in the flight."""
    last = replace(ESTIMATE, name="z.jpg")
    news = (
        FrameNews(waiting=["a.jpg", "w.jpg"]),
        FrameNews(estimates=[last, ESTIMATE]),
        FrameNews(rejected={"w.jpg": "grey"}),
    )
    document = listed(*news)
    assert [frame["name"] for frame in document["frames"]] == ["a.jpg", "z.jpg"]
    assert (document["waiting"], [frame["name"] for frame in document["rejected"]]) == ([], ["w.jpg"])


def test_text_of_some_frames_holds_only_those() -> None:
    listing = Listing()
    listing.tell(FrameNews(estimates=[replace(ESTIMATE, camera=Camera(20, 10))], waiting=["w.jpg"]))
    told = listing.tell(FrameNews(estimates=[replace(ESTIMATE, name="b.jpg")]))
    document = json.loads(listing.text(2, told))
    assert (document["frames"][0]["name"], document["frames"][0]["camera"], document["waiting"]) == ("b.jpg", 0, [])
    assert [camera["width"] for camera in document["cameras"]] == [40]

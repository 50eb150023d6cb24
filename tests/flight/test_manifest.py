from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ledger_parts import NEARLY_THE_SAME, a_frame

from gcs_mosaic.flight.disk import DiskFull
from gcs_mosaic.flight.ledger import Ledger
from gcs_mosaic.flight.manifest import Contents, IslandEntry, Manifest, mosaic_document, placements_document
from gcs_mosaic.flight.records import Accounts, CoveredRecord, Estimate, FrameAccount, FrameState
from gcs_mosaic.stitch.geometry import Camera, Pose, canvas_from_pixels
from gcs_mosaic.stitch.tearing import HeldOut

ISLAND = IslandEntry(id=0, bounds=(-10.5, 0, 4000, 3000.5), minzoom=11, maxzoom=16, frames=2)
ESTIMATE = Estimate(
    name="a.jpg",
    island=0,
    pose=Pose(5, 6, 0.1, 2),
    camera=Camera(40, 30, 1.2, 0),
    inliers=80,
    residual_px=0.5,
    neighbours=4,
    hops=2,
    corner_deviation_px=1.5,
)
CONTENTS = Contents(
    flight="today",
    updated_utc=1714564800.25,
    islands=[ISLAND],
    accounts=Accounts(frames=FrameAccount(placed=2)),
    estimates=[ESTIMATE],
    unplaced=[],
)


def test_mosaic_document_follows_the_contract() -> None:
    document = mosaic_document(CONTENTS, 7)
    assert (document["format"], document["revision"], document["tile_size"]) == (1, 7, 256)
    assert document["updated"] == "2024-05-01T12:00:00.250Z"
    assert document["islands"] == [
        {
            "id": 0,
            "bounds": [-10.5, 0.0, 4000.0, 3000.5],
            "minzoom": 11,
            "maxzoom": 16,
            "frames": 2,
            "held_out_px": None,
            "tiles": "tiles/0/{z}/{x}/{y}.jpg",
        }
    ]


def test_island_tells_how_good_it_is() -> None:
    known = replace(ISLAND, held_out=HeldOut(1.234, 9.876, 3120))
    endless = replace(ISLAND, held_out=HeldOut(1.5, math.inf, 20))
    document = json.loads(json.dumps(mosaic_document(replace(CONTENTS, islands=[known, endless]), 1), allow_nan=False))
    assert [island["held_out_px"] for island in document["islands"]] == [
        {"median": 1.23, "p95": 9.88, "matches": 3120},
        {"median": 1.5, "p95": None, "matches": 20},
    ]


def test_a_covered_frame_follows_its_keyframe() -> None:
    covered = CoveredRecord(name="b.jpg", by="a.jpg", by_from_frame=NEARLY_THE_SAME, width=40, height=30)
    lost = replace(covered, name="c.jpg", by="gone.jpg")
    moved = replace(ESTIMATE, island=2, pose=Pose(500, -3, 0.2, 1.0))
    for keyframe in (ESTIMATE, moved):
        contents = replace(CONTENTS, estimates=[keyframe], covered=[covered, lost], newest="b.jpg")
        document = json.loads(json.dumps(placements_document(contents, 1), allow_nan=False))
        assert [frame["name"] for frame in document["frames"]] == ["a.jpg"]
        entry, alone = document["covered"]
        assert (entry["name"], entry["covered_by"], entry["island"]) == ("b.jpg", "a.jpg", keyframe.island)
        assert (entry["width"], entry["height"], document["newest"]) == (40, 30, "b.jpg")
        middle_in_key = np.array(NEARLY_THE_SAME) @ [20, 15, 1]
        place = np.array(entry["canvas_from_frame"]) @ [20, 15, 1]
        expected = canvas_from_pixels(keyframe.pose, keyframe.camera, middle_in_key[None, :2] / middle_in_key[2])
        assert np.allclose(place[:2] / place[2], expected[0])
        assert (alone["covered_by"], alone["island"], alone["canvas_from_frame"]) == ("gone.jpg", None, None)


def test_merged_island_says_where_it_went() -> None:
    contents = replace(CONTENTS, islands=[ISLAND, replace(ISLAND, id=1, merged_into=0)])
    islands = mosaic_document(contents, 1)["islands"]
    assert isinstance(islands, list)
    assert [island.get("merged_into") for island in islands] == [None, 0]


def test_placement_is_the_homography_of_the_estimate() -> None:
    (frame,) = json.loads(json.dumps(placements_document(CONTENTS, 1)))["frames"]
    corner = np.array(frame["canvas_from_frame"]) @ [39, 0, 1]
    expected = canvas_from_pixels(ESTIMATE.pose, ESTIMATE.camera, np.array([[39.0, 0.0]]))[0]
    assert corner[:2] / corner[2] == pytest.approx(expected)
    assert (frame["width"], frame["height"], frame["inliers"], frame["residual_px"]) == (40, 30, 80, 0.5)
    assert (frame["neighbours"], frame["hops"], frame["corner_deviation_px"]) == (4, 2, 1.5)


def test_frames_refer_to_their_cameras() -> None:
    other = replace(ESTIMATE, name="b.jpg", camera=Camera(20, 10))
    third = replace(ESTIMATE, name="c.jpg")
    document = json.loads(json.dumps(placements_document(replace(CONTENTS, estimates=[ESTIMATE, other, third]), 1)))
    assert [document["cameras"][frame["camera"]]["width"] for frame in document["frames"]] == [40, 20, 40]


def test_rejected_and_waiting_frames_are_named(ledger: Ledger) -> None:
    for name in ("w.jpg", "r.jpg", "p.jpg"):
        ledger.record_frame(a_frame(name))
    ledger.settle_frame("w.jpg", FrameState.WAITING)
    ledger.settle_frame("r.jpg", FrameState.REJECTED, "grey")
    document = placements_document(replace(CONTENTS, unplaced=ledger.frames()), 1)
    assert document["rejected"] == [{"name": "r.jpg", "reason": "grey"}]
    assert document["waiting"] == [{"name": "w.jpg"}]


def test_infinity_never_reaches_a_file(tmp_path: Path) -> None:
    bad = replace(CONTENTS, estimates=[replace(ESTIMATE, residual_px=float("inf"))])
    Manifest(tmp_path).write(bad)
    assert json.loads((tmp_path / "placements.json").read_text())["frames"][0]["residual_px"] is None
    worse = replace(CONTENTS, islands=[replace(ISLAND, bounds=(0, 0, float("nan"), 1))])
    with pytest.raises(ValueError, match="not JSON compliant"):
        Manifest(tmp_path).write(worse)
    assert json.loads((tmp_path / "mosaic.json").read_text())["revision"] == 1


def test_revision_rises_over_restarts_and_garbage(tmp_path: Path) -> None:
    manifest = Manifest(tmp_path)
    assert [manifest.write(CONTENTS), manifest.write(CONTENTS)] == [1, 2]
    assert Manifest(tmp_path).write(CONTENTS) == 3
    (tmp_path / "mosaic.json").write_text("[")
    assert Manifest(tmp_path).revision == 0


def test_full_disk_keeps_the_old_revision(tiny_disk: Path) -> None:
    manifest = Manifest(tiny_disk)
    manifest.write(CONTENTS)
    many = [replace(ESTIMATE, name=f"{n}.jpg") for n in range(10_000)]
    with pytest.raises(DiskFull):
        manifest.write(replace(CONTENTS, estimates=many))
    assert manifest.revision == 1
    assert json.loads((tiny_disk / "mosaic.json").read_text())["revision"] == 1
    assert json.loads((tiny_disk / "placements.json").read_text())["revision"] == 1

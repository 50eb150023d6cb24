from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.disk import DiskFull
from gcs_mosaic.store.documents import compact
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.manifest import Contents, IslandEntry, Manifest, mosaic_document
from gcs_mosaic.store.records import Accounts, Estimate
from gcs_mosaic.store.told_documents import FrameAccount, MosaicDocument
from tests.documents import document_at, journal_lines, misfits, placements

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
    frames=FrameNews(estimates=[ESTIMATE]),
)


def told(contents: Contents, revision: int) -> dict[str, Any]:
    """The document, as a reader has it."""
    document: dict[str, Any] = json.loads(compact(mosaic_document(contents, revision)))
    assert misfits(MosaicDocument, document) == []
    return document


def test_mosaic_document_follows_the_contract() -> None:
    document = told(CONTENTS, 7)
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
    document = told(replace(CONTENTS, islands=[known, endless]), 1)
    assert [island["held_out_px"] for island in document["islands"]] == [
        {"median": 1.23, "p95": 9.88, "matches": 3120},
        {"median": 1.5, "p95": None, "matches": 20},
    ]


def test_merged_island_says_where_it_went() -> None:
    contents = replace(CONTENTS, islands=[ISLAND, replace(ISLAND, id=1, merged_into=0)])
    islands = told(contents, 1)["islands"]
    assert [island.get("merged_into") for island in islands] == [None, 0]


def test_infinity_never_reaches_a_file(tmp_path: Path) -> None:
    Manifest(tmp_path).write(CONTENTS)
    worse = replace(CONTENTS, islands=[replace(ISLAND, bounds=(0, 0, float("nan"), 1))])
    with pytest.raises(ValueError, match="not JSON compliant"):
        Manifest(tmp_path).write(worse)
    assert document_at(tmp_path / "mosaic.json")["revision"] == 1


def test_revision_rises_over_restarts_and_garbage(tmp_path: Path) -> None:
    manifest = Manifest(tmp_path)
    assert [manifest.write(CONTENTS), manifest.write(CONTENTS)] == [1, 2]
    assert Manifest(tmp_path).write(CONTENTS) == 3
    (tmp_path / "mosaic.json").write_text("[")
    assert Manifest(tmp_path).revision == 0


@pytest.mark.long
def test_full_disk_keeps_the_old_revision(tiny_disk: Path) -> None:
    manifest = Manifest(tiny_disk)
    manifest.write(CONTENTS)
    many = FrameNews(estimates=[replace(ESTIMATE, name=f"{n}.jpg") for n in range(10_000)])
    for everything in (True, False):
        with pytest.raises(DiskFull):
            manifest.write(replace(CONTENTS, frames=many), everything=everything)
        assert manifest.revision == 1
        assert document_at(tiny_disk / "mosaic.json")["revision"] == 1
        assert placements(tiny_disk)["revision"] == 1
        assert len(journal_lines(tiny_disk)) == 2
        assert (tiny_disk / "placements.jsonl").read_bytes().endswith(b"\n"), "half a line was taken back"


def test_a_number_that_a_reader_may_have_seen_is_not_given_again(tmp_path: Path) -> None:
    """A writing that fails between the journal and mosaic.json is told once more, under a new number."""
    manifest = Manifest(tmp_path)
    manifest.write(CONTENTS)
    with pytest.raises(ValueError, match="not JSON compliant"):
        manifest.write(replace(CONTENTS, updated_utc=1.0, islands=[replace(ISLAND, bounds=(0, 0, float("nan"), 1))]))
    assert manifest.write(replace(CONTENTS, frames=FrameNews(waiting=["a.jpg"]))) == 3
    assert [json.loads(line)["revision"] for line in journal_lines(tmp_path)[1:]] == [1, 2, 3]
    assert placements(tmp_path)["waiting"] == [{"name": "a.jpg"}]

"""At every revision the ledger, the documents, the tiles and the mosaic tell one story: with islands, a join and two cameras."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, photograph, textured_ground

from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, prepare
from gcs_mosaic.messages import Frame
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store import placements
from gcs_mosaic.store.flight_store import StoreHooks, estimate_of_placement
from gcs_mosaic.store.tiles import TileSettings, TileWriter
from tests import documents
from tests.documents import document_at
from tests.frame_files import written
from tests.settings import FEW_FEATURES

pytestmark = pytest.mark.long


OTHER_CAMERA = Camera(420, 320, 1.3, 0.0)
# Two lines of either camera, apart from each other until the last frames close the gap.
FLIGHT = [
    *((SMALL_CAMERA, 300 + 110 * i) for i in range(3)),
    *((OTHER_CAMERA, 360 + 110 * i) for i in range(2)),
    *((SMALL_CAMERA, 1000 + 110 * i) for i in range(3)),
    *((OTHER_CAMERA, 1060 + 110 * i) for i in range(2)),
    *((SMALL_CAMERA, 640 + 110 * i) for i in range(3)),
]


@pytest.fixture
def flight(tmp_path: Path) -> list[Frame]:
    ground = np.dstack([textured_ground(1700, 1)] * 3)
    frames = []
    for k, (camera, x) in enumerate(FLIGHT):
        picture = photograph(ground, Pose(x, 600, 0.02 * (k % 3), 0.02 * k), camera)
        frames.append(written(tmp_path / f"{k:02}.png", picture))
    return frames


def assert_one_story(pipeline: Pipeline) -> None:
    """Every placement, as the mosaic knows it now, is what the ledger and the documents say to the last digit."""
    placements, recorder = pipeline.mosaic.placements(), pipeline.store
    estimates = {estimate.name: estimate for estimate in recorder.ledger.estimates()}
    assert list(estimates) == [placement.name for placement in placements]
    for placement in placements:
        expected, told = estimate_of_placement(placement), estimates[placement.name]
        assert (told.island, told.pose, told.camera) == (expected.island, expected.pose, expected.camera)
        assert told.relief == expected.relief
    document = documents.placements(recorder.out)
    assert document["revision"] == recorder.revision
    for entry, placement in zip(document["frames"], placements, strict=True):
        assert (entry["name"], entry["island"]) == (placement.name, placement.island)
        assert np.allclose(entry["canvas_from_frame"], placement.canvas_from_frame, rtol=1e-6, atol=1e-6)
    counts = {island["id"]: island["frames"] for island in document_at(recorder.out / "mosaic.json")["islands"]}
    known = pipeline.mosaic.frame_counts()
    assert {island: count for island, count in counts.items() if count} == known


def assert_tiles_show_the_ledger(pipeline: Pipeline, images: dict[str, np.ndarray], scratch: Path) -> None:
    """What is painted anew from what the ledger says is byte for byte what lies on the disk."""
    ledger, out = pipeline.store.ledger, pipeline.store.out
    painted = sorted(
        (one for island in ledger.islands() for one in ledger.painted(island.id)), key=lambda one: one.order
    )
    scratch.mkdir()
    with TileCompositor(images.get) as canvas, closing(TileWriter(scratch, TileSettings())) as writer:
        for one in painted:
            writer.write(canvas.paint(images[one.name], one), canvas.tile_later)
    for kind in ("tiles", "masks"):
        here, there = ({p.relative_to(r): p.read_bytes() for p in (r / kind).rglob("*.*")} for r in (out, scratch))
        assert len(there) >= len(painted)
        assert here == there


def test_ledger_documents_tiles_and_mosaic_agree_at_every_revision(
    flight: list[Frame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(placements, "WHOLE_EACH_S", 60.0)  # so that the journal has its part, however slow this is
    out = tmp_path / "out"
    out.mkdir()
    pipeline = Pipeline(out, FEW_FEATURES, lambda notice: None, StoreHooks(utc=lambda: 0.0), punctual=True)
    islands, images, listed_late = set(), {}, 0
    try:
        for frame in flight:
            pipeline.accept(frame)
            prepared = prepare(frame, pipeline.features_of)
            assert isinstance(prepared, DecodedFrame)
            images[frame.name] = prepared.image
            pipeline.process(prepared)
            pipeline.save()
            assert_one_story(pipeline)
            while pipeline.repaint_some():
                pass
            pipeline.save()
            assert_one_story(pipeline)
            assert_tiles_show_the_ledger(pipeline, images, tmp_path / f"anew-{frame.name}")
            listed_late += document_at(out / "placements.json")["revision"] < pipeline.store.revision
            islands.add(tuple(sorted(pipeline.mosaic.frame_counts().values())))
        for _ in pipeline.finish():
            pipeline.save()
        pipeline.save()
        assert_one_story(pipeline)
        assert document_at(out / "placements.json")["revision"] == pipeline.store.revision
        assert listed_late, "some revisions are told by the journal alone"
        assert_tiles_show_the_ledger(pipeline, images, tmp_path / "anew")
        assert len(pipeline.mosaic.placements()) == len(flight)
        assert list(pipeline.mosaic.frame_counts().values()) == [len(flight)]
        assert any(len(counts) > 1 for counts in islands)  # there were two before they were joined
        assert {(p.camera.width, p.camera.height) for p in pipeline.mosaic.placements()} == {(480, 360), (420, 320)}
    finally:
        pipeline.close()

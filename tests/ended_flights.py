"""The folder of a flight that has ended, as the live program leaves it."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.status import Status, status_document
from tests.running import six_pictures
from tests.sure import sure


def photographed(folder: Path, world_cache: Path) -> Path:
    """The folder with six pictures that overlap, as the camera has written them."""
    for number, data in enumerate(six_pictures(world_cache, size=(480, 360))):
        (folder / f"{number}.jpg").write_bytes(data)
    return folder


def ended_flight(out: Path, pictures: Path) -> Path:
    """The folder `out`, which is made, with a flight of these pictures; all of them are placed."""
    config = Config()
    out.mkdir()
    with closing(Pipeline(out, config, lambda notice: None, checkpoints=checkpoints_of(out, config))) as flight:
        for frame in (sure(flight.accept(item)) for item in frames_in(pictures).frames if isinstance(item, Frame)):
            Driver(flight).process(prepare(frame, flight.features_of, config.reduction, flight.feature_pixels))
        for _ in Driver(flight).finish():
            pass
        flight.checkpoint(at_once=True)
        accounts, revision = flight.accounts(), flight.store.revision
    assert accounts.frames.placed == len(list(pictures.iterdir()))
    status = Status(
        flight=out.name, state="stopped", updated_utc=2.0, started_utc=1.0, revision=revision, accounts=accounts
    )
    write_json(out / "status.json", status_document(status))
    return out

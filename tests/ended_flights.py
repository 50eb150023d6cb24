"""The folder of a flight that has ended, as the live program leaves it."""

from __future__ import annotations

import fcntl
import shutil
from collections.abc import Callable
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
    return shutil.copytree(_once(world_cache / "six-pictures", _photograph), folder, dirs_exist_ok=True)


def ended_flight(out: Path, world_cache: Path) -> Path:
    """The folder `out`, which is made, with a flight of those six pictures; all of them are placed."""
    pictures = _once(world_cache / "six-pictures", _photograph)
    return shutil.copytree(_once(world_cache / "ended", lambda home: _fly(home / "flight", pictures)) / "flight", out)


def _once(folder: Path, make: Callable[[Path], None]) -> Path:
    """A folder that the first of the tests' processes to need it makes, while the others wait; who changes it takes a copy."""
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            unfinished = folder.with_suffix(".part")
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            make(unfinished)
            unfinished.rename(folder)
    return folder


def _photograph(folder: Path) -> None:
    for number, data in enumerate(six_pictures(folder.parent, size=(480, 360))):
        (folder / f"{number}.jpg").write_bytes(data)


def _fly(out: Path, pictures: Path) -> None:
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

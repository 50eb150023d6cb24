"""A flight whose output folder is lost: all of it is on the disk again, and the map is as if nothing had been."""

from __future__ import annotations

import logging
import math
import shutil
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, photograph, textured_ground

from gcs_mosaic.app.live.output import OutputFolder
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of, saved_flight
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, UndecodableFrame
from gcs_mosaic.app.waiting.unread import AGAIN_S, MOST_TRIES, UnreadFrames
from gcs_mosaic.messages import Notice
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.checkpoint import Unusable
from gcs_mosaic.store.flight_store import StoreHooks
from gcs_mosaic.store.folder import LEDGER_NAME, open_flight_folder
from gcs_mosaic.store.log import LogFile, LogSettings
from gcs_mosaic.store.originals import is_intact
from tests.documents import placements
from tests.factories import frame
from tests.frame_files import decoded
from tests.rebuilt import assert_explained
from tests.settings import FEW_FEATURES
from tests.sure import sure

CONFIG = FEW_FEATURES


@pytest.fixture(scope="module")
def coming(tmp_path_factory: pytest.TempPathFactory) -> list[DecodedFrame]:
    """Four frames in a row, in a watched folder."""
    folder, ground = tmp_path_factory.mktemp("frames"), np.dstack([textured_ground(1500, 1)] * 3)
    return [
        decoded(folder / f"{k}.png", photograph(ground, Pose(300 + 110 * k, 600, 0.0, 0.02 * k), SMALL_CAMERA))
        for k in range(4)
    ]


@pytest.mark.long
def test_everything_is_written_again_after_the_folder_was_deleted(coming: list[DecodedFrame], tmp_path: Path) -> None:
    watched, said = coming[0].frame.path.parent, list[Notice]()
    with closing(open_flight_folder(tmp_path / "out")) as folder:
        pipeline = Pipeline(
            *(folder.path, CONFIG, said.append),
            StoreHooks(elsewhere=lambda name: watched / name),
            checkpoints=checkpoints_of(folder.path, CONFIG),
        )
        with closing(pipeline), closing(OutputFolder(folder, CONFIG, pipeline, lambda: None, said.append)) as output:
            fly(pipeline, coming[:2])
            pipeline.accept(coming[2].frame)  # and is not processed yet
            tiles = tiles_of(folder.path)
            shutil.rmtree(folder.path)
            assert output.ensure()
            assert not output.ensure()
            assert is_intact(folder.path / "frames/2.png", coming[2].frame.content_hash), "needed at once"
            pipeline.save()
            assert tiles_of(folder.path) == tiles
            fly(pipeline, coming[3:])
            while pipeline.store.seeks_originals(0.0):
                pipeline.store.keep_lost(0.0)
            pipeline.process(coming[2])
            pipeline.save()
            for _ in pipeline.finish():
                pipeline.save()
            pipeline.checkpoint(at_once=True)
    assert [notice.text for notice in said] == [
        f"{folder.path}: the folder was deleted; everything is written anew from memory; 3 originals are gone, and sought "
        "in frames"
    ]
    assert len(placements(folder.path)["frames"]) == 4
    assert_explained(folder.path, tmp_path / "rebuilt", fewest=5)
    checkpoints = sure(checkpoints_of(folder.path, CONFIG))
    assert not isinstance(saved_flight(checkpoints, CONFIG), Unusable)
    checkpoints.close()


def test_what_is_deleted_after_it_was_written_anew_is_written_once_more(
    coming: list[DecodedFrame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`rm -r` takes the ledger first, and may take what we write into the folder meanwhile."""
    monkeypatch.setattr("gcs_mosaic.app.live.output.SETTLES_S", 0.0)
    log = LogFile(tmp_path / "out/flight.log", LogSettings(), lambda why: None)
    with closing(open_flight_folder(tmp_path / "out")) as folder, closing(log):
        pipeline = Pipeline(folder.path, CONFIG, lambda notice: None)
        with (
            closing(pipeline),
            closing(OutputFolder(folder, CONFIG, pipeline, log.reopen, lambda notice: None)) as output,
        ):
            log.emit(logging.makeLogRecord({"msg": "before"}))
            fly(pipeline, coming[:2])
            tiles = tiles_of(folder.path)
            (folder.path / LEDGER_NAME).unlink()
            assert output.ensure()
            pipeline.save()
            (folder.path / "flight.log").unlink()
            shutil.rmtree(folder.path / "tiles")
            assert not output.ensure()
            pipeline.save()
            assert tiles_of(folder.path) == tiles
            assert not output.ensure()
            log.emit(logging.makeLogRecord({"msg": "after"}))
    lines = (tmp_path / "out/flight.log").read_text().splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["before", "after"]


def tiles_of(out: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for kind in ("tiles", "masks") for path in (out / kind).rglob("*.*")}


def fly(pipeline: Pipeline, frames: list[DecodedFrame]) -> None:
    for one in frames:
        pipeline.accept(one.frame)
        pipeline.process(one)
        pipeline.save()
        pipeline.checkpoint(at_once=True)


def test_accounts_are_told_before_the_frame_is_processed(coming: list[DecodedFrame], tmp_path: Path) -> None:
    with closing(Pipeline(tmp_path, CONFIG, lambda notice: None)) as pipeline:
        pipeline.save()
        revision = pipeline.store.revision
        pipeline.accept(coming[0].frame)
        assert '"pending":0' in (tmp_path / "mosaic.json").read_text()
        pipeline.store.tell_accounts()
        assert '"frames":{"pending":1' in (tmp_path / "mosaic.json").read_text()
        assert pipeline.store.revision == revision


def test_the_log_goes_on_with_what_was_in_it(tmp_path: Path) -> None:
    log = LogFile(tmp_path / "out.log", LogSettings(), lambda why: None)
    with closing(log):
        log.emit(logging.makeLogRecord({"msg": "before"}))
        (tmp_path / "out.log").unlink()
        log.emit(logging.makeLogRecord({"msg": "meanwhile"}))
        log.reopen()
        log.emit(logging.makeLogRecord({"msg": "after"}))
    lines = (tmp_path / "out.log").read_text().splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["before", "meanwhile", "after"]


def test_a_frame_that_cannot_be_read_waits_until_it_can(tmp_path: Path) -> None:
    there = list[bool]()
    unread = UnreadFrames(lambda frame: frame if there else None)
    one, no_picture = frame("a.jpg"), frame("b.jpg")
    assert unread.add(UndecodableFrame(one, "cannot be read (Input/output error)"), 0.0)
    assert not unread.add(UndecodableFrame(no_picture, "truncated"), 0.0)
    assert list(unread.readable(AGAIN_S)) == []
    there.append(True)
    assert list(unread.readable(AGAIN_S + 1)) == []
    assert list(unread.readable(2 * AGAIN_S)) == [one]
    assert len(unread) == 0
    assert unread.add(UndecodableFrame(one, "cannot be read (Input/output error)"), 9.0)
    assert [failed.frame for failed in unread.rest()] == [one]
    assert len(unread) == 0


def test_a_frame_whose_process_was_ended_is_tried_again_some_times() -> None:
    """It may be innocent; or what brings the machine down."""
    unread, one = UnreadFrames(lambda frame: frame), frame("a.jpg")
    failed = UndecodableFrame(one, "could not be decoded: the process for it was ended twice (SIGKILL)")
    tries = 0
    while unread.add(failed, 10.0 * tries):
        tries += 1
        assert list(unread.readable(10.0 * tries)) == [one]
    assert tries == MOST_TRIES


def test_a_frame_is_found_where_it_came_from(coming: list[DecodedFrame], tmp_path: Path) -> None:
    """Its original is gone with the folder; the file in the watched folder is as it was."""
    watched = coming[0].frame.path.parent
    around = StoreHooks(elsewhere=lambda name: watched / name)
    with closing(Pipeline(tmp_path, CONFIG, lambda notice: None, around)) as pipeline:
        kept = sure(pipeline.accept(coming[0].frame))
        assert pipeline.store.found_again(kept) == kept
        kept.path.unlink()
        assert sure(pipeline.store.found_again(kept)).path == coming[0].frame.path
        assert pipeline.store.found_again(replace(kept, content_hash="another")) is None


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell")
def test_closed_standard_streams_change_no_exit_code(tmp_path: Path) -> None:
    """What is opened later never takes their numbers: it would be printed into."""
    code = (
        "import os, sys, gcs_mosaic.__main__ as program; "
        "file = None; code = program.main(); file = os.open('later', os.O_CREAT | os.O_WRONLY); "
        "sys.exit(code if file > 2 else 9)"
    )
    program = f"""exec "{sys.executable}" -c "{code}" config >&- 2>&- <&-"""
    root = Path(__file__).parents[3]
    done = subprocess.run(["sh", "-c", program], cwd=tmp_path, env={"PYTHONPATH": str(root)}, timeout=60, check=False)
    assert done.returncode == 0


@pytest.mark.long
def test_what_was_not_kept_is_found_by_the_end_and_its_tiles_are_painted(
    coming: list[DecodedFrame], tmp_path: Path
) -> None:
    """The folder was deleted under a backlog while the camera's card was out: one original was never taken back, nothing was said
    of it, and three tiles stayed stale."""
    watched = coming[0].frame.path.parent
    there = tmp_path / "away"
    with closing(open_flight_folder(tmp_path / "out")) as folder:
        pipeline = Pipeline(folder.path, CONFIG, lambda notice: None, StoreHooks(elsewhere=lambda name: there / name))
        with (
            closing(pipeline),
            closing(OutputFolder(folder, CONFIG, pipeline, lambda: None, lambda notice: None)) as output,
        ):
            fly(pipeline, coming)
            shutil.rmtree(folder.path)
            assert output.ensure()
            assert pipeline.load_original("1.png") is None
            pipeline.keep_lost_originals(math.inf)
            assert len(pipeline.store.not_kept()) == len(coming)
            canvas = pipeline._renderer.canvas
            assert isinstance(canvas, TileCompositor)
            canvas.gone.update(["1.png"])  # a repaint has been given up meanwhile
            there = watched
            assert pipeline.load_original("1.png") is not None, "from where the camera has it"
            assert not pipeline.store.seeks_originals(time.monotonic()), "it has just been tried in vain"
            pipeline.store.seek_originals_now()
            pipeline.keep_lost_originals(0.0)
            assert len(pipeline.store.not_kept()) == len(coming) - 1, "one at a time while frames wait"
            pipeline.keep_lost_originals(math.inf)
            assert pipeline.store.not_kept() == []
            assert canvas.gone == set()
            assert canvas.behind > 0
            pipeline.save()
            for _ in pipeline.finish():
                pipeline.save()
    assert_explained(folder.path, tmp_path / "rebuilt", fewest=4)

"""What a camera's frames share is not taken for another camera's, though its frames are of one size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gcs_mosaic.archive.arrivals import ArchiveFrame
from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.cameras import by_camera
from gcs_mosaic.archive.features import FrameFacts, SeenFrame
from gcs_mosaic.archive.files import FolderFiles
from gcs_mosaic.archive.frame_kinds import FrameKind, kinds_of
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.tasks import StageTask
from gcs_mosaic.config.tree import Config
from gcs_mosaic.messages import content_hash
from gcs_mosaic.stitch.camera.dead_border import FRAMES, NO_BORDER

WIDTH, HEIGHT = 320, 240
LINES = 8  # black ones at the top of the barred camera's frames


class HereAndNow:
    """An engine that runs tasks at once, in this process."""

    def __init__(self, folder: Path) -> None:
        self._artefacts = Artefacts(FolderFiles(folder))

    def made(self, stage: str, tasks: Sequence[StageTask], batch: int = 1) -> list[Any]:
        return [one.work(self._artefacts, *one.arguments, *one.hints)["summary"] for one in tasks]


def taken(path: Path, number: int, *, barred: bool) -> SeenFrame:
    """A frame of changing ground, written to a file."""
    image = np.random.default_rng(number).integers(60, 250, (HEIGHT // 8, WIDTH // 8, 3)).astype(np.uint8)
    image = np.repeat(np.repeat(image, 8, axis=0), 8, axis=1)
    image[: LINES if barred else 0] = 0
    data = cv2.imencode(".png", image)[1].tobytes()
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    file = SourceFile(path.name, "", str(path), len(data), path.stat().st_mtime_ns)
    frame = ArchiveFrame(number, f"{path.parent.name}/{path.name}", content_hash(data), file, (WIDTH, HEIGHT))
    facts = FrameFacts((WIDTH, HEIGHT), (WIDTH, HEIGHT), 3, "uint8", 100, 1.0, 1.0, faint=False)
    return SeenFrame(frame, f"features/{number}", facts)


def kinds(folder: Path, frames: Sequence[SeenFrame]) -> list[FrameKind]:
    return kinds_of(HereAndNow(folder), frames, Config())  # type: ignore[arg-type]


@pytest.fixture
def of_two(tmp_path: Path) -> list[SeenFrame]:
    """Frames of two cameras by turns, of which the first has a bar at the top."""
    folders = tmp_path / "barred", tmp_path / "other"
    return [
        taken(folders[number % 2] / f"{number:02}.png", number, barred=number % 2 == 0) for number in range(2 * FRAMES)
    ]


def test_a_bar_is_left_out_where_it_is_alone(tmp_path: Path, of_two: list[SeenFrame]) -> None:
    found = [kind.dead for kind in kinds(tmp_path, of_two)]
    assert found[1::2] == [NO_BORDER] * FRAMES
    assert {(dead.left, dead.right, dead.bottom) for dead in found[::2]} == {(0, 0, 0)}
    assert {LINES <= dead.top <= LINES + 2 for dead in found[::2]} == {True}


def test_a_card_s_many_small_folders_are_told_together(tmp_path: Path) -> None:
    frames = [taken(tmp_path / f"{number // 2}" / f"{number}.png", number, barred=True) for number in range(FRAMES)]
    assert {kind.dead.top >= LINES for kind in kinds(tmp_path, frames)} == {True}


def test_all_are_shown_alike(tmp_path: Path, of_two: list[SeenFrame]) -> None:
    assert len({kind.display for kind in kinds(tmp_path, of_two)}) == 1


def test_cameras_are_told_by_folder_and_size(of_two: list[SeenFrame]) -> None:
    assert len(set(by_camera(of_two, FRAMES))) == 2
    assert len(set(by_camera(of_two, FRAMES + 1))) == 1

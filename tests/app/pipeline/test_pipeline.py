"""A folder of frames through the whole pipeline: accounts that close, tiles that the ledger alone explains."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console
from stitch_ground import SMALL_CAMERA, photograph

import sitl.flight
from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.config.tree import Config
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings
from gcs_mosaic.stitch.graph.placement import Outcome
from gcs_mosaic.stitch.mapping.second_look import SecondLookSettings
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from sitl.path import Plan
from tests.rebuilt import assert_explained, painted_of
from tests.settings import FEW_FEATURES
from tests.sure import sure

pytestmark = pytest.mark.long

QUIET = Console(quiet=True)


@pytest.fixture(scope="module")
def stitched(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """A small flight that was stitched, by a camera with two dead lines, with strangers among its frames."""
    folder = tmp_path_factory.mktemp("frames")
    sitl.flight.make("survey", folder, (640, 480), cache=world_cache, route=Plan(frames=12))
    for path in folder.rglob("*.JPG"):
        image = sure(cv2.imread(str(path)))
        image[-1:] = image[:, -1:] = 0
        cv2.imwrite(str(path), image)
    cv2.imwrite(str(folder / "DCIM" / "black.png"), np.zeros((480, 640, 3), np.uint8))
    (folder / "DCIM" / "cut.jpg").write_bytes(next(folder.rglob("*.JPG")).read_bytes()[:9000])
    (folder / "DCIM" / "copy.jpg").write_bytes(next(folder.rglob("*1.JPG")).read_bytes())
    return stitch([folder], tmp_path_factory.mktemp("out") / "flight", FEW_FEATURES, QUIET)


def test_every_frame_is_accounted_for(stitched: Path) -> None:
    with Ledger(stitched / LEDGER_NAME, read_only=True) as ledger:
        frames = ledger.accounts().frames
        reasons = {frame.name: frame.reason for frame in ledger.frames() if frame.reason}
    assert (frames.placed, frames.rejected, frames.duplicate, frames.damaged) == (12, 1, 1, 1)
    assert (frames.pending, frames.waiting, frames.dropped) == (0, 0, 0)
    assert "too little to see" in reasons["DCIM/black.png"]
    assert "the same picture as" in reasons["DCIM/copy.jpg"]


def test_the_originals_are_kept_as_they_came(stitched: Path) -> None:
    with Ledger(stitched / LEDGER_NAME, read_only=True) as ledger:
        kept = [frame for frame in ledger.frames() if frame.original]
    assert len(kept) == 14  # the copy is not; the one that was cut is, for decoding alone tells
    assert all((stitched / sure(frame.original)).stat().st_size == frame.size for frame in kept)


def test_tiles_are_a_function_of_the_ledger_and_the_originals(stitched: Path, tmp_path: Path) -> None:
    """What was painted step by step, adjusted and repainted, is byte for byte what a rebuild writes."""
    assert {one.dead for one in painted_of(stitched)} == {DeadBorder(right=2, bottom=2)}
    assert_explained(stitched, tmp_path)


@pytest.mark.thorough
def test_a_second_flight_goes_beside_the_first(stitched: Path) -> None:
    before = {p: p.stat().st_mtime_ns for p in stitched.rglob("*") if p.is_file()}
    second = stitch([stitched / "frames" / "DCIM" / "100MEDIA"], stitched, FEW_FEATURES, QUIET)
    assert second == stitched.with_name(f"{stitched.name}-2")
    assert {p: p.stat().st_mtime_ns for p in stitched.rglob("*") if p.is_file()} == before


def test_no_exif_and_no_name_can_move_a_frame(stitched: Path, tmp_path: Path) -> None:
    """The same pixels under other names, other times and with other metadata lie in the same places."""
    frames = sorted((stitched / "frames").rglob("IMG*.JPG"))[:4]
    poses = []
    for variant in (0, 1):
        folder = tmp_path / f"variant{variant}"
        folder.mkdir()
        for k, path in enumerate(frames):
            data = path.read_bytes()
            exif = b"\xff\xe1\x00\x16Exif\0\0MM\0*\0\0\0\x08\0\0\0\0\0\0" if variant else b""
            (folder / f"{'ab'[variant]}{k}.jpg").write_bytes(data[:2] + exif + data[2:])
        out = stitch([folder], tmp_path / f"out{variant}", FEW_FEATURES, QUIET)
        with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
            poses.append([estimate.pose for estimate in ledger.estimates()])
    assert len(poses[0]) == 4
    assert poses[0] == poses[1]


def test_a_frame_that_breaks_the_program_is_rejected_and_said(
    tmp_path: Path, stitched: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A surprise inside one frame's work costs that frame, not the flight."""
    place = Mosaic.place

    def break_on_the_third(self: Mosaic, features: Features, name: str, order: int, aircraft: int | None) -> Outcome:
        if "0003" in name:
            raise RuntimeError("surprise")
        return place(self, features, name, order, aircraft)

    monkeypatch.setattr(Mosaic, "place", break_on_the_third)
    (tmp_path / "frames").mkdir()
    for path in sorted((stitched / "frames").rglob("IMG*.JPG"))[:5]:
        shutil.copy2(path, tmp_path / "frames")
    out = stitch([tmp_path / "frames"], tmp_path / "out", FEW_FEATURES, QUIET)
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        rejected = ledger.frames(FrameState.REJECTED)
        assert ledger.accounts().frames.placed == 4
    assert [frame.name for frame in rejected] == ["IMG_0003.JPG"]
    assert "surprise" in sure(rejected[0].reason)


@pytest.mark.parametrize(("megapixels", "placed"), [(1.8, 3), (0.0, 1)])
def test_frames_that_nothing_connects_are_looked_at_again(
    ground: np.ndarray, tmp_path: Path, megapixels: float, placed: int
) -> None:
    """Three frames with a tenth in common, of which few features are kept at first."""
    (tmp_path / "frames").mkdir()
    for number in range(3):
        picture = photograph(ground, Pose(500 + 430 * number, 600), SMALL_CAMERA)
        cv2.imwrite(str(tmp_path / "frames" / f"{number}.png"), picture)
    few = StitchSettings(features=FeatureSettings(count=41), second_look=SecondLookSettings(megapixels=megapixels))
    flight = stitch([tmp_path / "frames"], tmp_path / "flight", Config(stitch=few), QUIET)
    with Ledger(flight / LEDGER_NAME, read_only=True) as ledger:
        assert ledger.accounts().frames.placed == placed

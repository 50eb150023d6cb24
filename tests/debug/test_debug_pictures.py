"""`gcs-mosaic stitch --debug`: a flight tells in pictures and words how its frames were placed."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

import sitl.flight
from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.config.tree import Config
from gcs_mosaic.debug.pictures import MOST_LINES, DebugPictures
from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration
from sitl.path import Plan


def registration(count: int) -> Registration:
    pixels = np.linspace(0, 299, count)[:, None] * [1, 0.5]
    return Registration(pixels, pixels + 10, np.zeros((count, 2), np.intp), np.eye(3), count // 2, 20.0)


def refusal(count: int) -> NotRegistered:
    pixels = np.linspace(0, 299, count)[:, None] * [1, 0.5]
    return NotRegistered("evidence 3.0, 8.0 needed", count, pixels, pixels)


def image(_name: str) -> ImageBGR:
    return np.full((300, 400, 3), 128, np.uint8)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """Debug pictures of a flight of three frames."""
    frames = tmp_path_factory.mktemp("given")
    route = Plan(frames=3, height=60)
    sitl.flight.make("survey", frames, (640, 480), cache=world_cache, seed=3, world_size=2048, route=route)
    debug = tmp_path_factory.mktemp("debug") / "pictures"
    stitch([frames], tmp_path_factory.mktemp("flown") / "mosaic", Config(scale=0.5), Console(quiet=True), debug)
    return debug


@pytest.mark.long
def test_a_flight_leaves_all_its_pictures(flown: Path) -> None:
    names = {path.name for path in flown.iterdir()}
    assert names == {"journal.txt", "matches", "footprints.png", "residuals.png", "relief.png"}
    pairs = list((flown / "matches").iterdir())
    assert any(path.name == "DCIM_100MEDIA_IMG_0002-DCIM_100MEDIA_IMG_0001.jpg" for path in pairs)
    pictures = [cv2.imread(str(path)) for path in [*flown.glob("*.png"), *pairs]]
    assert all(picture is not None and picture.std() > 5 for picture in pictures)


@pytest.mark.long
def test_the_journal_tells_what_was_decided(flown: Path) -> None:
    lines = (flown / "journal.txt").read_text().splitlines()
    assert lines[0] == "DCIM/100MEDIA/IMG_0001.JPG placed on island 0, linked with 0"
    assert lines[1].startswith("DCIM/100MEDIA/IMG_0002.JPG and DCIM/100MEDIA/IMG_0001.JPG: ")
    assert lines[1].endswith(" independent inliers")
    assert "island 0 adjusted, 3 frames" in lines


def test_refused_pairs_are_drawn_with_what_agreed_unless_next_to_nothing_did(tmp_path: Path) -> None:
    pictures = DebugPictures(tmp_path)
    pictures.registered("a.jpg", "b.jpg", refusal(20))
    pictures.registered("a.jpg", "c.jpg", refusal(4))
    pictures.registered("b.jpg", "c.jpg", registration(2000))
    pictures.registered("a.jpg", "d.jpg", refusal(30))
    pictures.registered("d.jpg", "a.jpg", registration(30))  # found at the second attempt
    pictures.registered("d.jpg", "b.jpg", registration(30))
    pictures.disbelieved("d.jpg", "b.jpg", "tilted by 85 degrees")
    pictures.write([], image)
    names = {path.name for path in (tmp_path / "matches").iterdir()}
    assert names == {"a-b-refused.jpg", "b-c.jpg", "d-a.jpg", "d-b-refused.jpg"}
    assert "a.jpg and b.jpg: refused: evidence 3.0, 8.0 needed" in (tmp_path / "journal.txt").read_text()


@pytest.mark.long
def test_a_long_flight_is_kept_in_bounded_pieces(tmp_path: Path) -> None:
    pictures = DebugPictures(tmp_path)
    for i in range(100):
        pictures.registered(f"{i}.jpg", f"{i + 1}.jpg", registration(2000))
    assert max(len(pair.pixels_a) for pair in pictures._pairs.values()) == MOST_LINES
    pictures.write([], image)
    drawn = {path.name for path in (tmp_path / "matches").iterdir()}
    assert len(drawn) == 40
    assert {"0-1.jpg", "99-100.jpg"} <= drawn


def test_each_island_has_pictures_of_its_own(tmp_path: Path, two_placements: list[Placement]) -> None:
    elsewhere = [type(p)(p.name + "x", 3, p.pose, p.camera, None, 0, 0.0, (), 0, 0.0) for p in two_placements[:1]]
    pictures = DebugPictures(tmp_path)
    pictures.write([*elsewhere, *two_placements], lambda name: None)
    assert {path.name for path in tmp_path.glob("*.png")} == {"footprints.png", "footprints-3.png"}
    larger, smaller = (cv2.imread(str(tmp_path / name)) for name in ("footprints.png", "footprints-3.png"))
    assert larger is not None
    assert smaller is not None
    assert larger.shape[0] < smaller.shape[0]  # two frames side by side are wider than one, and all sheets equally wide


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").touch()
    with pytest.raises(UsageError, match="not empty"):
        DebugPictures(tmp_path)

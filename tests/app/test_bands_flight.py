"""A flight with a camera that writes a file for each band: its shots are frames of several bands, live as from a folder."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from gcs_mosaic.frames.decode import load_image
from gcs_mosaic.store.ledger import Ledger
from tests.frames.multiband.band_files import BANDS, BORDER, HEIGHT, WIDTH, file_of, seen, tiff_of
from tests.running import Running, events_of, flying, frames_of, run, six_pictures

pytestmark = pytest.mark.long

SHOTS = 5
NAMED = ["IMG_0000_1.tif", "IMG_0001_2.tif", "IMG_0002.tif", "IMG_0003", ""]  # by the shots' messages


@pytest.fixture(scope="module")
def shots(world_cache: Path) -> list[dict[str, bytes]]:
    """The files of each shot by name; the pictures overlap."""
    wide = (WIDTH + 2 * BORDER, HEIGHT + 2 * BORDER)
    files = list[dict[str, bytes]]()
    for number, jpeg in enumerate(six_pictures(world_cache, size=wide)[:SHOTS]):
        grey = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        looked_at = np.asarray(np.asarray(grey) / np.float32(255), np.float32)
        files.append({file_of(number, band): tiff_of(seen(looked_at, band, number)) for band in BANDS})
    return files


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, shots: list[dict[str, bytes]]) -> Running:
    with flying(tmp_path_factory.mktemp("flown")) as flight:
        for number, files in enumerate(shots):
            flight.trigger(NAMED[number])
            for name, data in files.items():
                flight.bring(name, data)
            time.sleep(1.2)  # as such cameras take
        flight.wait_for_frames(placed=SHOTS)
        assert flight.end() == 0
        return flight


def test_each_shot_is_one_frame_with_its_event(flown: Running) -> None:
    assert {name: frame.state for name, frame in frames_of(flown.out).items()} == {
        file_of(number, 2): "placed" for number in range(SHOTS)
    }
    assert events_of(flown.out) == ["matched"] * SHOTS
    with Ledger(flown.out / "flight.sqlite", read_only=True) as ledger:
        assert [event.frame for event in ledger.events()] == [file_of(number, 2) for number in range(SHOTS)]
    assert flown.document("mosaic.json")["orphans"] == 0
    assert flown.said.count("5 bands of each shot are one frame") == 1
    assert "Each shot has several files" not in flown.said


def test_the_originals_have_all_bands_and_the_flight_is_whole(flown: Running) -> None:
    for path in (flown.out / "frames").iterdir():
        image = load_image(path)
        assert isinstance(image, np.ndarray)
        assert image.shape[2] == len(BANDS)
    checked = run("check", flown.out, cwd=flown.home)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    with Ledger(flown.out / "flight.sqlite", read_only=True) as ledger:
        assert len(ledger.other_files()) == SHOTS * (len(BANDS) - 1)


def test_all_bands_are_exported(flown: Running) -> None:
    done = run("export", flown.out, "--format", "tiff", "--to", "bands.tif", cwd=flown.home)
    assert done.returncode == 0, done.stdout + done.stderr
    assert tifffile.imread(flown.home / "bands.tif").shape[2] == len(BANDS) + 1  # and the coverage


@pytest.mark.thorough
def test_stitching_the_folder_keeps_the_same_frames(flown: Running) -> None:
    done = run("stitch", flown.watch, "--out", "map", cwd=flown.home)
    assert done.returncode == 0, done.stdout + done.stderr
    of_folder = frames_of(flown.home / "map")
    assert {name: one.content_hash for name, one in of_folder.items()} == {
        name: one.content_hash for name, one in frames_of(flown.out).items()
    }
    assert "5 bands of each shot are one frame" in " ".join((done.stdout + done.stderr).split())


@pytest.mark.thorough
def test_a_flight_that_is_gone_on_with_takes_no_shot_again(flown: Running) -> None:
    before = frames_of(flown.out)
    with flying(flown.home, "--resume", "--from", "start", out=flown.out) as flight:
        flight.bring("last.png", cv2.imencode(".png", np.full((48, 64), 90, np.uint8))[1].tobytes())
        flight.wait_for(lambda status: sum(status["frames"].values()) > SHOTS, "the last file is there")
        flight.end()
    assert {name: one.content_hash for name, one in frames_of(flown.out).items() if name != "last.png"} == {
        name: one.content_hash for name, one in before.items()
    }

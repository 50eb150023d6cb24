"""A live flight whose shots have several files each, rewritten by a tagger: one frame for each shot, and its event.

In the field: DJI's wide, zoom and thermal picture of one shot in one folder, one event for each shot; exiftool
-overwrite_original 1.5 s after each file.
"""

from __future__ import annotations

import time

import pytest

from gcs_mosaic.store.ledger import Ledger
from tests.frames.image_files import with_thumbnail
from tests.running import Running, events_of, flying, frames_of, until

pytestmark = pytest.mark.long

SHOTS = 3


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, pictures: list[bytes]) -> Running:
    with flying(tmp_path_factory.mktemp("flown")) as flight:
        for k in range(SHOTS):
            flight.trigger("")
            for camera, data in (("T", pictures[5]), ("Z", pictures[4 - k]), ("W", pictures[k])):
                flight.bring(f"DJI_20230101120000_000{k + 1}_{camera}.JPG", data + camera.encode() + bytes([k]))
            time.sleep(0.6)
            name = flight.watch / f"DJI_20230101120000_000{k + 1}_W.JPG"
            name.with_suffix(".JPG_tmp").write_bytes(with_thumbnail(name.read_bytes()))
            name.with_suffix(".JPG_tmp").replace(name)
            time.sleep(0.6)
        flight.wait_for_frames(placed=SHOTS)
        until(lambda: flight.status()["conditions"], "it is told that there are several cameras")
        assert flight.end() == 0
        return flight


def test_one_frame_for_each_shot_and_its_event(flown: Running) -> None:
    assert {name: frame.state for name, frame in frames_of(flown.out).items()} == {
        f"DJI_20230101120000_000{k + 1}_W.JPG": "placed" for k in range(SHOTS)
    }
    assert events_of(flown.out) == ["matched"] * SHOTS
    assert flown.document("mosaic.json")["orphans"] == 0


def test_the_other_files_are_in_the_ledger(flown: Running) -> None:
    with Ledger(flown.out / "flight.sqlite", read_only=True) as ledger:
        assert sorted(camera for _, camera in ledger.other_files()) == ["_t"] * SHOTS + ["_z"] * SHOTS


def test_it_is_said_once_what_is_left_out_and_what_to_do(flown: Running) -> None:
    assert flown.said.count("--cameras '*_T.*'") == 1
    assert "without a trigger" not in flown.said


def test_the_originals_are_the_newest_bytes_and_no_others(flown: Running) -> None:
    kept = {path.read_bytes() for path in (flown.out / "frames").iterdir()}
    assert kept == {path.read_bytes() for path in flown.watch.glob("*_W.JPG")}

"""How a live flight ends: asked to, killed, or on a full disk; what came is accounted for, and what was written is whole."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import cv2
import pytest

from gcs_mosaic.app.live.daemon import LANDED_AFTER_S, RETRY_S
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from tests.benchmarks.flood import numbered
from tests.documents import placements
from tests.running import LONGEST_WAIT_S, QUICK, Running, events_of, flying, frames_of, until
from tests.sure import sure

COPY_ALL = "\noriginals: {reserve_gb: 0}\n"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of eight megabytes."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(place)]
    if sys.platform != "linux" or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small file system is not permitted here")
    yield place
    subprocess.run(["umount", "--lazy", place], check=True)


def fill(disk: Path) -> Path:
    """A file that takes all space that is left."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file:
        for size in (1 << 16, 1 << 9):
            with suppress(OSError):
                while file.write(bytes(size)):
                    pass
    assert shutil.disk_usage(disk).free == 0
    return filler


def assert_accounts_close(flight: Running, frames: int, *, open_ones: bool = False) -> None:
    with Ledger(flight.out / LEDGER_NAME, read_only=True) as ledger:
        accounts = ledger.accounts()
    of_frames = {state: getattr(accounts.frames, state) for state in accounts.frames.__slots__}
    of_events = {state: getattr(accounts.events, state) for state in accounts.events.__slots__}
    assert sum(of_frames.values()) == frames
    assert sum(of_events.values()) == len(events_of(flight.out)) <= flight.taken
    assert open_ones or of_frames["pending"] == of_events["pending"] == 0


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_asked_to_end_it_finishes_in_order(tmp_path: Path, pictures: list[bytes], sign: signal.Signals) -> None:
    with flying(tmp_path) as flight:
        for k in range(3):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for(lambda status: sum(status["frames"].values()) == 3, "three frames came")
        assert flight.end(sign) == 0
        assert flight.status()["state"] == "stopped"
        assert flight.status()["frames"] == flight.document("mosaic.json")["frames"]
        assert_accounts_close(flight, frames=3)


@pytest.mark.long
def test_it_ends_before_the_first_frame(tmp_path: Path) -> None:
    with flying(tmp_path) as flight:
        assert flight.document("mosaic.json")["islands"] == []
        flight.trigger("IMG_0.JPG")
        assert flight.end() == 0
        assert flight.status()["state"] == "stopped"
        assert flight.document("mosaic.json")["islands"] == []
        assert_accounts_close(flight, frames=0)


def end_with_sixty_frames(flight: Running, pictures: list[bytes]) -> None:
    """Ask it to end once sixty frames have come, most of which it has still to work off."""
    for k in range(60):
        flight.bring(f"IMG_{k}.JPG", numbered(pictures[k % 6], k))
    flight.wait_for(lambda status: sum(status["frames"].values()) == 60, "sixty frames came")
    flight.process.send_signal(signal.SIGINT)
    until(lambda: "ending: working off" in flight.said, "ending")


@pytest.mark.long
def test_asked_twice_it_ends_quickly(tmp_path: Path, pictures: list[bytes]) -> None:
    """What is not processed is said to be so, and stays for another start; its original is kept."""
    with flying(tmp_path) as flight:
        end_with_sixty_frames(flight, pictures)
        asked = time.monotonic()
        assert flight.end(signal.SIGINT) == 0
        assert time.monotonic() - asked < 6
        assert flight.status()["state"] == "stopped"
        left = flight.document("mosaic.json")["frames"]["unstitched"]
        assert left > 10
        assert f"{left} frames are not on the map" in flight.said
        assert_accounts_close(flight, frames=60)
        assert all((flight.out / sure(frame.original)).is_file() for frame in frames_of(flight.out).values())


@pytest.mark.long
def test_while_it_works_off_what_has_come_it_says_that_it_ends(tmp_path: Path, pictures: list[bytes]) -> None:
    """And not that it flies, which who looks at the page would take for a flight that goes on."""
    with flying(tmp_path) as flight:
        end_with_sixty_frames(flight, pictures)
        pending = flight.status()["frames"]["pending"]
        status = flight.wait_for(
            lambda status: 0 < status["frames"]["pending"] < pending - 1, "some have had their turn"
        )
        assert status["state"] == "settling"
        assert flight.end(signal.SIGINT) == 0


@pytest.mark.long
def test_a_final_painting_that_is_cut_short_is_said(tmp_path: Path, pictures: list[bytes]) -> None:
    with flying(tmp_path, config=QUICK + "\nfinish_s: 0\n") as flight:
        for k in range(3):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for_frames(placed=3)
        assert flight.end() == 0
        assert "parts of the map stay as in flight" in flight.said
        assert_accounts_close(flight, frames=3)


@pytest.mark.thorough
@pytest.mark.long
def test_what_was_cut_short_is_painted_when_the_flight_is_resumed(tmp_path: Path, pictures: list[bytes]) -> None:
    """As that sentence says; it is settled before it is asked to end."""
    with flying(tmp_path, config=QUICK + "\nfinish_s: 0\n") as flight:
        for k in range(6):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for_frames(placed=6)
        assert flight.end() == 0
    cut_short = tiles_of(flight.out)
    with flying(tmp_path, "--resume", config=QUICK) as flight:
        until(lambda: tiles_of(flight.out) != cut_short, "it paints", LANDED_AFTER_S + 20)
        time.sleep(10)
        settled = tiles_of(flight.out)
        assert flight.end() == 0
        assert "parts of the map stay" not in flight.said
    assert tiles_of(flight.out) == settled


def tiles_of(out: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in (out / "tiles").rglob("*.*") if path.is_file()}


@pytest.mark.long
def test_killed_in_flight_everything_written_is_whole(tmp_path: Path, pictures: list[bytes]) -> None:
    with flying(tmp_path) as flight:
        for k in range(6):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for(lambda status: status["frames"]["placed"] >= 2, "two frames are placed")
        flight.process.kill()
        flight.process.wait(LONGEST_WAIT_S)
    assert_accounts_close(flight, frames=len(frames_of(flight.out)), open_ones=True)
    tiles = [path for kind in ("tiles", "masks") for path in (flight.out / kind).rglob("*.[jp]*g")]
    assert len(tiles) > 4
    assert all(sure(cv2.imread(str(path))).shape == (256, 256, 3) for path in tiles)
    counted = flight.document("mosaic.json")
    assert counted["frames"]["placed"] >= 1
    told = placements(flight.out)  # of which the last revision may have been on its way
    assert told["revision"] - counted["revision"] in (0, 1)
    assert len(told["frames"]) >= counted["frames"]["placed"]
    before = contents(flight.out)
    with flying(tmp_path, "--new") as again:
        assert "holds an earlier flight, which is left as it is; this flight is written to" in again.said
        again.out = tmp_path / "mosaic-2"
        again.wait_for_frames(placed=6)
    assert contents(flight.out) == before


def contents(folder: Path) -> dict[Path, bytes]:
    """Every file of a flight, but for what SQLite keeps beside the ledger for its readers."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and "sqlite-" not in path.name}


@pytest.mark.long
def test_a_full_disk_is_said_once_and_nothing_is_lost(tmp_path: Path, pictures: list[bytes], small_disk: Path) -> None:
    with flying(tmp_path, out=small_disk / "mosaic", config=QUICK + COPY_ALL) as flight:
        flight.take("IMG_0.JPG", pictures[0])
        flight.wait_for_frames(placed=1)
        filler = fill(small_disk)
        for k in range(1, 5):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for(lambda status: "disk is full" in status["notices"][-1]["text"], "the page knows of it")
        tried = time.time() + 2 * RETRY_S
        flight.wait_for(
            lambda status: datetime.fromisoformat(status["updated"]).timestamp() > tried,
            "it goes on, and has tried again",
        )
        assert flight.said.count("the disk is full") == 1
        filler.unlink()
        flight.wait_for_frames(placed=5)
        assert flight.said.count("the disk can be written again") == 1
        assert flight.end() == 0
        assert_accounts_close(flight, frames=5)
        assert events_of(flight.out) == ["matched"] * 5
        assert all((flight.out / sure(frame.original)).is_file() for frame in frames_of(flight.out).values())


@pytest.mark.long
def test_it_can_be_ended_on_a_full_disk(tmp_path: Path, pictures: list[bytes], small_disk: Path) -> None:
    """Asked to end it answers at once; asked again it ends, and says what is not mapped and what is lost."""
    config = QUICK + COPY_ALL
    with flying(tmp_path, out=small_disk / "mosaic", config=config) as flight:
        flight.take("IMG_0.JPG", pictures[0])
        flight.wait_for_frames(placed=1)
        filler = fill(small_disk)
        flight.trigger("IMG_1.JPG")
        flight.wait_for(lambda status: "disk is full" in status["notices"][-1]["text"], "the page knows of it")
        flight.take("IMG_2.JPG", pictures[2])
        flight.wait_for(lambda status: status["frames_in_queue"] == 1, "the picture is known")
        asked = time.monotonic()
        flight.process.send_signal(signal.SIGINT)
        until(
            lambda: "ending: the disk is waited for, at most 30 s (again Ctrl-C: at once)" in flight.said, "an answer"
        )
        assert time.monotonic() - asked < RETRY_S
        flight.wait_for(lambda status: status["state"] == "settling", "the status tells that it ends")
        assert flight.end(signal.SIGINT) == 1
        last = flight.said.splitlines()[-1]
        assert last.startswith("gcs-mosaic: the disk is full: free some space (")
        left = "1 frame is not on the map yet, 2 triggers are lost"
        assert f"The flight has ended before that: {left}. Then gcs-mosaic --resume --out {flight.out}" in last
        assert "Traceback" not in flight.said
        assert flight.status()["state"] == "stopped"
        assert left in flight.status()["conditions"][-1]["text"]
        filler.unlink()
        assert frames_of(flight.out)["IMG_0.JPG"].state == "placed"
        assert_accounts_close(flight, frames=len(frames_of(flight.out)), open_ones=True)
    with flying(tmp_path, out=small_disk / "mosaic", config=config) as flight:
        flight.wait_for_frames(placed=2)
        assert flight.end() == 0


@pytest.mark.long
def test_when_the_time_for_the_end_is_up_it_ends_on_a_full_disk_too(
    tmp_path: Path, pictures: list[bytes], small_disk: Path
) -> None:
    config = QUICK.replace("finish_s: 30", "finish_s: 3") + COPY_ALL
    with flying(tmp_path, out=small_disk / "mosaic", config=config) as flight:
        filler = fill(small_disk)
        flight.take("IMG_0.JPG", pictures[0])
        flight.wait_for(lambda status: "disk is full" in status["notices"][-1]["text"], "the page knows of it")
        assert flight.end() == 1
        assert "The flight has ended before that: 1 frame is not on the map yet, 1 trigger is lost." in flight.said
        filler.unlink()


@pytest.mark.long
def test_a_disk_that_has_room_again_while_the_end_waits_costs_nothing(
    tmp_path: Path, pictures: list[bytes], small_disk: Path
) -> None:
    with flying(tmp_path, out=small_disk / "mosaic", config=QUICK + COPY_ALL) as flight:
        filler = fill(small_disk)
        flight.take("IMG_0.JPG", pictures[0])
        flight.wait_for(lambda status: "disk is full" in status["notices"][-1]["text"], "the page knows of it")
        flight.process.send_signal(signal.SIGINT)
        until(lambda: "ending: the disk is waited for" in flight.said, "an answer")
        filler.unlink()
        assert flight.process.wait(LONGEST_WAIT_S) == 0
        assert frames_of(flight.out)["IMG_0.JPG"].state == "placed"
        assert events_of(flight.out) == ["matched"]


@pytest.mark.long
def test_a_terminal_that_goes_ends_no_flight(tmp_path: Path, pictures: list[bytes]) -> None:
    """The program that reads what is said dies, then the window is closed."""
    reading, writing = os.pipe()
    with flying(tmp_path, terminal=writing) as flight:
        os.close(writing)
        os.close(reading)
        for k in range(3):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for_frames(placed=3)
        assert flight.end(signal.SIGHUP) == 0
        assert_accounts_close(flight, frames=3)

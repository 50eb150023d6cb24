"""The live program with bad pictures, bad words on the link and lost folders: nothing ends it, all is accounted for."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console

from gcs_mosaic.app.inputs import inbox as sources
from gcs_mosaic.app.inputs import links as listening
from gcs_mosaic.app.live import daemon
from gcs_mosaic.app.live.shutdown import Shutdown
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Notice
from gcs_mosaic.store.records import FrameRecord
from sitl.delivery import write_slowly
from tests.documents import document_at
from tests.ports import free_port
from tests.running import Running, events_of, flying, frames_of, run, six_pictures, until
from tests.sure import sure

GOOD = 4


def encoded(image: np.ndarray, suffix: str = ".jpg") -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()


def plain(level: int) -> bytes:
    """A picture on which nothing can be seen."""
    return encoded(np.full((480, 640, 3), level, np.uint8))


@pytest.fixture(scope="module")
def elsewhere(world_cache: Path) -> bytes:
    """A picture of ground that no other picture shows."""
    return six_pictures(world_cache, seed=4)[0]


@pytest.fixture(scope="module")
def other_camera(world_cache: Path) -> bytes:
    """The same ground through another camera."""
    return six_pictures(world_cache, size=(520, 400))[1]


@pytest.fixture(scope="module")
def flown(
    tmp_path_factory: pytest.TempPathFactory, pictures: list[bytes], elsewhere: bytes, other_camera: bytes
) -> Running:
    """A flight with every kind of bad picture, ended by SIGTERM."""
    with flying(tmp_path_factory.mktemp("flown")) as flight:
        for k in range(GOOD):
            flight.take(f"DCIM/IMG_{k:04d}.JPG", pictures[k])
        flight.wait_for_frames(placed=GOOD)
        bad = {"cut.jpg": pictures[5][:20_000], "mended.jpg": pictures[4][:20_000], "text.jpg": b"no picture\n" * 99}
        poor = {
            "black.jpg": plain(0),
            "grey.jpg": plain(128),
            "dot.png": encoded(np.zeros((1, 1, 3), np.uint8), ".png"),
        }
        other = {"elsewhere.jpg": elsewhere, "other.jpg": other_camera, "copy.jpg": pictures[2]}
        for name, data in (bad | poor | other).items():
            flight.take(f"sub/{name}", data)
        flight.bring("notes.txt", b"not a picture, and not called one")
        flight.wait_for_frames(damaged=3, rejected=3, waiting=1, duplicate=1, placed=GOOD + 1)
        flight.bring("sub/mended.jpg", pictures[4])  # the rest of it has come
        flight.bring("DCIM/IMG_0000.JPG", pictures[5][:20_000])  # the camera's counter has begun anew
        flight.wait_for_frames(damaged=3, placed=GOOD + 2)
        assert flight.end() == 0
        return flight


@pytest.fixture(scope="module")
def ledger(flown: Running) -> dict[str, FrameRecord]:
    return frames_of(flown.out)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "state", "reason"),
    [
        ("DCIM/IMG_0000.JPG", "placed", None),
        ("DCIM/IMG_0000.JPG#2", "damaged", "truncated"),
        ("sub/cut.jpg", "damaged", "truncated"),
        ("sub/mended.jpg", "placed", None),
        ("sub/text.jpg", "damaged", "not an image (JPEG, PNG or TIFF)"),
        ("sub/black.jpg", "rejected", "too little to see"),
        ("sub/grey.jpg", "rejected", "too little to see"),
        ("sub/dot.png", "rejected", "too little to see"),
        ("sub/elsewhere.jpg", "rejected", "matches no other frame"),
        ("sub/other.jpg", "placed", None),
        ("sub/copy.jpg", "duplicate", "the same picture as DCIM/IMG_0002.JPG"),
    ],
)
def test_every_frame_ends_in_the_right_account_with_a_reason(
    ledger: dict[str, FrameRecord], name: str, state: str, reason: str | None
) -> None:
    assert ledger[name].state == state
    assert (reason or "") in (ledger[name].reason or "")
    assert (ledger[name].reason is None) == (reason is None)


@pytest.mark.long
def test_both_accounts_close(flown: Running, ledger: dict[str, FrameRecord]) -> None:
    mosaic, status = flown.document("mosaic.json"), flown.status()
    assert mosaic["frames"] == status["frames"]
    assert mosaic["events"] == status["events"]
    assert sum(mosaic["frames"].values()) == len(ledger) == GOOD + 10
    assert mosaic["frames"]["pending"] == mosaic["frames"]["waiting"] == mosaic["events"]["pending"] == 0
    assert sum(mosaic["events"].values()) == len(events_of(flown.out)) == flown.taken
    assert mosaic["events"]["missing"] == 2  # the triggers of the pictures that never became whole


@pytest.mark.long
def test_every_original_is_kept_and_the_watched_folder_is_left_as_it_was(
    flown: Running, ledger: dict[str, FrameRecord], pictures: list[bytes]
) -> None:
    whole = {name: frame for name, frame in ledger.items() if frame.state not in ("damaged", "duplicate")}
    assert all((flown.out / sure(frame.original)).stat().st_size == frame.size for frame in whole.values())
    assert (flown.out / sure(ledger["DCIM/IMG_0000.JPG"].original)).read_bytes() == pictures[0]
    assert (flown.watch / "sub" / "text.jpg").exists()


@pytest.mark.long
def test_how_good_the_map_is_is_told_everywhere(flown: Running) -> None:
    islands = {str(one["id"]): one["held_out_px"] for one in flown.document("mosaic.json")["islands"]}
    known = {island: found for island, found in islands.items() if found}
    assert known["0"]["median"] < 2
    assert known == flown.status()["held_out_px"]
    line = f"{known['0']['p95']:.1f} px 95 % (island 0, {known['0']['matches']:,} matches)"
    assert line in flown.said
    assert line in run("status", flown.out, cwd=flown.home).stdout


@pytest.mark.long
def test_what_happened_is_said(flown: Running) -> None:
    assert flown.status()["state"] == "stopped"
    assert "made the folder frames, which was not there" in flown.said
    assert "sub/cut.jpg is damaged: truncated" in flown.said
    assert "sub/cut.jpg has come whole" not in flown.said
    assert "sub/mended.jpg has come whole after all: it is taken as any other" in flown.said
    assert "files ending in .txt are not images" in flown.said
    assert "Traceback" not in flown.said


@pytest.mark.long
def test_what_happened_is_in_the_log(flown: Running) -> None:
    log = (flown.out / "flight.log").read_text()
    assert "gcs_mosaic.app.status.reporter: frames: sub/cut.jpg is damaged: truncated" in log
    assert "gcs_mosaic.store.flight_store: sub/copy.jpg: duplicate, the same picture as DCIM/IMG_0002.JPG" in log
    assert "gcs_mosaic.store.flight_store: sub/black.jpg: rejected, too little to see: 0 features" in log
    assert "sub/elsewhere.jpg and DCIM/IMG_0003.JPG are not connected: " in log
    assert log.endswith("gcs_mosaic.app.status.flight_log: the flight has ended\n")


@pytest.mark.long
def test_the_status_is_told_of_an_ended_flight(flown: Running) -> None:
    told = run("status", flown.out, cwd=flown.home)
    assert told.returncode == 0
    assert "mosaic: stopped" in told.stdout
    assert f"{GOOD + 2} placed" in told.stdout
    assert "warning since " in told.stdout
    assert f"Not on the map: 4 of {GOOD + 9} frames, refused or without a match" in told.stdout
    assert f"Not on the map: 3 of {GOOD + 9} frames, damaged or dropped" in told.stdout
    assert "2 shots have no picture" in told.stdout
    assert "Not on the map: 4 of" in flown.said
    assert json.loads(run("status", flown.out, "--json", cwd=flown.home).stdout) == flown.status()


@pytest.mark.long
def test_a_half_written_file_is_waited_for(tmp_path: Path, pictures: list[bytes]) -> None:
    with flying(tmp_path) as flight:
        flight.trigger("later/IMG_1.JPG")
        write_slowly(flight.watch / "later" / "IMG_1.JPG", pictures[0], seconds=2.0)
        flight.wait_for_frames(placed=1)
        assert flight.end() == 0
        assert frames_of(flight.out)["later/IMG_1.JPG"].size == len(pictures[0])
        assert events_of(flight.out) == ["matched"]


@pytest.mark.long
def test_hostile_words_on_the_link_do_no_harm(tmp_path: Path, pictures: list[bytes]) -> None:
    """URLs that lead elsewhere, noise and another program's commands; nothing is ever answered."""
    with flying(tmp_path) as flight:
        for url in ("../../../etc/passwd", "/etc/shadow", "..\\..\\x.jpg", "\x1b[31m/%00%2e%2e", "a/../IMG_7.JPG"):
            flight.trigger(url)
        for packet in (b"", b"\xfd", b"\xfe\xff" * 200, bytes(range(256)) * 8):
            flight.vehicle.socket.send(packet)
        flight.bring("IMG_7.JPG", pictures[0])
        flight.wait_for_frames(placed=1)
        assert flight.end() == 0
        assert sorted(events_of(flight.out)) == ["matched", *["missing"] * 4]
        assert {path.name for path in tmp_path.iterdir()} == {"config.yaml", "frames", "mosaic", "said.txt"}
        assert "\x1b" not in flight.said


def test_nothing_is_ever_sent(tmp_path: Path, pictures: list[bytes]) -> None:
    """A ground station asks for everything; not one byte comes back."""
    with flying(tmp_path) as flight:
        for k in range(3):
            for question in questions():
                flight.vehicle.voices[1].send(question)
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for_frames(placed=3)
        assert flight.end() == 0
        flight.vehicle.socket.setblocking(False)
        with pytest.raises((BlockingIOError, ConnectionRefusedError)):
            flight.vehicle.socket.recv(1)


def questions() -> Iterator[mavlink.MAVLink_message]:
    """What every other program on a link answers."""
    yield mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    yield mavlink.MAVLink_ping_message(1, 1, 0, 0)
    yield mavlink.MAVLink_param_request_list_message(0, 0)
    yield mavlink.MAVLink_command_long_message(0, 0, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0)
    yield mavlink.MAVLink_timesync_message(0, 1)


@pytest.mark.long
def test_nothing_but_a_link_need_be_named(tmp_path: Path) -> None:
    with flying(tmp_path, config=None) as flight:
        assert flight.end() == 0
    assert {path.name for path in tmp_path.iterdir()} == {"frames", "mosaic", "said.txt"}
    assert "mosaic was created; this flight is written to it" in flight.said
    assert "listening on udpin:127.0.0.1:" in flight.said


@pytest.mark.long
def test_a_watched_folder_that_goes_and_comes_back(tmp_path: Path, pictures: list[bytes]) -> None:
    with flying(tmp_path) as flight:
        flight.take("IMG_0.JPG", pictures[0])
        flight.wait_for_frames(placed=1)
        flight.watch.rename(tmp_path / "unplugged")
        flight.wait_for(lambda status: status["watch"]["state"] == "missing", "missing")
        (tmp_path / "unplugged").rename(flight.watch)
        flight.take("IMG_1.JPG", pictures[1])
        flight.wait_for_frames(placed=2)
        assert flight.status()["watch"]["state"] == "watching"
        assert flight.said.count("is gone") == flight.said.count("is back") == 1


@pytest.mark.long
def test_an_output_folder_that_goes_and_comes_back(tmp_path: Path, pictures: list[bytes]) -> None:
    with flying(tmp_path) as flight:
        flight.take("IMG_0.JPG", pictures[0])
        flight.wait_for_frames(placed=1)
        flight.out.rename(tmp_path / "unplugged")
        flight.take("IMG_1.JPG", pictures[1])
        until(lambda: "cannot be written" in flight.said, "said")
        (tmp_path / "unplugged").rename(flight.out)
        flight.wait_for_frames(placed=2)
        assert flight.said.count("cannot be written") == flight.said.count("can be written again") == 1
        assert flight.end() == 0


@pytest.mark.long
@pytest.mark.parametrize(("part", "told"), [("watch", "the watching of "), ("triggers", "the link udpin:127.0.0.1:")])
def test_a_thread_that_dies_is_told_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: str, told: str
) -> None:
    def dying(*_: object) -> Iterator[Notice]:
        yield Notice(source="", level="info", text="still well")
        raise RuntimeError("a fault")

    monkeypatch.setattr(listening if part == "triggers" else sources, part, dying)
    config = Config(
        mavlink=(f"udp:127.0.0.1:{free_port()}",),
        http=None,
        watch=str(tmp_path / "frames"),
        out=str(tmp_path / "mosaic"),
    )
    stop = threading.Event()
    threading.Timer(1.5, stop.set).start()
    with ExitStack() as stack:
        links = listening.listen(config, stop, stack)
        daemon.fly(config, links, Console(quiet=True), Shutdown(stop=stop, hurry=threading.Event()))
    status = document_at(tmp_path / "mosaic" / "status.json")
    assert [notice for notice in status["notices"] if notice["text"].startswith(told) and notice["level"] == "error"]
    assert (status["watch"]["state"] == "ended") == (part == "watch")
    assert (status["mavlink"][0]["state"] == "failed") == (part == "triggers")


@pytest.mark.long
def test_a_second_program_goes_beside_the_first(tmp_path: Path, pictures: list[bytes]) -> None:
    out = tmp_path / "mosaic"
    with flying(tmp_path / "one", out=out) as first, flying(tmp_path / "two", out=out) as second:
        assert "this flight is written to" in second.said
        second.out = tmp_path / "mosaic-2"
        for flight in (first, second):
            flight.take("IMG_0.JPG", pictures[0])
            flight.wait_for_frames(placed=1)
            assert flight.end() == 0
    assert first.document("mosaic.json")["flight"] == "mosaic"
    assert second.document("mosaic.json")["flight"] == "mosaic-2"


@pytest.mark.long
def test_pictures_that_come_while_the_program_starts_find_their_triggers(tmp_path: Path, pictures: list[bytes]) -> None:
    """The links are heard before everything else is there. Such triggers used to stay missing, though their files had come."""
    port, watched = free_port(), tmp_path / "frames"
    watched.mkdir()
    config = Config(
        mavlink=(f"udp:127.0.0.1:{port}",), http=None, watch=str(watched), out=str(tmp_path / "mosaic"), record=False
    )
    stop, out = threading.Event(), tmp_path / "mosaic"

    def both_have_come() -> bool:
        with suppress(UsageError):  # the ledger is being made
            return len(frames_of(out)) == 2
        return False

    def stop_with_both() -> None:
        """Not waiting for the link to decide whom it follows: it does so when it ends."""
        try:
            until(both_have_come, "both have come")
        finally:
            stop.set()

    threading.Thread(target=stop_with_both).start()
    with ExitStack() as stack, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as camera:
        links = listening.listen(config, stop, stack)
        sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        for shot in range(2):
            told = mavlink.MAVLink_camera_trigger_message(int(1e6 * (50 + 2 * shot)), shot)
            camera.sendto(bytes(told.pack(sender)), ("127.0.0.1", port))
            (watched / f"{'ab'[shot]}-x.jpg").write_bytes(pictures[shot])
            time.sleep(1.5)
        daemon.fly(config, links, Console(quiet=True), Shutdown(stop=stop, hurry=threading.Event()))
    assert events_of(out) == ["matched", "matched"]

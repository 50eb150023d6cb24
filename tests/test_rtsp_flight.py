"""The live program on a live stream, as an operator starts it: `gcs-mosaic --mavlink … --rtsp …`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.messages import CAMERA
from sitl.stream.camera import NEEDED, StreamingCamera, python_with_gstreamer
from sitl.world import make_world
from tests.running import QUICK, Running, events_of, flying, frames_of, run, six_pictures
from tests.showing import Showing
from tests.sure import sure

needs_gstreamer = pytest.mark.skipif(
    python_with_gstreamer() is None, reason=f"the streaming camera needs GStreamer: apt-get install {NEEDED}"
)
EACH_S = 1.0
PAN_PX = 16  # of 640, ten times a second
SECRET = "s3cr3t-word"
AUTO = QUICK + "rtsp: auto\nstream: {allowed_hosts: [127.0.0.0/8]}\n"


class Panning(Showing):
    """Steps with every picture, once it may."""

    moving = False

    def run(self) -> None:
        while not self.over.wait(1 / self.camera.rate):
            self.camera.show(self.pictures[self.shown])
            if self.moving:
                self.step()


S = TypeVar("S", bound=Showing)


@contextmanager
def shown(kind: type[S], pictures: list[np.ndarray]) -> Iterator[S]:
    """A camera that asks for a password shows the pictures."""
    camera = StreamingCamera(user=f"pilot:{SECRET}")
    camera.start()
    showing = kind(camera, pictures)
    showing.start()
    try:
        yield showing
    finally:
        showing.over.set()
        showing.join()
        camera.kill()


@pytest.fixture
def slides(world_cache: Path) -> Iterator[Showing]:
    with shown(
        Showing, [sure(cv2.imdecode(np.frombuffer(data, np.uint8), 1)) for data in six_pictures(world_cache)]
    ) as slides:
        yield slides


@pytest.fixture
def panorama(world_cache: Path) -> Iterator[Panning]:
    """The view moves over one long picture."""
    ground = make_world(3, 2048, cache=world_cache).levels[0]
    views = [np.ascontiguousarray(ground[700:1180, x : x + 640]) for x in range(0, 900, PAN_PX)]
    with shown(Panning, views) as panorama:
        yield panorama


def fly_over_all(flight: Running, slides: Showing) -> None:
    """Each slide is triggered in the middle of its time."""
    flight.wait_for(lambda status: status["watch"]["state"] == "connected", "connected")
    for _ in slides.pictures:
        time.sleep(EACH_S / 2)
        flight.trigger("not-on-this-computer.jpg")
        time.sleep(EACH_S / 2)
        if slides.shown + 1 < len(slides.pictures):
            slides.step()


@pytest.mark.long
@needs_gstreamer
def test_every_trigger_gets_its_frame_of_the_stream(tmp_path: Path, slides: Showing) -> None:
    """... which is kept, placed and matched. Its address comes from the aircraft, and is believed only of hosts on the
    list; the password is nowhere."""
    with flying(tmp_path, config=AUTO) as flight:
        for url in (f"rtsp://a:{SECRET}@192.0.2.7/main", slides.camera.url):
            flight.vehicle.send([(CAMERA, stream_at(url))])
        fly_over_all(flight, slides)
        flight.wait_for_frames(placed=len(slides.pictures))
        reported = flight.wait_for(lambda status: status["watch"]["taken"] == len(slides.pictures), "all reported")
        watch = reported["watch"]
        assert flight.end() == 0
    assert events_of(flight.out) == ["matched"] * len(slides.pictures)
    kept = {
        name: sure(cv2.imread(str(flight.out / sure(frame.original)))) for name, frame in frames_of(flight.out).items()
    }
    for image, slide in zip([kept[name] for name in sorted(kept)], slides.pictures, strict=True):
        assert np.abs(image.astype(int) - slide).mean() < 12  # another slide is off by 30 and more
    assert (watch["kind"], watch["folder"]) == ("stream", f"rtsp://127.0.0.1:{slides.camera.port}/camera")
    assert (watch["damaged"], watch["gaps"]) == (0, 0)
    assert watch["seen"] > 2 * len(
        slides.pictures
    )  # of a stream more is seen than taken; how much depends on the machine
    assert "rtsp://192.0.2.7/main, of which the aircraft tells, is not in stream: allowed_hosts" in flight.said
    assert not (tmp_path / "frames").exists()
    written = [path for path in tmp_path.rglob("*") if path.is_file() and path.suffix not in (".jpg", ".png")]
    assert {"said.txt", "status.json", "mosaic.json", "flight.sqlite", "flight.log"} <= {path.name for path in written}
    assert not [path for path in written if SECRET.encode() in path.read_bytes()]
    assert "stream rtsp://127.0.0.1" in run("status", flight.out, cwd=tmp_path).stdout


@pytest.mark.thorough
@pytest.mark.long
@needs_gstreamer
def test_without_triggers_the_moving_view_is_mapped(tmp_path: Path, panorama: Panning) -> None:
    """A frame whenever 30 % of the view is new: of 640 px, after 192 each."""
    with flying(tmp_path, "--rtsp", panorama.camera.url, "--every", "overlap") as flight:
        flight.wait_for(lambda status: status["watch"]["taken"] == 1, "the first frame")
        panorama.moving = True
        flight.wait_for(lambda _: panorama.shown == len(panorama.pictures) - 1, "the end of the flight")
        flight.wait_for(lambda status: status["frames"]["pending"] == status["frames_in_queue"] == 0, "all placed")
        assert flight.end() == 0
    states = [frame.state for frame in frames_of(flight.out).values()]
    moved = PAN_PX * (len(panorama.pictures) - 1)
    assert set(states) == {"placed"}
    assert moved // 250 <= len(states) - 1 <= moved // 150
    assert [island["frames"] for island in flight.document("mosaic.json")["islands"]] == [len(states)]


def stream_at(url: str) -> mavlink.MAVLink_message:
    numbers = {"framerate": 10.0, "resolution_h": 640, "resolution_v": 480, "bitrate": 0, "rotation": 0, "hfov": 0}
    return mavlink.MAVLink_video_stream_information_message(
        stream_id=1, count=1, type=0, flags=1, name=b"main", uri=url.encode(), **numbers
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rtsp", "http://pilot:s3cr3t-word@camera/x"], "the address is not understood"),
        (["--rtsp", "rtsp://pilot:s3cr3t-word@ca mera/x"], "the address is not understood"),
        (["--rtsp", "auto"], "name the hosts that are allowed"),
        (["--rtsp", "rtsp://camera/x", "--every", "often"], "expected overlap or seconds"),
        (["--rtsp", "rtsp://camera/x", "--watch", "frames"], "not allowed with"),
    ],
)
def test_a_stream_that_cannot_be_is_refused_in_one_sentence_without_the_password(
    tmp_path: Path, words: list[str], said: str
) -> None:
    done = run("--no-http", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert SECRET not in done.stderr
    assert list(tmp_path.iterdir()) == []

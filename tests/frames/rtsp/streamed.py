"""A real camera on loopback whose pictures carry their number, and a stream that is listened to as the program does it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.frames.decode import decode_image
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.keeper import stream
from gcs_mosaic.frames.rtsp.requests import Requests
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.rtsp.source import Item
from gcs_mosaic.messages import Frame, Notice, SourceReport
from sitl.stream.camera import NEEDED, StreamingCamera, python_with_gstreamer
from tests.factories import trigger_event

needs_gstreamer = pytest.mark.skipif(
    python_with_gstreamer() is None, reason=f"the streaming camera needs GStreamer: apt-get install {NEEDED}"
)
PERIOD_S = 0.1
BITS, SIDE = 16, 32  # px; a square is much larger than what video coding blurs
LONGEST_WAIT_S = 20.0

Image = NDArray[np.uint8]


def ground(size: tuple[int, int]) -> Image:
    coarse = np.random.default_rng(0).integers(40, 215, (48, 64, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def numbered(below: Image, number: int) -> Image:
    """The ground, moved on, with the number in black and white squares along the upper edge."""
    image = np.roll(below, 2 * number, axis=1)
    for bit in range(BITS):
        image[:SIDE, bit * SIDE : (bit + 1) * SIDE] = 255 if number >> bit & 1 else 0
    return image


def number_in(image: NDArray[np.uint8]) -> int:
    middles = [image[SIDE // 2, bit * SIDE + SIDE // 2].mean() for bit in range(BITS)]
    assert all(middle < 70 or middle > 185 for middle in middles), f"no number can be read: {middles}"
    return sum(1 << bit for bit, middle in enumerate(middles) if middle > 127)


@dataclass
class Film:
    """Shows the camera a new picture every 0.1 s, or as its rate is; `shown` is when each was taken (monotonic)."""

    camera: StreamingCamera
    shown: dict[int, float] = field(default_factory=dict)
    blurred: Callable[[int], bool] = lambda number: False
    stop: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        number, next_s, below = 0, time.monotonic(), ground(self.camera.size)
        while not self.stop.wait(max(0.0, next_s - time.monotonic())):
            if below.shape[1::-1] != self.camera.size:
                below = ground(self.camera.size)
            image = numbered(below, number)
            if self.blurred(number):
                image[SIDE:] = cv2.blur(image[SIDE:], (41, 41))
            taken = self.camera.show(image)
            if taken is not None:
                self.shown[number] = taken
            # A camera that was held up leaves pictures out, it does not hurry.
            number, next_s = number + 1, max(next_s, time.monotonic() - 0.02) + 1 / self.camera.rate

    def picture(self, number: int) -> Image:
        return numbered(ground(self.camera.size), number)


@dataclass
class Listened:
    """What a stream has brought so far."""

    camera: StreamingCamera
    film: Film
    requests: Requests
    items: list[Item] = field(default_factory=list)
    asked: dict[int, float] = field(default_factory=dict)  # moment by sequence

    def trigger(self, moment: float) -> None:
        sequence = len(self.asked)
        self.asked[sequence] = moment
        assert self.requests.put(Ask(moment, trigger_event(sequence, moment)))

    @property
    def frames(self) -> dict[int, int]:
        """The number in the picture, by the sequence of its trigger."""
        found = [item for item in list(self.items) if isinstance(item, Frame)]
        return {frame.taken_for.sequence: number_in(pixels(frame)) for frame in found if frame.taken_for}  # type: ignore[misc]

    @property
    def texts(self) -> list[str]:
        return [item.text for item in list(self.items) if isinstance(item, Notice)]

    @property
    def report(self) -> SourceReport:
        return [item for item in list(self.items) if isinstance(item, SourceReport)][-1]

    def errors(self) -> dict[int, float]:
        """How much later than its trigger each picture was shown, in seconds."""
        return {sequence: self.film.shown[number] - self.asked[sequence] for sequence, number in self.frames.items()}

    def nearest(self) -> dict[int, int]:
        """The number of the picture that was taken nearest to each trigger."""
        shown = dict(self.film.shown)
        return {k: min(shown, key=lambda number: abs(shown[number] - at)) for k, at in self.asked.items()}

    def wrong(self, tolerance_s: float) -> dict[int, float]:
        """The errors of pictures that are farther off, unless a busy machine has held the camera up and none was nearer."""
        nearest, frames = self.nearest(), self.frames
        return {k: off for k, off in self.errors().items() if abs(off) > tolerance_s and frames[k] != nearest[k]}

    def wait_until(self, true: Callable[[], object], what: str) -> None:
        deadline = time.monotonic() + LONGEST_WAIT_S
        while not true():
            assert time.monotonic() < deadline, f"still not so: {what}; {self.texts}"
            time.sleep(0.02)

    def has_said(self, text: str) -> bool:
        return any(text in said for said in self.texts)


def pixels(frame: Frame) -> Image:
    image = decode_image(frame.data or b"")
    assert isinstance(image, np.ndarray)
    return image


@contextmanager
def listening(
    camera: StreamingCamera, settings: StreamSettings | None = None, *, address: str | None = None
) -> Iterator[Listened]:
    """The camera shows a film, and its stream is listened to on a thread."""
    stop, film, requests = threading.Event(), Film(camera), Requests()
    camera.start()
    items = stream(address or camera.url, stop, requests, replace(settings or StreamSettings()))
    listened = Listened(camera, film, requests)

    def listen() -> None:
        for item in items:
            listened.items.append(item)

    threads = [threading.Thread(target=film.run), threading.Thread(target=listen)]
    for thread in threads:
        thread.start()
    try:
        listened.wait_until(lambda: camera.process is None or listened.has_said("is connected"), "connected")
        yield listened
    finally:
        stop.set()
        film.stop.set()
        camera.kill()
        for thread in threads:
            thread.join()

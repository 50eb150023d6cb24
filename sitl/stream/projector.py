"""Feeds the pictures of a flight to a streaming camera: each from shortly before its trigger until the next one."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import StreamingCamera

BEFORE_S = 0.4  # lead of a picture over its trigger, so that the view does not change at the trigger itself
AFTER_S = 1.0  # how long the last picture stays: the program takes it a little later

Image = NDArray[np.uint8]


@dataclass(slots=True)
class Projector:
    """Drop-in replacement of `sitl.delivery.Delivery`: pictures are streamed instead of written."""

    lead: ClassVar[float] = 4.0  # seconds before the first trigger, for clients to connect to the stream

    camera: StreamingCamera
    slides: list[tuple[float, Image]] = field(default_factory=list)  # (start in monotonic seconds, picture)
    over: threading.Event = field(default_factory=threading.Event)
    thread: threading.Thread = field(init=False)

    def __post_init__(self) -> None:
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def expect(self, data: bytes, due: float) -> None:
        """Queue the picture (encoded) of the trigger due at `due` (monotonic seconds)."""
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None, "a flight's pictures are pictures"
        if image.shape[1::-1] != self.camera.size:
            image = cv2.resize(image, self.camera.size, interpolation=cv2.INTER_AREA)
        self.slides.append((due - BEFORE_S, np.asarray(image, np.uint8)))

    def send(self, name: str, data: bytes) -> None:
        """No-op: the picture is already being streamed."""

    def run(self) -> None:
        """Stream the current picture at the camera's rate."""
        while not self.over.wait(1 / self.camera.rate):
            while len(self.slides) > 1 and self.slides[1][0] <= time.monotonic():
                self.slides.pop(0)
            if self.slides:
                self.camera.show(self.slides[0][1])

    def finish(self) -> None:
        """Keep streaming the last picture for AFTER_S, then stop."""
        time.sleep(AFTER_S)
        self.abandon()

    def abandon(self) -> None:
        self.over.set()
        self.thread.join()

"""Shows the pictures of a flight to a streaming camera: each around the moment of its trigger, until the next one's."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import StreamingCamera

BEFORE_S = 0.4  # a picture is shown so long before its trigger: the view does not leap at the very moment
AFTER_S = 1.0  # the last one stays so long: the program takes it a little later

Image = NDArray[np.uint8]


@dataclass(slots=True)
class Projector:
    """Takes the place of `sitl.delivery.Delivery`: pictures are streamed instead of written."""

    lead: ClassVar[float] = 4.0  # seconds before the first trigger: whoever listens must have found the stream

    camera: StreamingCamera
    slides: list[tuple[float, Image]] = field(default_factory=list)  # with when each begins (monotonic)
    over: threading.Event = field(default_factory=threading.Event)
    thread: threading.Thread = field(init=False)

    def __post_init__(self) -> None:
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def expect(self, data: bytes, due: float) -> None:
        """The picture (a file's bytes) of the trigger that is due at this moment."""
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None, "a flight's pictures are pictures"
        if image.shape[1::-1] != self.camera.size:
            image = cv2.resize(image, self.camera.size, interpolation=cv2.INTER_AREA)
        self.slides.append((due - BEFORE_S, np.asarray(image, np.uint8)))

    def send(self, name: str, data: bytes) -> None:
        """Nothing: the picture is on the screen already."""

    def run(self) -> None:
        """Show what is due, at the camera's rate."""
        while not self.over.wait(1 / self.camera.rate):
            while len(self.slides) > 1 and self.slides[1][0] <= time.monotonic():
                self.slides.pop(0)
            if self.slides:
                self.camera.show(self.slides[0][1])

    def finish(self) -> None:
        """Let the last picture be seen."""
        time.sleep(AFTER_S)
        self.abandon()

    def abandon(self) -> None:
        self.over.set()
        self.thread.join()

"""A streaming camera that shows a picture over and over, until it is given another."""

from __future__ import annotations

import threading

import numpy as np

from sitl.stream.camera import StreamingCamera


class Showing(threading.Thread):
    """Shows the camera the newest picture over and over; `step` brings the next one."""

    def __init__(self, camera: StreamingCamera, pictures: list[np.ndarray]) -> None:
        super().__init__()
        self.camera, self.pictures, self.shown = camera, pictures, 0
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.wait(1 / self.camera.rate):
            self.camera.show(self.pictures[self.shown])

    def step(self) -> None:
        self.shown = min(self.shown + 1, len(self.pictures) - 1)

"""Pictures of a stream, without one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.rtsp.clock import CaptureClock
from gcs_mosaic.frames.rtsp.ring_buffer import StreamPicture


class Still:
    """Stands for PyAV's VideoFrame."""

    def __init__(self, grey: NDArray[np.uint8]) -> None:
        self._grey = grey
        self.height, self.width = grey.shape

    def to_ndarray(self, *, format: str) -> NDArray[np.uint8]:
        return self._grey if format == "gray" else np.repeat(self._grey[..., None], 3, axis=2)

    def luma(self) -> NDArray[np.uint8]:
        return self._grey


def settled_clock() -> CaptureClock:
    """Pictures' times are moments."""
    clock = CaptureClock(-10.0, 0.0)
    clock.note(-10.0, -10.0, 0.0)
    return clock


def picture(
    moment: float, *, blur: bool = False, damaged: bool = False, clock: CaptureClock | None = None
) -> StreamPicture:
    grey = np.random.default_rng(1).integers(100, 110 if blur else 200, (36, 48)).astype(np.uint8)
    return StreamPicture(Still(grey), moment, clock or CLOCK, damaged)


CLOCK = settled_clock()

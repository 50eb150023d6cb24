"""Ring buffer of a stream's newest decoded images, for triggers yet to come."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.rtsp.clock import CaptureClock
from gcs_mosaic.stitch.arrays import ImageBGR, ImageGrey

_BLOCKS = (24, 18)  # columns and rows of the grid of `sharpness`


class VideoPicture(Protocol):
    """The part of PyAV's VideoFrame used here."""

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...

    def to_ndarray(self, *, format: str) -> NDArray[Any]: ...

    def luma(self) -> NDArray[np.uint8]: ...


@dataclass(slots=True, eq=False)
class StreamPicture:
    """An image as received; its pixels stay in the video's own format until needed."""

    video: VideoPicture
    time_s: float  # the stream's own timestamp
    clock: CaptureClock
    damaged: bool
    taken: bool = False
    is_for_trusted: bool = False  # taken for a source whose shots have proved true
    _sharpness: float | None = None

    @property
    def moment(self) -> float:
        """Estimated capture time on the host's monotonic clock."""
        return self.clock.moment(self.time_s)

    @property
    def sharpness(self) -> float:
        """Computed on first use."""
        if self._sharpness is None:
            self._sharpness = sharpness(self.grey())
        return self._sharpness

    def grey(self) -> ImageGrey:
        """(height, width) uint8."""
        return np.asarray(self.video.to_ndarray(format="gray"), np.uint8)

    def colour(self) -> ImageBGR:
        """(height, width, 3) BGR uint8."""
        return np.asarray(self.video.to_ndarray(format="bgr24"), np.uint8)

    @property
    def bytes(self) -> int:
        """Memory used: chroma adds half as many samples as luma has."""
        return self.video.width * self.video.height * 3 // 2


class Ring:
    """Images of the last `seconds`, or as many as fit into `most_bytes`. For one producer and one consumer thread."""

    def __init__(self, seconds: float, most_bytes: int) -> None:
        self._seconds, self._most_bytes = seconds, most_bytes
        self._pictures: deque[tuple[float, StreamPicture]] = deque()  # with arrival times
        self._bytes = 0
        self._changed = threading.Condition()
        self.cut_short = False
        """Whether the memory limit has ever cut the time images are kept."""

    def put(self, picture: StreamPicture, now: float) -> None:
        """Add the newest image; drop the oldest."""
        with self._changed:
            self._pictures.append((now, picture))
            self._bytes += picture.bytes
            while len(self._pictures) > 1 and self._is_over(now):
                self._bytes -= self._pictures.popleft()[1].bytes
            self._changed.notify_all()

    def pictures(self) -> list[StreamPicture]:
        """All images, oldest first."""
        with self._changed:
            return [picture for _, picture in self._pictures]

    def wait(self, timeout_s: float) -> None:
        """Wait for the next image, or the timeout."""
        with self._changed:
            self._changed.wait(timeout_s)

    def _is_over(self, now: float) -> bool:
        too_old = now - self._pictures[0][0] > self._seconds
        too_many = self._bytes > self._most_bytes
        self.cut_short |= too_many and not too_old
        return too_old or too_many


def sharpness(grey: NDArray[np.uint8]) -> float:
    """Median energy of the Laplacian (Nayar and Nakagawa 1994) over a grid of blocks: hard edges such as text overlaid by the
    camera must not hide blur everywhere else."""
    laplacian = cv2.Laplacian(grey, cv2.CV_32F)
    return float(np.median(cv2.resize(laplacian * laplacian, _BLOCKS, interpolation=cv2.INTER_AREA)))

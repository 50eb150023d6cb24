"""What can be done with a frame before it is its turn: decoding and finding features, a few frames ahead, on other cores."""

from __future__ import annotations

import logging
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Protocol

from gcs_mosaic.events import Frame
from gcs_mosaic.frames.load import Unreadable, load_frame
from gcs_mosaic.stitch.bands import Bands, resized
from gcs_mosaic.stitch.matching.features import Features

logger = logging.getLogger(__name__)


class FindFeatures(Protocol):
    """What finds the features of a frame; called from several threads."""

    def __call__(self, image: Bands, *, reduction: int) -> Features:
        """Of a picture (h, w, bands) that was reduced by a whole factor."""


THUMBNAIL_WIDTH = 96  # px; enough to compare the brightness of overlaps
AHEAD = 2  # decoded frames in memory besides the one in hand: 36 MB each at 12 MP


@dataclass(frozen=True, slots=True)
class Prepared:
    """A frame with its pixels (h, w, bands), reduced or not, features and thumbnail; `seconds` it took to make them."""

    frame: Frame
    image: Bands
    features: Features
    thumbnail: Bands
    seconds: dict[str, float]


@dataclass(frozen=True, slots=True)
class Unprepared:
    """A frame whose picture cannot be read, and why."""

    frame: Frame
    reason: str


def prepare(frame: Frame, find: FindFeatures, reduction: int = 1, least_pixels: float = 0.0) -> Prepared | Unprepared:
    """Decode a frame, at full size or reduced by a whole factor, and find its features; never raises.

    least_pixels: in how many pixels features are sought. A frame that has fewer once it is reduced is looked at less reduced, so
    that it lies where it would at full size, however coarsely it is painted.
    """
    try:
        return _prepared(frame, find, reduction, least_pixels)
    except Exception as error:  # one picture that OpenCV or the memory cannot cope with must not end a flight
        logger.exception("%s could not be prepared", frame.name)
        return Unprepared(frame, f"could not be decoded ({error!r})")


def _prepared(frame: Frame, find: FindFeatures, reduction: int, least_pixels: float) -> Prepared | Unprepared:
    start = time.perf_counter()
    image = load_frame(frame, reduction=reduction)
    if isinstance(image, Unreadable):
        return Unprepared(frame, image.reason)
    finer = finer_reduction(image.shape[0] * image.shape[1], reduction, least_pixels)
    looked_at = image if finer == reduction else load_frame(frame, reduction=finer)
    if isinstance(looked_at, Unreadable):
        return Unprepared(frame, looked_at.reason)
    decoded = time.perf_counter()
    features = find(looked_at, reduction=finer)
    seconds = {"decode": decoded - start, "features": time.perf_counter() - decoded}
    return Prepared(frame, image, features, thumbnail(image), seconds)


def finer_reduction(pixels: int, reduction: int, least_pixels: float) -> int:
    """The largest of reduction, reduction / 2, ... 1 that leaves a frame so many pixels, or nearly.

    pixels: what `reduction` leaves of it.
    """
    while reduction > 1 and pixels < NEARLY * least_pixels:
        reduction, pixels = reduction // 2, 4 * pixels
    return reduction


NEARLY = 0.9  # of the pixels wanted: rounding, and pictures that are not quite 4:3, are not worth four times the pixels


def thumbnail(image: Bands) -> Bands:
    """A copy (h, w, bands) that is `THUMBNAIL_WIDTH` wide, or the image itself if it is no wider."""
    if image.shape[1] <= THUMBNAIL_WIDTH:
        return image
    height = max(1, round(image.shape[0] * THUMBNAIL_WIDTH / image.shape[1]))
    if image.shape[1] >= 4 * THUMBNAIL_WIDTH:  # to a half, OpenCV is ten times as fast as to any other size
        image = resized(image, (image.shape[1] // 2, image.shape[0] // 2))
    return resized(image, (THUMBNAIL_WIDTH, height))


class Preparation:
    """Frames in a row, the first few of them prepared ahead."""

    def __init__(self, find: FindFeatures, reduction: int = 1, least_pixels: float = 0.0) -> None:
        self._find, self._reduction, self._least_pixels = find, reduction, least_pixels
        self._pool = ThreadPoolExecutor(AHEAD, thread_name_prefix="prepare")
        self._ahead: deque[Future[Prepared | Unprepared]] = deque()
        self._behind: deque[Frame] = deque()

    def __len__(self) -> int:
        return len(self._ahead) + len(self._behind)

    @property
    def is_ready(self) -> bool:
        """Whether the first frame of the row can be taken without waiting."""
        return bool(self._ahead) and self._ahead[0].done()

    def append(self, frame: Frame) -> None:
        """Put a frame at the end of the row."""
        self._behind.append(frame)
        self._fill()

    def next(self) -> Prepared | Unprepared | None:
        """The first frame of the row, taken from it as soon as it is ready; None if the row is empty."""
        if not self._ahead:
            return None
        prepared = self._ahead.popleft().result()
        self._fill()
        return prepared

    def wait(self, timeout_s: float) -> None:
        """Wait until the first frame of the row is ready, but not longer than this."""
        wait(list(self._ahead)[:1], timeout_s)

    def close(self) -> None:
        """Stop; frames still in the row stay where they came from."""
        self._pool.shutdown(cancel_futures=True)

    def _fill(self) -> None:
        while self._behind and len(self._ahead) < AHEAD:
            self._ahead.append(
                self._pool.submit(prepare, self._behind.popleft(), self._find, self._reduction, self._least_pixels)
            )

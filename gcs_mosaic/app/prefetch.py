"""What can be done with a frame before it is its turn: decoding and finding features, a few frames ahead, on other cores."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from itertools import count
from typing import Protocol

from gcs_mosaic.app.turns import AHEAD, AsTheyCame, Turns
from gcs_mosaic.frames.decode import Unreadable, load_frame
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.bands import resized
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.store.stages import stage

logger = logging.getLogger(__name__)


class FindFeatures(Protocol):
    """What finds the features of a frame; called from several threads."""

    def __call__(self, image: Bands, *, reduction: int) -> Features:
        """Of a picture (h, w, bands) that was reduced by a whole factor."""


THUMBNAIL_WIDTH = 96  # px; enough to compare the brightness of overlaps


@dataclass(frozen=True, slots=True)
class DecodedFrame:
    """A frame with its pixels (h, w, bands), reduced or not, features and thumbnail; `seconds` it took to make them."""

    frame: Frame
    image: Bands
    features: Features
    thumbnail: Bands
    seconds: dict[str, float]


@dataclass(frozen=True, slots=True)
class UndecodableFrame:
    """A frame whose picture cannot be read, and why."""

    frame: Frame
    reason: str


def prepare(
    frame: Frame,
    find: FindFeatures,
    reduction: int = 1,
    least_pixels: float = 0.0,
    known: Features | None = None,
) -> DecodedFrame | UndecodableFrame:
    """Decode a frame, at full size or reduced by a whole factor, and find its features unless they are known; never raises.

    least_pixels: in how many pixels features are sought. A frame that has fewer once it is reduced is looked at less reduced, so
    that it lies where it would at full size, however coarsely it is painted.
    """
    try:
        return _prepared(frame, find, reduction, least_pixels, known)
    except Exception as error:  # one picture that OpenCV or the memory cannot cope with must not end a flight
        logger.exception("%s could not be prepared", frame.name)
        return UndecodableFrame(frame, f"could not be decoded ({error!r})")


def _prepared(
    frame: Frame, find: FindFeatures, reduction: int, least_pixels: float, known: Features | None
) -> DecodedFrame | UndecodableFrame:
    start = time.perf_counter()
    with stage("decode", frame.name):
        image = load_frame(frame, reduction=reduction)
    if isinstance(image, Unreadable):
        return UndecodableFrame(frame, image.reason)
    if known is not None:
        return DecodedFrame(frame, image, known, thumbnail(image), {"decode": time.perf_counter() - start})
    finer = finer_reduction(image.shape[0] * image.shape[1], reduction, least_pixels)
    looked_at = image if finer == reduction else load_frame(frame, reduction=finer)
    if isinstance(looked_at, Unreadable):
        return UndecodableFrame(frame, looked_at.reason)
    decoded = time.perf_counter()
    with stage("features", frame.name):
        features = find(looked_at, reduction=finer)
    seconds = {"decode": decoded - start, "features": time.perf_counter() - decoded}
    return DecodedFrame(frame, image, features, thumbnail(image), seconds)


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
    """Frames that wait for their turn, those whose turn is next prepared ahead. Used by one thread.

    `turns` says whose turn it is, else frames are in a row; `woken()` is called, from any thread, when a frame is ready.
    """

    def __init__(
        self,
        find: FindFeatures,
        reduction: int = 1,
        least_pixels: float = 0.0,
        turns: Turns | None = None,
        woken: Callable[[], None] = lambda: None,
    ) -> None:
        self._find, self._reduction, self._least_pixels = find, reduction, least_pixels
        self._turns = turns or AsTheyCame()
        self._woken = woken
        self._pool = ThreadPoolExecutor(AHEAD, thread_name_prefix="prepare")
        self._numbers = count()
        self._waiting: dict[int, Frame] = {}  # in the order in which they came
        self._ahead: dict[int, Future[DecodedFrame | UndecodableFrame]] = {}
        self._features: dict[int, Features] = {}  # of frames that were ready when another one's turn came
        self._orders: dict[str, int] = {}  # of frames whose turn it was, by name

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def is_ready(self) -> bool:
        """Whether the frame whose turn it is can be taken without waiting."""
        self.begin()
        number = self._turns.next(self._ahead)
        return number is not None and self._ahead[number].done()

    def behind_s(self, now: float) -> float:
        """How long the oldest frame that waits has waited, `now` being a moment like `Frame.received`; 0 if none does."""
        return max(0.0, now - min((frame.received for frame in self._waiting.values()), default=now))

    def append(self, frame: Frame) -> None:
        """A frame has come, later than all before; `begin` is to follow, or whatever asks for a frame."""
        number = next(self._numbers)
        if len(self._waiting) > AHEAD and frame.path.is_file():
            frame = replace(frame, data=None)  # it will wait for long, and can be read again
        self._waiting[number] = frame
        self._turns.add(number)

    def next(self) -> DecodedFrame | UndecodableFrame | None:
        """The frame whose turn it is, as soon as it is ready; None if none waits."""
        if not self._waiting:
            return None
        self.begin()
        while (number := self._turns.next(self._ahead)) is None:
            self._wait_for_any(None)
        prepared = self._ahead[number].result()
        self._turns.remove(number)
        self._orders[self._waiting.pop(number).name] = number
        self._ahead.pop(number)
        self._features.pop(number, None)
        self.begin()
        return prepared

    def processed(self, name: str, on_map: Collection[str], *, waits: bool) -> None:
        """What became of the frame that was taken last: which ones found their place with it, or that it matches nothing."""
        found = [self._orders[other] for other in on_map if other in self._orders]
        self._turns.processed(self._orders[name], found, waits=waits)

    def begin(self) -> None:
        """Prepare those whose turn is next, of all that have come; at most AHEAD pictures are in memory or on the way there."""
        soon = self._turns.soon()
        for number in soon:
            if number not in self._ahead and self._made_room(soon):
                self._begin(number)

    def wait(self, timeout_s: float) -> None:
        """Wait until any more frames are ready, but not longer than this."""
        self.begin()
        self._wait_for_any(timeout_s)

    def close(self) -> None:
        """Stop; frames still in the row stay where they came from."""
        self._pool.shutdown(cancel_futures=True)

    def _ready(self) -> list[int]:
        return [number for number, future in self._ahead.items() if future.done()]

    def _wait_for_any(self, timeout_s: float | None) -> None:
        wait([future for future in self._ahead.values() if not future.done()], timeout_s, FIRST_COMPLETED)
        self.begin()

    def _made_room(self, soon: Sequence[int]) -> bool:
        """Whether there is room for another picture, once those are put back whose turn is not next."""
        for number in self._ready():
            if len(self._ahead) >= AHEAD and number not in soon:
                prepared = self._ahead.pop(number).result()
                if isinstance(prepared, DecodedFrame):
                    self._features[number] = prepared.features
        return len(self._ahead) < AHEAD

    def _begin(self, number: int) -> None:
        given = self._waiting[number], self._find, self._reduction, self._least_pixels, self._features.get(number)
        self._ahead[number] = self._pool.submit(prepare, *given)
        self._ahead[number].add_done_callback(lambda _: self._woken())

"""Preparation of upcoming frames: decoding and feature extraction, a few frames ahead, on other cores."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from typing import Protocol

from gcs_mosaic.app.waiting.turns import AHEAD, AsTheyCame, Turns
from gcs_mosaic.frames.decode import Unreadable, load_frame
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.frames.nodata import told_picture
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.bands import resized
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.features.extraction import Features, within
from gcs_mosaic.stitch.features.wedges import area_of
from gcs_mosaic.store.stages import stage

logger = logging.getLogger(__name__)


class LoadFrame(Protocol):
    """Decodes a frame; called from several threads."""

    def __call__(self, frame: Frame, *, reduction: int) -> Bands | Unreadable:
        """Its pixels, reduced by an integer factor."""


class FindFeatures(Protocol):
    """Finds the features of a frame; called from several threads."""

    def __call__(self, image: Bands, *, reduction: int) -> Features:
        """Features of an image (h, w, bands) that was reduced by an integer factor."""


# Of decoded frames that wait for their turn: of more than 26 MP in colour one is enough, where memory may be small.
MOST_AHEAD_BYTES = 160 << 20
THUMBNAIL_WIDTH = 96  # px; enough to compare the brightness of overlaps


@dataclass(frozen=True, slots=True)
class DecodedFrame:
    """A frame with its pixels (h, w, bands), reduced or not, features and thumbnail; `seconds` spent on them."""

    frame: Frame
    image: Bands
    features: Features
    thumbnail: Bands
    seconds: dict[str, float]


@dataclass(frozen=True, slots=True)
class UndecodableFrame:
    """A frame whose image cannot be read, and why; `passing` as in `Unreadable`."""

    frame: Frame
    reason: str
    passing: bool = False


def prepare(
    frame: Frame,
    find: FindFeatures,
    reduction: int = 1,
    least_pixels: float = 0.0,
    known: Features | None = None,
    load: LoadFrame = load_frame,
) -> DecodedFrame | UndecodableFrame:
    """Decode a frame, at full size or reduced by an integer factor, and find its features unless given; never raises.

    `load` decodes it; without, it is decoded here and now, which is for files that can be trusted.

    least_pixels: image size for the feature search. If the reduced frame is smaller, a less reduced one is used, so that
    the frame's pose is as at full size, however coarsely it is painted.
    """
    try:
        return prepare_or_raise(frame, find, reduction, least_pixels, known, load)
    except Exception as error:  # an image that OpenCV or the memory cannot handle must not end a flight
        logger.exception("%s could not be prepared", frame.name)
        return UndecodableFrame(frame, f"could not be decoded ({error!r})")


def prepare_or_raise(
    frame: Frame,
    find: FindFeatures,
    reduction: int,
    least_pixels: float,
    known: Features | None = None,
    load: LoadFrame = load_frame,
) -> DecodedFrame | UndecodableFrame:
    """As `prepare`, but raises whatever a library raises, MemoryError too."""
    start = time.perf_counter()
    with stage("decode", frame.name):
        image = load(frame, reduction=reduction)
    if isinstance(image, Unreadable):
        return UndecodableFrame(frame, image.reason, image.passing)
    if known is not None:
        small = thumbnail(_ground(image, known.area))
        return DecodedFrame(frame, image, known, small, {"decode": time.perf_counter() - start})
    finer = finer_reduction(image.shape[0] * image.shape[1], reduction, least_pixels)
    looked_at = image if finer == reduction else load(frame, reduction=finer)
    if isinstance(looked_at, Unreadable):
        return UndecodableFrame(frame, looked_at.reason, looked_at.passing)
    decoded = time.perf_counter()
    with stage("features", frame.name):
        area = area_of(looked_at, told_picture(frame, looked_at))
        features = within(find(_ground(looked_at, area), reduction=finer), area)
    seconds = {"decode": decoded - start, "features": time.perf_counter() - decoded}
    return DecodedFrame(frame, image, features, thumbnail(_ground(image, area)), seconds)


def _ground(image: Bands, area: PictureArea | None) -> Bands:
    return image if area is None else area.filled(image)


def finer_reduction(pixels: int, reduction: int, least_pixels: float) -> int:
    """The largest of reduction, reduction / 2, ... 1 that leaves a frame at least about this many pixels.

    pixels: the frame's size at `reduction`.
    """
    while reduction > 1 and pixels < NEARLY * least_pixels:
        reduction, pixels = reduction // 2, 4 * pixels
    return reduction


NEARLY = 0.9  # of the pixels wanted: rounding or an aspect ratio slightly off 4:3 does not justify four times as many


def thumbnail(image: Bands) -> Bands:
    """A copy (h, w, bands) `THUMBNAIL_WIDTH` wide, or the image itself if it is no wider."""
    if image.shape[1] <= THUMBNAIL_WIDTH:
        return image
    height = max(1, round(image.shape[0] * THUMBNAIL_WIDTH / image.shape[1]))
    while image.shape[1] >= 4 * THUMBNAIL_WIDTH:  # OpenCV halves ten times as fast as it resizes to any other size
        image = resized(image, (image.shape[1] // 2, max(1, image.shape[0] // 2)))
    return resized(image, (THUMBNAIL_WIDTH, height))


class Preparation:
    """Queue of frames, of which the next few are prepared ahead. For use by one thread, but for `expect`.

    `turns` sets the order, by default that of arrival; `woken()` is called, from any thread, when a frame is ready; `at_once`:
    how many are prepared or ready at a time, at most AHEAD.
    """

    def __init__(
        self,
        find: FindFeatures,
        decoders: Decoders,
        reduction: int = 1,
        least_pixels: float = 0.0,
        turns: Turns | None = None,
        woken: Callable[[], None] = lambda: None,
        at_once: int = AHEAD,
    ) -> None:
        self._find, self._reduction, self._least_pixels = find, reduction, least_pixels
        self._decoders = decoders
        self._decoders.begin()
        self._turns = AsTheyCame() if turns is None else turns
        self._woken = woken
        self._at_once = min(at_once, AHEAD)
        self._pool = ThreadPoolExecutor(AHEAD, thread_name_prefix="prepare")
        self._numbers = count()
        self._waiting: dict[int, Frame] = {}  # in order of arrival
        self._ahead: dict[int, Future[DecodedFrame | UndecodableFrame]] = {}
        self._features: dict[int, Features] = {}  # of frames that were ready when another one took precedence
        self._expected: tuple[str, Future[DecodedFrame | UndecodableFrame]] | None = None  # by its hash
        self._early: dict[int, Future[DecodedFrame | UndecodableFrame]] = {}  # begun before they were queued
        self._at_work = False  # on the last one taken
        self._orders: dict[str, int] = {}  # of frames already taken, by name
        self._image_bytes = 0  # of the last one taken

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def is_ready(self) -> bool:
        """Whether the next frame can be taken without waiting."""
        self.begin()
        number = self._next()
        return number is not None and self._ahead[number].done()

    def behind_s(self, now: float) -> float:
        """How long the oldest queued frame has waited at `now` (same clock as `Frame.received`); 0 if the queue is empty."""
        return max(0.0, now - min((frame.received for frame in self._waiting.values()), default=now))

    def waiting(self) -> list[Frame]:
        """The queued frames, in order of arrival."""
        return list(self._waiting.values())

    def expect(self, frame: Frame) -> None:
        """Begin to prepare a frame that may follow by `append`, unless others come before it; callable from any thread.

        The thread that queues it may first have to end a step of painting, or write to a ledger. While it is at work on a frame,
        nothing is begun: by the end of that a newer one may be there.
        """
        if self._expected is None and not (self._at_work or self._waiting or self._ahead):
            with suppress(RuntimeError):  # closed
                self._expected = frame.content_hash, self._prepared(frame)

    def forget_expected(self, frame: Frame) -> None:
        """This frame has been queued, or will not be."""
        if self._expected is not None and self._expected[0] == frame.content_hash:
            self._expected = None

    def append(self, frame: Frame) -> None:
        """Queue a frame that arrived after all before it; call `begin` or `next` afterwards."""
        number = next(self._numbers)
        if len(self._waiting) > AHEAD and frame.path.is_file():
            frame = replace(frame, data=None)  # it will wait for long, and can be read again
        self._waiting[number] = frame
        if self._expected is not None and self._expected[0] == frame.content_hash:
            self._early[number] = self._expected[1]
        self._turns.add(number, frame.vehicle)

    def withdraw(self, name: str) -> bool:
        """Take a frame from the queue that is not to be processed; whether it was there."""
        number = next((number for number, frame in self._waiting.items() if frame.name == name), None)
        if number is None:
            return False
        self._turns.remove(number)
        del self._waiting[number]
        for begun in (self._ahead, self._early, self._features):
            begun.pop(number, None)
        return True

    def next(self) -> DecodedFrame | UndecodableFrame | None:
        """The next frame, once it is ready; None if the queue is empty."""
        if not self._waiting:
            return None
        self.begin()
        while (number := self._next()) is None:
            self._wait_for_any(None)
        prepared = self._ahead[number].result()
        prepared, self._at_work = replace(prepared, frame=self._waiting.pop(number)), True
        self._turns.remove(number)
        self._orders[prepared.frame.name] = number
        self._ahead.pop(number)
        self._features.pop(number, None)
        if isinstance(prepared, DecodedFrame):
            self._image_bytes = prepared.image.nbytes
        self.begin()
        return prepared

    def processed(self, name: str, on_map: Collection[str], *, waits: bool) -> None:
        """Report the outcome of the last taken frame: the frames placed with it, or that it has no match."""
        found = [self._orders[other] for other in on_map if other in self._orders]
        self._turns.processed(self._orders[name], found, waits=waits)
        self._at_work = False

    def begin(self) -> None:
        """Start preparing the next frames of all queued; at most `at_once` images are in memory or being loaded, one if large."""
        soon = self._turns.soon()
        for number in [one for one, early in self._early.items() if one not in soon[:1] and early.done()]:
            self._put_back(number, self._early.pop(number).result())
        for place, number in enumerate(soon):
            if number not in self._ahead and self._made_room(soon, place):
                self._begin(number)

    def wait(self, timeout_s: float) -> None:
        """Wait until more frames are ready, or the timeout."""
        self.begin()
        self._wait_for_any(timeout_s)

    def close(self) -> None:
        """Stop; frames still queued are discarded, and those being prepared when their decoders are closed."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _next(self) -> int | None:
        """Whose turn it is among those being prepared; once newer ones are to come before it, that of one that is ready.

        Where frames come faster than they are prepared, none would ever have its turn if each waited for the next newer one.
        """
        best = self._turns.next(self._ahead)
        if best is None or best in self._turns.soon():
            return best
        ready = self._turns.next(self._ready())
        return best if ready is None else ready

    def _ready(self) -> list[int]:
        return [number for number, future in self._ahead.items() if future.done()]

    def _wait_for_any(self, timeout_s: float | None) -> None:
        wait([future for future in self._ahead.values() if not future.done()], timeout_s, FIRST_COMPLETED)
        self.begin()

    def _made_room(self, soon: Sequence[int], place: int) -> bool:
        """Whether there is room for another image, that of the frame at this `place` among those that come `soon`; after putting
        back ready ones that come later. One that only fills in would else hold the only place against the frame before it."""
        ready = self._ready()
        turn = self._turns.next(ready)
        most = self._at_once if AHEAD * self._image_bytes <= MOST_AHEAD_BYTES else 1
        for number in sorted(ready, key=lambda one: soon.index(one) if one in soon else len(soon), reverse=True):
            if len(self._ahead) >= most and number not in soon[:place] and number != turn:
                self._put_back(number, self._ahead.pop(number).result())
        return len(self._ahead) < most

    def _put_back(self, number: int, prepared: DecodedFrame | UndecodableFrame) -> None:
        """Another frame comes first: its image is let go."""
        if isinstance(prepared, DecodedFrame):
            self._features[number] = prepared.features

    def _begin(self, number: int) -> None:
        early = self._early.pop(number, None)
        self._ahead[number] = early or self._prepared(self._waiting[number], self._features.get(number))
        self._ahead[number].add_done_callback(lambda _: self._woken())

    def _prepared(self, frame: Frame, known: Features | None = None) -> Future[DecodedFrame | UndecodableFrame]:
        given = frame, self._find, self._reduction, self._least_pixels, known
        return self._pool.submit(prepare, *given, load=self._decoders.load_frame)


def one_after_another(preparation: Preparation, frames: Iterator[Frame]) -> Iterator[DecodedFrame | UndecodableFrame]:
    """The frames in their order, while some of the next are being prepared."""
    while True:
        while len(preparation) <= AHEAD and (frame := next(frames, None)) is not None:
            preparation.append(frame)
        prepared = preparation.next()
        if prepared is None:
            return
        yield prepared

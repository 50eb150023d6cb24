"""The pictures of a flight, measured one after the other for a person of one size; what was measured stays in memory."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from time import monotonic
from typing import TYPE_CHECKING

import cv2
import numpy as np

from gcs_mosaic.detection.clutter import (
    FilteredPicture,
    GroundStatistics,
    analysed_scale,
    disagreement,
    filtered,
    statistics,
)
from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.exposure import is_false_colour
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Array, FloatImage, ImageBGR
from gcs_mosaic.views.flight_view import FlightView, pixels_of, places_of
from gcs_mosaic.views.pictures import REDUCTIONS, NoPicture, displayed

if TYPE_CHECKING:  # it loads what stitches, which the page starts without
    from gcs_mosaic.store.records import PositionRecord

logger = logging.getLogger(__name__)

REMEMBERED = 3  # filtered pictures, 24 MB each at most, with which the next ones are compared
THUMBNAIL = 160  # px of the longer side, at most: enough to tell a palette
PALETTE = "Its colours are a palette: how a person stands out in them is not known."
TOO_SMALL = "A person would be too small in it to be measured in a picture so large."
MESH = 12  # columns and rows over which a picture is laid on another
MOST_FRAMES = 20_000  # measured; 15 KB each
RETRY_S = 10.0  # until a frame is tried again that a passing trouble kept from being measured
RETRY_REST = 10.0  # or so many times as long as trying it took, if that is longer
_Key = tuple[int, str | None]  # a frame's number and content


@dataclass(frozen=True, slots=True)
class MeasuredFrame:
    """`differs`: from the look before it, on the grid of `ground`; None where there is none. `ground` is None, and `trouble`
    a sentence, of a picture that could not be measured."""

    ground: GroundStatistics | None
    differs: Array | None
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class _Remembered:
    picture: FilteredPicture
    painted: RenderItem
    per_painted: float  # pixels of the original per pixel of the picture that was stitched


class MeasuredFrames:
    """Measures the islands that are wanted, at its own pace; thread-safe. `side_units`: of the person, canvas units."""

    def __init__(self, view: FlightView, side_units: float) -> None:
        self._view, self._side = view, side_units
        self._lock = threading.Lock()
        self._known: dict[_Key, MeasuredFrame] = {}
        self._put_off: dict[_Key, tuple[float, str]] = {}  # when to try again, in monotonic seconds, and why
        self._remembered: OrderedDict[int, _Remembered] = OrderedDict()
        self._wanted: frozenset[int] = frozenset()

    def want(self, island: int) -> None:
        """Measure its frames, too."""
        self._wanted |= {island}

    @property
    def count(self) -> int:
        """Of the measured frames."""
        return len(self._known)

    def of(self, frame: PositionRecord) -> MeasuredFrame | None:
        """None while it is not measured."""
        return self._known.get(_key(frame))

    def put_off(self, frame: PositionRecord) -> str:
        """Why it is not measured yet, but will be tried again; empty if nothing keeps it from being measured."""
        return self._put_off.get(_key(frame), (0.0, ""))[1]

    def waiting(self) -> list[PositionRecord]:
        """The painted frames of wanted islands that are not measured, in the order in which they were taken."""
        frames = [one for one in self._view.table().frames if one.island in self._wanted and self.of(one) is None]
        return sorted(frames, key=lambda one: (one.island, one.order)) if len(self._known) < MOST_FRAMES else []

    def step(self) -> bool:
        """Measure a frame; False if there is none to be measured now."""
        with self._lock:
            began = monotonic()
            due = (one for one in self.waiting() if self._put_off.get(_key(one), (began, ""))[0] <= began)
            frame = next(due, None)
            if frame is None:
                return False
            try:
                self._known[_key(frame)] = self._measured_or_why_not(frame)
                self._put_off.pop(_key(frame), None)
            except (NoPicture, UsageError) as reason:  # it passes
                logger.info("frame %d is measured later: %s", frame.number, reason)
                now = monotonic()
                self._put_off[_key(frame)] = now + max(RETRY_S, RETRY_REST * (now - began)), str(reason)
            return True

    def _measured_or_why_not(self, frame: PositionRecord) -> MeasuredFrame:
        """Raises NoPicture for what passes, and UsageError while the ledger cannot be read."""
        try:
            return self._measured(frame)
        except NoPicture as reason:
            if reason.passing:
                raise
            return MeasuredFrame(None, None, str(reason))
        except UsageError:
            raise
        except Exception:  # one frame must not end the measuring of the others
            logger.exception("frame %d cannot be measured", frame.number)
            return MeasuredFrame(None, None, "It could not be measured.")

    def forget_pictures(self) -> None:
        """Those with which the next ones would be compared: nobody is asking."""
        with self._lock:
            self._remembered.clear()

    def _measured(self, frame: PositionRecord) -> MeasuredFrame:
        """Raises NoPicture and UsageError."""
        record, painted = self._view.frame(frame.number), self._view.painted(frame.number)
        if record is None or painted is None:
            raise NoPicture("It is not on the map any more.", passing=True)  # nor in the next table
        if not record.width:
            raise NoPicture(f"The original of {record.name} is not kept.")
        per_painted = record.width / painted.camera.width
        side_px = self._side / np.exp(painted.pose.log_gsd) * per_painted
        scale = analysed_scale(record.width, record.height or 0, side_px)
        if scale < 1 and scale * side_px < 1:
            raise NoPicture(TOO_SMALL)
        reduction = max(each for each in REDUCTIONS if each == 1 or scale * each <= 1)
        shown = displayed(self._view, frame.number, reduction)
        if is_false_colour(_thumbnail(shown)):
            raise NoPicture(PALETTE)
        picture = filtered(shown, side_px / reduction)
        picture = replace(picture, scale=picture.scale / reduction)
        ground = statistics(picture)
        if ground.is_grey:  # it states nothing, and no other is to be compared with it
            return MeasuredFrame(ground, None)
        lightness = np.ascontiguousarray(picture.local[..., :1])  # all that looks are compared by
        own = _Remembered(replace(picture, means=lightness, local=lightness), painted, per_painted)
        differs = self._differs(own, ground)
        self._remembered[frame.number] = own
        while len(self._remembered) > REMEMBERED:
            self._remembered.popitem(last=False)
        return MeasuredFrame(ground, differs)

    def _differs(self, own: _Remembered, ground: GroundStatistics) -> Array | None:
        """From what the last pictures show there, the newest first."""
        step, found = round(ground.step_px * own.picture.scale), None
        for other in reversed(self._remembered.values()):
            if other.painted.island != own.painted.island:
                continue
            told = disagreement(own.picture, other.picture, _laid_on(own, other), step)
            found = told if found is None else np.where(np.isfinite(found), found, told)
        return found


def _key(frame: PositionRecord) -> _Key:
    return frame.number, frame.content_hash


def _thumbnail(picture: ImageBGR) -> ImageBGR:
    height, width = picture.shape[:2]
    scale = min(1.0, THUMBNAIL / max(width, height))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _laid_on(one: _Remembered, other: _Remembered) -> FloatImage:
    """For a coarse mesh over a picture the pixels (MESH, MESH, 2) of another's analysed one."""
    camera = one.painted.camera
    x, y = np.meshgrid(np.linspace(0, camera.width - 1, MESH), np.linspace(0, camera.height - 1, MESH))
    places = places_of(one.painted, np.stack([x, y], axis=-1).reshape(-1, 2))
    there = (pixels_of(other.painted, places) + 0.5) * other.per_painted * other.picture.scale - 0.5
    return np.nan_to_num(there, nan=-1e6).clip(-1e6, 1e6).reshape(MESH, MESH, 2).astype(np.float32)

"""Large originals in pieces, so that the place that was asked for is sharp before the whole has come."""

from __future__ import annotations

import threading
import time

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import QUALITY, NoPicture, displayed, original

SIDE = 512  # px of a piece
KEPT_S = 30.0  # a decoded picture takes 3 bytes a pixel: as long as somebody looks about in it


class PictureTiles:
    """Pieces of originals at their full resolution; keeps the picture that was asked for last. For several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: tuple[str, ImageBGR] | None = None  # see `Original.shown_as`
        self._asked = 0.0

    def piece(self, view: FlightView, number: int, column: int, row: int) -> bytes:
        """A JPEG of at most SIDE x SIDE px, counted from the top left. Raises NoPicture."""
        image = self._picture(view, number)
        piece = image[row * SIDE : (row + 1) * SIDE, column * SIDE : (column + 1) * SIDE]
        return _jpeg(piece)

    def crop(self, view: FlightView, number: int, x: float, y: float, side: int) -> bytes:
        """A JPEG of the square of `side` px about a pixel of the original, moved to lie within it. Raises NoPicture."""
        image = self._picture(view, number)
        height, width = image.shape[:2]
        left, top = (min(max(round(at) - side // 2, 0), max(size - side, 0)) for at, size in ((x, width), (y, height)))
        return _jpeg(image[top : top + side, left : left + side])

    def forget(self) -> None:
        """Let go of the kept picture if nobody has asked for it lately."""
        with self._lock:
            if time.monotonic() - self._asked >= KEPT_S:
                self._kept = None

    def _picture(self, view: FlightView, number: int) -> ImageBGR:
        shown_as = original(view, number).shown_as
        with self._lock:  # others wait: two decoded at a time would be twice the memory
            self._asked = time.monotonic()
            if self._kept is None or self._kept[0] != shown_as:
                self._kept = None
                self._kept = shown_as, displayed(view, number, 1)
            return self._kept[1]


def _jpeg(piece: ImageBGR) -> bytes:
    if not piece.size:
        raise NoPicture("The frame does not reach there.")
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(piece), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise NoPicture("This piece cannot be encoded.")
    return data.tobytes()

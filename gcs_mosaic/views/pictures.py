"""Originals as a browser can show them."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.display import PLAIN, Display
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.originals import place_of
from gcs_mosaic.views.flight_view import FlightView

if TYPE_CHECKING:
    from gcs_mosaic.store.records import FrameRecord

REDUCTIONS = (1, 2, 4)
QUALITY = 92
# What every browser shows at its true colours: files that begin so, of three bands at 8 bits.
_AS_THEY_ARE = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG\r\n\x1a\n": "image/png"}


class NoPicture(Exception):  # noqa: N818 -- an answer, not an error
    """Why there is none, in a sentence for whoever asked; `passing`: by the machine or the moment, so ask again."""

    def __init__(self, reason: str, *, passing: bool = False) -> None:
        super().__init__(reason)
        self.passing = passing


@dataclass(frozen=True, slots=True)
class Original:
    """A kept original: its file, what it is called, and what tells it from another."""

    path: Path
    name: str
    media_type: str | None  # None: of a kind that browsers do not show
    content_hash: str
    display: Display | None  # None: it was never painted
    record: FrameRecord

    @property
    def shown_as(self) -> str:
        """What tells one picture of it from another: a camera's range of counts may be fitted again."""
        look = "" if self.display in (None, PLAIN) else f"-{zlib.crc32(repr(self.display).encode()):08x}"
        return self.content_hash + look


def original(view: FlightView, number: int) -> Original:
    """A frame's original. Raises NoPicture."""
    try:
        frame, display = view.frame(number), view.display(number)
    except UsageError as error:
        raise NoPicture("There is no flight here yet.", passing=True) from error
    if frame is None:
        raise NoPicture("There is no such frame.")
    if frame.original is None or frame.content_hash is None or frame.width is None:
        raise NoPicture(f"The original of {frame.name} is not kept.")
    path = place_of(view.root, frame.original) or view.root
    try:
        with inside.reading(path, view.root) as file:
            head = file.read(8)
    except OSError as error:
        # With its ledger beside it the file alone is gone; else a share is away, or a disk.
        is_gone = isinstance(error, FileNotFoundError) and inside.is_file(view.root / LEDGER_NAME, view.root)
        raise NoPicture(f"The original of {frame.name} is not there any more.", passing=not is_gone) from None
    kinds = [kind for magic, kind in _AS_THEY_ARE.items() if head.startswith(magic)]
    return Original(path, frame.name, kinds[0] if kinds else None, frame.content_hash, display, frame)


def picture(view: FlightView, number: int, reduction: int) -> tuple[bytes, str]:
    """A JPEG of what `displayed` gives, and its media type. Raises NoPicture."""
    done, data = cv2.imencode(".jpg", displayed(view, number, reduction), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise NoPicture("This frame cannot be encoded.")
    return data.tobytes(), "image/jpeg"


def displayed(view: FlightView, number: int, reduction: int) -> ImageBGR:
    """A frame as it is displayed on the map, (h, w, 3), reduced 1, 2 or 4 times. Raises NoPicture.

    Frames that were never painted are shown as they are, if they have three bands at 8 bits.
    """
    from gcs_mosaic.frames.decode import Unreadable  # only once somebody asks
    from gcs_mosaic.views.decoding import original_pixels

    source = original(view, number)
    image = original_pixels(view, source.record, reduction)
    if isinstance(image, Unreadable):
        raise NoPicture(f"{source.name} cannot be shown: {image.reason}.", passing=image.passing)
    display = source.display or PLAIN
    if not display.fits(image):
        raise NoPicture(f"{source.name} was never painted, so how its bands are to be shown is not known.")
    return np.ascontiguousarray(display.lightened(display.picture(image)))


def is_shown_as_it_is(source: Original) -> bool:
    """Whether a browser shows the file itself as the map shows it."""
    return source.media_type is not None and source.display in (None, PLAIN)

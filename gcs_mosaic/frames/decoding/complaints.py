"""What C libraries say of a picture on standard error, where it is the only sign that a JPEG ends before its picture does.

libjpeg fills what is missing with grey and returns as if nothing had happened, but it says so. Its word alone is not enough:
some cameras leave out the last bits of every picture, and one wrong bit makes the rest come out short.
"""

from __future__ import annotations

import os
import tempfile

from gcs_mosaic.frames.decode import ends_early, share_missing
from gcs_mosaic.frames.jpeg import jpeg_picture
from gcs_mosaic.frames.jpeg_mend import NOTHING_CAME
from gcs_mosaic.frames.structure import Whole, image_start
from gcs_mosaic.stitch.arrays import Bands

MOST_BYTES = 4000  # kept of what is said of one picture
LEAST_LOST = 0.02  # share of a picture's rows; less may be a camera's habit
_SHORT = ("premature end of data", "found marker 0xd9 instead of")  # in libjpeg's words; it says the first trouble only


class Complaints:
    """Catches what this process' libraries print, from now on."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - for as long as the process lives
        for printed_to in (1, 2):
            os.dup2(self._file.fileno(), printed_to)

    def take(self) -> str:
        """What was said since it was asked last."""
        self._file.seek(0)
        said = self._file.read(MOST_BYTES)
        self._file.seek(0)
        self._file.truncate()
        return said.decode(errors="replace").strip()


def cut_short(data: bytes, whole: Whole, image: Bands, said: str, reduction: int = 1) -> str | None:
    """Why a decoded JPEG is not a whole picture, None if it is. `said`: by the decoder."""
    if not any(words in said for words in _SHORT) or (image_start(data) or ("", 0))[0] != "jpeg":
        return None
    lost = _rows_without_data(image) / image.shape[0]
    if _is_progressive(data):  # what is missing is blurred then, not grey
        lost = max(lost, share_missing(data, whole, image, reduction))
    return None if lost < LEAST_LOST else f"damaged: {ends_early(lost, whole.height)}"


def _is_progressive(data: bytes) -> bool:
    frame = jpeg_picture(data).frame
    return frame is not None and frame.is_progressive


def _rows_without_data(image: Bands) -> int:
    """At the end of the picture."""
    grey = (image == NOTHING_CAME).reshape(image.shape[0], -1).all(axis=1)
    return int(grey[::-1].cumprod().sum())

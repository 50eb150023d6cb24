"""Whether files of which more may come are whole: by decoding them, as the flight will.

What decodes is loaded when the first such file is there: most flights have none, and links are to be heard at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs_mosaic.frames.decoding.limits import DecodeSettings
from gcs_mosaic.frames.integrity import MAX_PIXELS

if TYPE_CHECKING:
    from gcs_mosaic.frames.decode import Unreadable
    from gcs_mosaic.frames.decoding.decoders import Decoders
    from gcs_mosaic.messages import Frame
    from gcs_mosaic.stitch.arrays import Bands


class Proof:
    """In a process of its own. A `pending_file.Prove`, for one thread."""

    def __init__(self, settings: DecodeSettings | None = None, max_pixels: int = MAX_PIXELS) -> None:
        self._settings, self._max_pixels = settings, max_pixels
        self._decoders: Decoders | None = None

    def __call__(self, data: bytes, content_hash: str) -> str | None:
        from gcs_mosaic.frames.decode import Unreadable

        found = self._started().decode(data, content_hash)
        # What is not by the file itself is told when the flight decodes it.
        return found.reason if isinstance(found, Unreadable) and not found.passing else None

    def load(self, frame: Frame) -> Bands | Unreadable:
        """The pixels of a frame's file."""
        return self._started().load_frame(frame)

    def _started(self) -> Decoders:
        from gcs_mosaic.frames.decoding.decoders import Decoders

        if self._decoders is None:
            self._decoders = Decoders(self._settings, self._max_pixels, processes=1)
        return self._decoders

    def close(self) -> None:
        """End the process."""
        if self._decoders is not None:
            self._decoders.close()


def decodes_here(data: bytes, content_hash: str) -> str | None:
    """The same without a process, for files that can be trusted."""
    from gcs_mosaic.frames.decode import Unreadable, decode_image

    found = decode_image(data)
    return found.reason if isinstance(found, Unreadable) else None


def loads_here(frame: Frame) -> Bands | Unreadable:
    """The pixels of such a frame's file, without a process."""
    from gcs_mosaic.frames.decode import load_frame

    return load_frame(frame)

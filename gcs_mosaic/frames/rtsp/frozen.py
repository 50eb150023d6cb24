"""Whether a stream brings pictures and yet shows nothing new: a camera, or an encoder, that is frozen."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

TOLD_AFTER_S = 20.0
"""A thermal camera that closes its shutter to calibrate shows the same picture for a second or two; an encoder needs five seconds
until a picture that stands changes no more."""
MOST_LEVELS = 0.65
"""By so much of 256 levels may averages of 8 x 8 px change. Over 20 s of H.264, 1.5 and 8 Mbit/s and by quality, the largest
change of a frozen picture is 0.1 to 0.6; of a camera that stands, with noise of 1 level, 0.7 to 1.2; of one that sways by 0.2 px,
1.7 to 6. At 1 Mbit/s each key frame changes a frozen picture by 1.5: it is not told, for a camera that stands looks the same."""
_LOOK_S = 0.5
_FEWEST = 10  # pictures: a slow stream has to show as many
_BLOCK, _MOST_LOOKED_AT = 8, 1920  # px; of a larger picture every second pixel, or fewer


class SamePicture:
    """Since when the picture is the same. It looks at two pictures a second, which takes 1 ms each at 1080p."""

    def __init__(self) -> None:
        self._blocks: NDArray[np.float32] | None = None  # of the picture that later ones are compared with
        self._since = self._last = self._looked = -np.inf
        self._pictures = 0

    @property
    def since(self) -> float | None:
        """On the clock that `note` is given; None: the picture changes, or has not been the same for long."""
        is_long = self._last - self._since >= TOLD_AFTER_S and self._pictures >= _FEWEST
        return self._since if is_long else None

    def note(self, luma: NDArray[np.uint8], now: float) -> None:
        """The newest picture, (height, width), at `now` in seconds."""
        self._pictures += 1
        self._last = now
        if now - self._looked < _LOOK_S:
            return
        self._looked = now
        each = -(-max(luma.shape) // _MOST_LOOKED_AT)
        luma = luma[::each, ::each]
        size = (max(1, luma.shape[1] // _BLOCK), max(1, luma.shape[0] // _BLOCK))
        blocks = np.asarray(cv2.resize(luma.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)
        if self._blocks is None or self._has_changed(self._blocks, blocks):
            self._blocks, self._since, self._pictures = blocks, now, 0

    def _has_changed(self, before: NDArray[np.float32], blocks: NDArray[np.float32]) -> bool:
        return before.shape != blocks.shape or float(np.abs(blocks - before).max()) > MOST_LEVELS

"""Lenses that somebody looks through, kept in memory while he moves the focus; and the picture of one as it is shown."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gcs_mosaic.integral.aperture import SyntheticAperture
from gcs_mosaic.integral.focus import Focus
from gcs_mosaic.integral.forms import FORMS
from gcs_mosaic.integral.ground_lens import GroundLens, ground_lens
from gcs_mosaic.integral.ground_surface import GroundSurface
from gcs_mosaic.integral.hot_places import HotPlace, found_in
from gcs_mosaic.stitch.arrays import AnyImage, FloatImage
from gcs_mosaic.views.flight_view import FlightView

MOST_LOOKS = 30  # of a lens: of 400 px in colour they take 100 MB
MOST_LENSES = 2
BESIDE_S = (
    4.0  # that the ground is sought around a place where it is not seen; what is found serves the next places, too
)
KEPT_S = 90.0  # after somebody has looked through it last
# Shares of pixels that a picture of one band, or of a deviation, lets be black and white: a hot spot of a few pixels is to stay
# brighter than what is around it.
BLACK, WHITE = 0.005, 0.999


@dataclass(frozen=True, slots=True, kw_only=True)
class LensWish:
    """What is to be seen. `side`: canvas units, None: as fine as the frames; `height`: share of the flying height, None: it is
    sought; `opened`: the aperture's share; `hints`: how many places that stand out; `unit_m`: metres of a canvas unit, if
    somebody knows them."""

    island: int
    x: float
    y: float
    side: float | None = None
    cells: int = 360
    height: float | None = None
    opened: float = 1.0
    form: str = "mean"
    hints: int = 0
    unit_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LensView:
    """What a lens shows. `focus` is what was sought when it was opened, whatever the height is now."""

    lens: GroundLens
    focus: Focus
    height: float
    aperture: SyntheticAperture
    values: FloatImage
    hints: Sequence[HotPlace]


class LensKeeper:
    """For one thread. A lens is opened anew by whoever asks for a place without saying a height. `beside_s`: that the ground is
    sought around a place where it is not seen; what is found serves the next places, too."""

    def __init__(self, view: FlightView, beside_s: float = BESIDE_S) -> None:
        self._view, self._beside_s = view, beside_s
        self._ground = GroundSurface(view)
        self._open: dict[LensWish, tuple[float, GroundLens, Focus]] = {}

    def look(self, wish: LensWish) -> LensView:
        """Raises UsageError where there is nothing to be shown."""
        lens, focus = self._opened(wish)
        height = focus.height if wish.height is None else wish.height
        aperture = lens.aperture(height, wish.opened)
        values = FORMS[wish.form](lens.stack(height, wish.opened))
        guess = focus.guess if wish.height is None else None
        is_dark = wish.form == "min"
        hints = (
            found_in(lens, height, wish.opened, wish.hints, wish.unit_m, guess, is_dark=is_dark) if wish.hints else ()
        )
        return LensView(lens=lens, focus=focus, height=height, aperture=aperture, values=values, hints=hints)

    def forget(self, now: float | None = None) -> None:
        """Those that nobody has looked through for a while."""
        now = time.monotonic() if now is None else now
        self._open = {key: one for key, one in self._open.items() if now - one[0] < KEPT_S}
        if not self._open:
            self._ground.forget()

    def _opened(self, wish: LensWish) -> tuple[GroundLens, Focus]:
        key = replace(wish, height=None, opened=1.0, form="mean", hints=0, unit_m=None)
        known = None if wish.height is None else self._open.get(key)
        if known is None:
            self._open.pop(key, None)
            while len(self._open) >= MOST_LENSES:
                self._open.pop(min(self._open, key=lambda one: self._open[one][0]))
            lens = ground_lens(self._view, wish.island, (wish.x, wish.y), wish.cells, wish.side, MOST_LOOKS)
            lens.aperture(0.0 if wish.height is None else wish.height)  # says it where looks do not overlap
            known = (0.0, lens, self._ground.focus_of(wish.island, lens, self._beside_s))
        _, lens, focus = known
        self._open[key] = time.monotonic(), lens, focus
        return lens, focus


def shown(values: FloatImage, *, stretched: bool) -> AnyImage:
    """8 bits (h, w, bands) of an integral; black where it is not known. Colour keeps its levels if it is not `stretched`."""
    known = values[np.isfinite(values)]
    if not known.size:
        return np.zeros(values.shape, np.uint8)
    low, high = (0.0, 255.0)
    if stretched or values.shape[2] == 1:
        low, high = (float(one) for one in np.quantile(known, (BLACK, WHITE)))
    levels = (np.nan_to_num(values, nan=low) - low) * (255 / max(high - low, 1e-3))
    return np.asarray(np.clip(levels + 0.5, 0, 255).astype(np.uint8))


def as_jpeg(view: LensView, form: str) -> bytes:
    """As a browser shows it."""
    _, data = cv2.imencode(".jpg", shown(view.values, stretched=form == "deviation"), [cv2.IMWRITE_JPEG_QUALITY, 90])
    return data.tobytes()

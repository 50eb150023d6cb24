"""Error against frame number as a picture: one panel for a flight, one curve for a way of placing its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.debug.sheet import FAINT, INK, PAPER, Colour, Sheet, nice_length
from gcs_mosaic.stitch.arrays import ImageBGR

Array = NDArray[np.float64]

WIDTH, HEIGHT = 600, 400  # px of a panel
LEFT, RIGHT, TOP, BOTTOM = 66, 26, 84, 46  # px around its axes
COLOURS: tuple[Colour, ...] = (
    (70, 80, 220),
    (150, 110, 20),
    (60, 150, 60),
    (40, 150, 220),
)  # one for each curve: at most four
X_STEPS = 6  # at most so many numbers along the frames


@dataclass(frozen=True, slots=True)
class Curve:
    """RMS error (n,) in pixels of each frame in order, NaN where it was not placed."""

    label: str
    errors_px: Array


@dataclass(frozen=True, slots=True)
class Panel:
    """A flight; all curves over the same frames."""

    title: str
    curves: Sequence[Curve]


def draw_errors(panels: Sequence[Panel]) -> ImageBGR:
    """The panels side by side; errors on a logarithmic scale that is the same for all."""
    errors = np.concatenate([curve.errors_px for panel in panels for curve in panel.curves])
    known = errors[np.isfinite(errors) & (errors > 0)]
    axis = _LogAxis(float(known.min()), float(known.max()))
    sheet = Sheet(WIDTH * len(panels), HEIGHT)
    for number, panel in enumerate(panels):
        _draw_panel(sheet, WIDTH * number, panel, axis)
    return sheet.picture()


class _LogAxis:
    """From whole decade to whole decade."""

    def __init__(self, least: float, largest: float) -> None:
        self.first, self.last = int(np.floor(np.log10(least))), int(np.ceil(np.log10(largest)))
        self.last = max(self.last, self.first + 1)

    def at(self, values: Array) -> Array:
        """Pixels down the sheet (n,)."""
        with np.errstate(divide="ignore"):
            share = (np.log10(values) - self.first) / (self.last - self.first)
        return HEIGHT - BOTTOM - np.clip(share, 0, 1) * (HEIGHT - TOP - BOTTOM)


def _draw_panel(sheet: Sheet, x: int, panel: Panel, axis: _LogAxis) -> None:
    left, right = x + LEFT, x + WIDTH - RIGHT
    count = max(len(curve.errors_px) for curve in panel.curves)
    sheet.words((left, 28), panel.title, size=17)
    for decade in range(axis.first, axis.last + 1):
        y = float(axis.at(np.array([10.0**decade]))[0])
        sheet.lines(np.array([[left, y], [right, y]]), FAINT, 0.8)
        sheet.words((left - 8, y + 5), f"{10.0**decade:g}", INK, 13, "right")
    step = int(max(1, nice_length(2 * count / X_STEPS)))
    for frame in range(0, count + 1, step):
        place = left + frame / count * (right - left)
        sheet.lines(np.array([[place, HEIGHT - BOTTOM], [place, HEIGHT - BOTTOM + 5]]), INK, 0.8)
        sheet.words((place, HEIGHT - BOTTOM + 20), str(frame), INK, 13, "middle")
    sheet.words(((left + right) / 2, HEIGHT - 8), "frame", INK, 13, "middle")
    sheet.words((x + 10, TOP - 14), "px", INK, 13)
    for number, (curve, colour) in enumerate(zip(panel.curves, COLOURS, strict=False)):
        frames = left + (np.arange(len(curve.errors_px)) + 0.5) / count * (right - left)
        sheet.lines(np.column_stack([frames, axis.at(curve.errors_px)]), colour, 1.4)
        across, down = number % 2 * (right - left) / 2, number // 2 * 18
        sheet.words((left + across, 52 + down), _said(curve), colour, 13, halo=PAPER)


def _said(curve: Curve) -> str:
    placed = curve.errors_px[np.isfinite(curve.errors_px)]
    missing = len(curve.errors_px) - len(placed)
    rmse = float(np.sqrt((placed**2).mean())) if len(placed) else float("nan")
    return f"{curve.label}: {rmse:.1f} px" + (f", {missing} not placed" if missing else "")

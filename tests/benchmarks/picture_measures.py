"""How good a map looks, in numbers: detail, steps across seams, people who are half there, small things that are lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Field = NDArray[np.float32]
Colours = NDArray[Any]  # (h, w, 3) BGR, grey levels of 255

DETAIL_SIGMA = 2.0  # px; what a Gaussian of this width takes away, wavelengths below about 12 px, is detail
DARK = 48.0  # grey levels; below it contrast is told against this: in deep shadow it is the sensor's noise that has most of it
CELL = 32  # px: the best frame is chosen for squares of this side
SIDE = 8  # px from a seam on either side, where the two brightnesses are taken
LOW_PASS = 4.0  # px, deviation of the Gaussian over which a brightness is taken: grass and grain are gone
ALIKE = 17  # px over which a map is compared with the frames to tell whose pixels it shows
HALF_SHOWN = 0.1, 0.9  # share of a target's own contrast: between these it is neither there nor away
TRANSPARENT = 0.25, 0.75  # share of a pixel's own contrast: between these it is seen through, outside it is cut off


@dataclass(frozen=True, slots=True)
class Detail:
    """Energy of the detail, by cell (n,): of the map; of the frame that sees the cell most centrally; and of the sharpest one
    (with most detail in the cells around), each alone on the same grid. Frames differ: some are blurred by motion."""

    of_map: NDArray[np.float64]
    of_central: NDArray[np.float64]
    of_sharpest: NDArray[np.float64]

    @property
    def kept(self) -> float:
        """Of the most central frame's, over all cells together."""
        return _ratio(self.of_map, self.of_central)

    @property
    def kept_of_sharpest(self) -> float:
        """Of the sharpest frame's, over all cells together."""
        return _ratio(self.of_map, self.of_sharpest)


def all_detail(parts: Sequence[Detail]) -> Detail:
    return Detail(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("of_map", "of_central", "of_sharpest"))
    )


def detail(mosaic: Colours, frames: Sequence[Colours], covered: Sequence[Mask], weights: Sequence[Field]) -> Detail:
    """Detail of a map (h, w, 3) where two frames or more overlap. covered, weights: (h, w) of each frame; the one of
    greatest weight sees a place most centrally."""
    inside = np.stack([_cells(mask.astype(np.float32)) == 1 for mask in covered])
    weight = np.stack([_cells(one) for one in weights])
    energy = np.stack([_cells(energy_of_detail(frame)) for frame in frames])
    around = np.stack([cv2.blur(one, (3, 3)) for one in energy])
    central, sharpest = (
        np.take_along_axis(energy, np.where(inside, by, -1).argmax(axis=0)[None], axis=0)[0] for by in (weight, around)
    )
    overlap = (inside.sum(axis=0) >= 2) & (central > 0)
    of_map = _cells(energy_of_detail(mosaic))
    return Detail(*(one[overlap].astype(np.float64) for one in (of_map, central, sharpest)))


def energy_of_detail(picture: Colours) -> Field:
    """(h, w): the square of what blurring takes from each grey pixel, relative to the brightness around it: a picture that
    is darker as a whole is not less sharp."""
    grey = _grey(picture)
    blurred = cv2.GaussianBlur(grey, (0, 0), DETAIL_SIGMA)
    return np.asarray(((grey - blurred) / np.maximum(blurred, DARK)) ** 2, np.float32)


def seam_steps(mosaic: Colours, frames: Sequence[Colours], covered: Sequence[Mask]) -> NDArray[np.float64]:
    """(n,) grey levels: the step in brightness at each place where the frame that the map shows most of changes.

    The brightness on one side less that on the other, less what the ground itself does there (as the two frames see it).
    A soft blend has such places too, but little of a step within 2 * SIDE pixels.
    """
    if len(frames) < 2:
        return np.empty(0)
    whose = _whose(mosaic, frames, covered)
    smooth = np.stack([_low_pass(frame) for frame in frames])
    usable = np.stack([_eroded(mask, SIDE + round(2 * LOW_PASS)) for mask in covered])
    low = _low_pass(mosaic)
    across = _steps_to_the_right(whose, low, smooth, usable)
    down = _steps_to_the_right(whose.T, low.T, smooth.swapaxes(1, 2), usable.swapaxes(1, 2))
    return np.concatenate([across, down])


def _steps_to_the_right(whose: NDArray[np.intp], mosaic: Field, frames: Field, usable: Mask) -> NDArray[np.float64]:
    width = whose.shape[1]
    left, right = whose[:, SIDE - 1 : width - SIDE - 1], whose[:, SIDE : width - SIDE]
    crossing = left != right
    for k in range(SIDE):  # one frame all the way on either side: elsewhere two frames look the same
        crossing = crossing & (whose[:, k : width - 2 * SIDE + k] == left)
        crossing = crossing & (whose[:, SIDE + k : width - SIDE + k] == right)
    rows, columns = np.nonzero(crossing)
    i, j = left[rows, columns], right[rows, columns]
    a, b = (rows, columns), (rows, columns + 2 * SIDE - 1)
    both = np.logical_and.reduce([usable[frame, at[0], at[1]] for frame in (i, j) for at in (a, b)])
    ground = sum(frames[frame, b[0], b[1]] - frames[frame, a[0], a[1]] for frame in (i, j)) / 2
    return np.asarray(np.abs(mosaic[b] - mosaic[a] - ground)[both], np.float64)


def _whose(mosaic: Colours, frames: Sequence[Colours], covered: Sequence[Mask]) -> NDArray[np.intp]:
    """(h, w): the frame that the map looks most like around each place."""
    apart = []
    for frame, mask in zip(frames, covered, strict=True):
        off = np.abs(mosaic.astype(np.float32) - frame).mean(axis=2)
        apart.append(cv2.blur(np.where(mask, off, np.float32(1e4)).astype(np.float32), (ALIKE, ALIKE)))
    return np.asarray(np.stack(apart).argmin(axis=0), np.intp)


def shown_share(mosaic: Colours, frame: Colours, bare: Colours) -> float:
    """How much of a target's own contrast the map shows: 1 all of it, 0 nothing.

    frame: the one that saw it, alone on the same grid; bare: the same without the target. What is as bright or dark all
    over the window is no part of it.
    """
    signature = _signature(frame, bare)
    centred = signature - signature.mean(axis=(0, 1))
    off = mosaic.astype(np.float32) - bare
    return float((off * centred).sum() / (signature * centred).sum())


def transparent_share(mosaic: Colours, frame: Colours, bare: Colours) -> float:
    """The share of a target's pixels through which the ground is seen; a target that is cut in two has none."""
    signature = _signature(frame, bare)
    strength = (signature**2).sum(axis=2)
    core = strength > strength.max() / 2
    off = mosaic.astype(np.float32) - bare
    around = strength < strength.max() / 100
    off = off - np.median(off[around], axis=0) if around.any() else off
    share = (off * signature).sum(axis=2)[core] / strength[core]
    return float(((share > TRANSPARENT[0]) & (share < TRANSPARENT[1])).mean())


def _signature(frame: Colours, bare: Colours) -> Field:
    return np.asarray(frame.astype(np.float32) - bare, np.float32)


def contrast(picture: Colours, middle: tuple[float, float], radius: float) -> NDArray[np.float64]:
    """(3,) by channel: how much a small thing at `middle` (x, y) px stands out, relative to what is around it, so that no
    gain changes it. radius: px, within which all is the thing itself; around it is taken from 3 to 5 times as far."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    away = np.hypot(x - middle[0], y - middle[1])
    core = picture[away <= radius].mean(axis=0)
    around = picture[(away >= 3 * radius) & (away <= 5 * radius)].mean(axis=0)
    return np.asarray(core / np.maximum(around, 1) - 1, np.float64)


def contrast_kept(of_map: NDArray[np.float64], of_frame: NDArray[np.float64]) -> float:
    """In the channel in which the frame shows the thing best."""
    strongest = int(np.abs(of_frame).argmax())
    return float(of_map[strongest] / of_frame[strongest])


def _ratio(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    return float(one.sum() / other.sum()) if other.sum() else float("nan")


def _grey(picture: Colours) -> Field:
    return np.asarray(picture.astype(np.float32).mean(axis=2), np.float32)


def _low_pass(picture: Colours) -> Field:
    return np.asarray(cv2.GaussianBlur(_grey(picture), (0, 0), LOW_PASS), np.float32)


def _eroded(mask: Mask, by: int) -> Mask:
    kernel = np.ones((2 * by + 1, 2 * by + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), kernel, borderType=cv2.BORDER_REPLICATE) > 0)


def _cells(values: Field) -> Field:
    """Means over CELL x CELL squares; what is left over at the right and below is not counted."""
    height, width = (side // CELL * CELL for side in values.shape)
    squares = values[:height, :width].reshape(height // CELL, CELL, width // CELL, CELL)
    return np.asarray(squares.mean(axis=(1, 3)), np.float32)

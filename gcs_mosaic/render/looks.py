"""What a frame looks like, told once from its picture as it came and kept: gains and places may change without another look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.display import Display
from gcs_mosaic.render.painted import Painted
from gcs_mosaic.render.saliency import LEAST_CONTRAST, POOL, REACH, TALL, greatest_contrast, saliency
from gcs_mosaic.stitch.camera.dead_border import DeadBorder

Image = NDArray[np.uint8]
Map = NDArray[np.float16]  # half the memory; none needs more than three digits
Of = tuple[Display, DeadBorder]  # what of `Painted` a look depends on

# The size a frame is looked at: 6 px of a 12 MP frame are still 3.
LOOK_PIXELS = 3_000_000
AT_ONCE = 4  # channels that OpenCV samples together
# Pixels of the picture that a frame is looked at in: what is finer than the one is detail, told over squares of the other,
# which are so large that a thing, or noise, does not make a frame the sharper one.
DETAIL, DETAIL_AROUND = 5, 241
TONE_SHRINK = (
    8  # the size of a pixel of the maps of tone and detail, in pixels of the picture that a frame is looked at in
)
TONE_BLUR = 7  # pixels of that map, a side, that make a tone: so wide that no person changes it
LEAST_GROUND = 0.02  # what a thing counts for in a tone beside ground, which counts 1
BEYOND = 1.5  # times the contrast of anything around that a thing must have for the other frame not to have it
LEAST = 20  # in the contrasts kept here: those of L, a and b are scaled so that this is the least of each


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """Maps of all of a frame (rows, columns, ...), each of its own size.

    `planes`: uint8 in groups of four channels at most. `detail` (rows, columns): grey levels. `tone` (rows, columns, 4): the mean
    colour around (b, g, r), and how far things may colour it.
    """

    of: Of
    planes: tuple[Image, ...]
    detail: Map | None = None
    tone: Map | None = None

    @property
    def nbytes(self) -> int:
        return sum(one.nbytes for one in (*self.planes, self.detail, self.tone) if one is not None)

    def fits(self, painted: Painted) -> bool:
        return self.of == (painted.display, painted.dead)


def grouped_planes(planes: Sequence[Image]) -> tuple[Image, ...]:
    return tuple(np.dstack(planes[k : k + AT_ONCE]) for k in range(0, len(planes), AT_ONCE))


def contrasts(look: Image) -> list[Image]:
    """Planes a quarter as wide as the look: the contrasts of things, of anything near, of anything far, six ways each; those
    near and far as great as a thing may be that they are."""
    things, near, far = saliency(look)
    found: list[cv2.typing.MatLike] = []
    for maps, times in ((things, 1.0), (near, BEYOND), (far, BEYOND)):
        found += cv2.split(_in_least_ones(maps, times))
    return [np.asarray(one, np.uint8) for one in found]


def contrasts_around(sight: Sight, colours: slice, coarser: float) -> tuple[Image, ...]:
    """The contrasts of anything far in a frame that is looked at so many times as coarsely, as great as a thing may be that they
    are: planes in groups. `colours`: where the small look is among the planes."""
    planes = [one for group in sight.planes for one in cv2.split(group)][colours]
    reach = round((REACH + TALL) * coarser / POOL)
    found = _in_least_ones(greatest_contrast(np.dstack(planes).astype(np.uint8), reach), BEYOND)
    return grouped_planes([np.asarray(one, np.uint8) for one in cv2.split(found)])


def _in_least_ones(maps: NDArray[np.float32], times: float) -> Image:
    """Contrasts (h, w, `WAYS`) as they are kept."""
    return np.clip(np.rint(maps * (times * LEAST / LEAST_CONTRAST)), 0, 255).astype(np.uint8)


def small_look(look: Image, shape: tuple[int, ...]) -> list[Image]:
    """Its colours as three planes of a shape."""
    small = cv2.resize(look, shape[1::-1], interpolation=cv2.INTER_AREA)
    return [np.asarray(one, np.uint8) for one in cv2.split(small)]


def coarse_size(look: Image) -> tuple[int, int]:
    return max(1, look.shape[1] // TONE_SHRINK), max(1, look.shape[0] // TONE_SHRINK)


def detail_of(look: Image) -> Map:
    """How much detail there is around a place; the same ground has more of it in a sharper frame."""
    grey = cv2.cvtColor(look, cv2.COLOR_BGR2GRAY)
    fine = cv2.absdiff(grey, cv2.blur(grey, (DETAIL, DETAIL)))
    around = DETAIL_AROUND // TONE_SHRINK
    mean = cv2.resize(fine.astype(np.float32), coarse_size(look), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.blur(mean, (around, around)), dtype=np.float16)


def tone_of(look: Image, things: Sequence[Image]) -> Map:
    """The mean colour of the ground around a place, of things only where there is nothing else, and the log (base 2) of 1 and
    the greatest contrast of a thing, in the least ones."""
    size, box, side = coarse_size(look), (TONE_BLUR, TONE_BLUR), TONE_SHRINK * TONE_BLUR // POOL | 1
    small, contrast = cv2.resize(look, size, interpolation=cv2.INTER_AREA).astype(np.float32), np.max(things, axis=0)
    ground = cv2.resize((contrast == 0).astype(np.float32), size, interpolation=cv2.INTER_AREA) + np.float32(
        LEAST_GROUND
    )
    mean = cv2.blur(small * ground[..., None], box) / cv2.blur(ground, box)[..., None]
    greatest = cv2.dilate(contrast, np.ones((side, side), np.uint8))
    coloured = np.log2(1 + cv2.resize(greatest, size, interpolation=cv2.INTER_AREA) / np.float32(LEAST))
    return np.dstack([mean, coloured]).astype(np.float16)

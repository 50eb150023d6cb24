"""Look of a frame: maps computed once from its original image and kept; gains and places may change without another look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.display import Display
from gcs_mosaic.render.exposure import is_false_colour
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.saliency import LEAST_CONTRAST, POOL, REACH, TALL, greatest_contrast, saliency
from gcs_mosaic.stitch.arrays import ImageBGR, ImageGrey, Planes, PlaneStack
from gcs_mosaic.stitch.camera.dead_border import DeadBorder

Map = NDArray[np.float16]  # half the memory; three digits suffice
Of = tuple[Display, DeadBorder]  # the fields of `RenderItem` that a look depends on and that may change

# Size at which a frame is analysed: 6 px of a 12 MP frame are still 3.
LOOK_PIXELS = 3_000_000
AT_ONCE = 4  # channels that OpenCV samples together
# Pixels of the analysed image: structure finer than the first is detail, averaged over squares of the second, large enough that
# no single thing, or noise, makes a frame the sharper one.
DETAIL, DETAIL_AROUND = 5, 241
TONE_SHRINK = 8  # pixel size of the maps of tone and detail, in pixels of the analysed image
TONE_BLUR = 7  # pixels of that map, a side, averaged for a tone: so wide that no person changes it
LEAST_GROUND = 0.02  # weight of a thing in a tone relative to ground, which has 1
BEYOND = 1.5  # factor by which a thing's contrast must exceed all around it in the other frame to be missing there
# Grey levels beyond which, in all channels, light is clipped: another frame may show what is there.
CLIPPED_DARK, CLIPPED_BRIGHT = 2, 250
# Pixels of the analysed image: side of the squares over which the share of clipped ones is taken; size of what may be a vehicle;
# how far blown light glares.
CLIPPED_AROUND, VEHICLE, GLARE = 25, 120, 32
PATCH = 64  # of 255; share of clipped pixels that make a patch of light
MOST_LOST = 5  # of 255; share of clipped pixels around places of which detail is taken
LEAST_LIT = 0.1  # share of such places from which detail is told
LEAST = 20  # minimum contrast in the units kept here: L, a and b are each scaled to it


@dataclass(frozen=True, slots=True, eq=False)
class BlendMaps:
    """Maps over a whole frame (rows, columns, ...), each of its own size.

    `planes`: uint8 in groups of at most four channels. `detail` (rows, columns): grey levels. `tone` (rows, columns, 4): local
    mean colour (b, g, r), and how far things may affect it; None where tones are not to be shifted.
    """

    of: Of
    planes: tuple[PlaneStack, ...]
    detail: Map | None = None
    tone: Map | None = None

    @property
    def nbytes(self) -> int:
        return sum(one.nbytes for one in (*self.planes, self.detail, self.tone) if one is not None)

    def fits(self, painted: RenderItem) -> bool:
        return self.of == (painted.display, painted.dead)


def grouped_planes(planes: Sequence[ImageGrey]) -> tuple[PlaneStack, ...]:
    groups = [planes[k : k + AT_ONCE] for k in range(0, len(planes), AT_ONCE)]
    return tuple(np.asarray(cv2.merge(group), np.uint8).reshape(*group[0].shape, len(group)) for group in groups)


def contrasts(look: ImageBGR) -> list[ImageGrey]:
    """Contrast planes at a quarter of the look's width: of things, of anything near, of anything far, six kinds each; near and
    far scaled by BEYOND."""
    things, near, far = saliency(look)
    found: list[cv2.typing.MatLike] = []
    for maps, times in ((things, 1.0), (near, BEYOND), (far, BEYOND)):
        found += _in_least_ones(maps, times)
    return [np.asarray(one, np.uint8) for one in found]


def contrasts_around(maps: BlendMaps, colours: slice, coarser: float) -> tuple[PlaneStack, ...]:
    """Far contrasts of a frame at `coarser` times lower resolution, scaled by BEYOND: planes in groups. `colours`: position of
    the small look among the planes."""
    planes = [one for group in maps.planes for one in cv2.split(group)][colours]
    reach = round((REACH + TALL) * coarser / POOL)
    found = _in_least_ones(greatest_contrast(np.dstack(planes).astype(np.uint8), reach), BEYOND)
    return grouped_planes([np.asarray(one, np.uint8) for one in found])


def _in_least_ones(maps: Planes, times: float) -> list[cv2.typing.MatLike]:
    """Contrast planes in the units kept."""
    steps = np.arange(256, dtype=np.float32)[:, None]
    tables = np.clip(np.rint(steps * (times * LEAST / LEAST_CONTRAST)), 0, 255).astype(np.uint8)
    return [cv2.LUT(plane, tables[:, way]) for way, plane in enumerate(maps)]


def clipped(look: ImageBGR) -> tuple[ImageGrey, ImageGrey]:
    """255 where all channels are blown, and where all are black, else 0."""
    blown, black = (
        cv2.inRange(look, (CLIPPED_BRIGHT,) * 3, (255,) * 3),
        cv2.inRange(look, (0,) * 3, (CLIPPED_DARK,) * 3),
    )
    return np.asarray(blown, np.uint8), np.asarray(black, np.uint8)


def patches(unlit: ImageGrey, shape: tuple[int, ...], beside: int = 0) -> ImageGrey:
    """Share of pixels around that are `unlit`, of 255, as a plane of this shape, and the greatest one within `beside` px. None of
    what is no larger than a vehicle: that may be one."""
    share = cv2.resize(unlit, shape[1::-1], interpolation=cv2.INTER_AREA)
    share = np.asarray(cv2.blur(share, (CLIPPED_AROUND // POOL | 1,) * 2), np.uint8)
    if share.max(initial=0) < PATCH:
        return np.zeros_like(share)
    _, numbers, boxes, _ = cv2.connectedComponentsWithStats((share >= PATCH).astype(np.uint8), connectivity=8)
    large = np.maximum(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) > VEHICLE // POOL
    large[0] = False  # the ground
    share[~large[numbers]] = 0
    return np.asarray(cv2.dilate(share, np.ones((2 * (beside // POOL) + 1,) * 2, np.uint8)), np.uint8)


def small_look(look: ImageBGR, shape: tuple[int, ...]) -> list[ImageGrey]:
    """Its colours as three planes of this shape."""
    small = cv2.resize(look, shape[1::-1], interpolation=cv2.INTER_AREA)
    return [np.asarray(one, np.uint8) for one in cv2.split(small)]


def coarse_size(look: ImageBGR) -> tuple[int, int]:
    return max(1, look.shape[1] // TONE_SHRINK), max(1, look.shape[0] // TONE_SHRINK)


def detail_of(look: ImageBGR, unlit: ImageGrey) -> Map:
    """Local amount of detail; the same ground has more of it in a sharper frame. The edges and the glitter of what is clipped
    (`unlit`) are none of the ground's."""
    grey, size = cv2.cvtColor(look, cv2.COLOR_BGR2GRAY), coarse_size(look)
    box = (DETAIL_AROUND // TONE_SHRINK,) * 2
    fine = cv2.absdiff(grey, cv2.blur(grey, (DETAIL, DETAIL)))
    mean = cv2.resize(fine.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    lost = cv2.blur(cv2.resize(unlit, size, interpolation=cv2.INTER_AREA).astype(np.float32), (3, 3))
    lit = (lost <= MOST_LOST).astype(np.float32)
    share = cv2.blur(lit, box)
    return np.asarray(cv2.blur(mean * lit, box) / np.maximum(share, np.float32(LEAST_LIT)), dtype=np.float16)


def tone_of(look: ImageBGR, things: Sequence[ImageGrey]) -> Map | None:
    """Local mean colour of the ground (of things only where there is nothing else), and log2 of 1 + the greatest contrast of a
    thing, in units of the minimum. None of a palette's colours: a shift would make another temperature of them."""
    size, box, side = coarse_size(look), (TONE_BLUR, TONE_BLUR), TONE_SHRINK * TONE_BLUR // POOL | 1
    small, contrast = cv2.resize(look, size, interpolation=cv2.INTER_AREA).astype(np.float32), np.max(things, axis=0)
    if is_false_colour(small):
        return None
    ground = cv2.resize((contrast == 0).astype(np.float32), size, interpolation=cv2.INTER_AREA) + np.float32(
        LEAST_GROUND
    )
    mean = cv2.blur(small * ground[..., None], box) / cv2.blur(ground, box)[..., None]
    greatest = cv2.dilate(contrast, np.ones((side, side), np.uint8))
    coloured = np.log2(1 + cv2.resize(greatest, size, interpolation=cv2.INTER_AREA) / np.float32(LEAST))
    return np.dstack([mean, coloured]).astype(np.float16)

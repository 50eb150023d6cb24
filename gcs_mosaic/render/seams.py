"""Seam blending: each place from the frame with the best view, with a transition of a few pixels and no ghosting.

View quality is a frame's weight (distance to its border, resolution) and local sharpness, because some frames have motion blur;
and how near its light is to that of most frames there, so that less of it has to be changed.
A salient thing in one frame where another has none (a person, a vehicle that has moved on) outweighs any weight: whatever was
seen once stays on the map. A static thing is salient in all frames, and then the weight decides. In between is a thing that the
other frame has some distance away: a tall one seen from another side, or a walking person. There the weight decides too, with a
small bonus for the thing: stacked pipes are not assembled from pieces of several frames, and nobody is lost who crossed the
seam between two. Light that is clipped shows nothing: there another frame is shown which has it, unless it lacks the thing
that is clipped.

Residual exposure differences are blended in two frequency bands, after P. Burt and E. Adelson, "A Multiresolution Spline with
Application to Image Mosaics", ACM Transactions on Graphics 2(4), 1983: the seam is narrow for detail and wide for tone
(`tone`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from gcs_mosaic.render.blend_maps import (
    GLARE,
    LEAST,
    BlendMaps,
    Of,
    clipped,
    contrasts,
    detail_of,
    grouped_planes,
    patches,
    small_look,
    tone_of,
)
from gcs_mosaic.render.blending import LEAST_WEIGHT
from gcs_mosaic.render.cells import Cells, Owned, Seen, Window
from gcs_mosaic.render.frame_warp import FrameWarp
from gcs_mosaic.render.saliency import WAYS
from gcs_mosaic.render.sampling import at_cells, hindrance, inside, lattice_part, places_in, sampled
from gcs_mosaic.render.seam_path import least_seen
from gcs_mosaic.stitch.arrays import ImageBGR, ImageGrey, Lattice, Planes, PlaneStack

BRIGHTER = 0
# Planes seen of a frame and kept of the one that shows; the last ones also of the next best.
THINGS, NEAR, FAR = slice(0, WAYS), slice(WAYS, 2 * WAYS), slice(2 * WAYS, 3 * WAYS)
CLIPPED = 3 * WAYS
LOOK = slice(CLIPPED + 1, CLIPPED + 4)
SECOND_LOOK = slice(LOOK.stop, LOOK.stop + 3)
KEPT = SECOND_LOOK.stop

LEAST_DETAIL = 1.0  # grey levels; the noise level of bare ground
# Exponent of the detail ratio: a frame with a third less detail yields to one with a third of its weight. With more of it, crowns
# that lean into one frame would cover the smooth road that another sees.
SHARP = 3.0
# Subtracted per log brightness by which a frame's light is unlike that of most frames: what is brighter by a third, as where the
# sun has come out, yields to three quarters of its weight. With more of it seams leave the places where frames are alike.
UNLIKE = 1.0
SALIENT = 20.0  # added to the log weight ratio for a thing the other frame lacks: exceeds any weight
# Added where the other frame has one some distance away: more than the log weight ratio changes over that distance, so that of
# two frames that see a person in two places not each defers to the other.
ELSEWHERE = 1.0
# Subtracted where all is clipped, and its share where a part is: outweighs the distance from the border of all but the outermost
# fiftieth of another frame.
NO_LIGHT = 4.0


def look_for_seams(look: ImageBGR, of: Of) -> BlendMaps:
    """What is kept of a frame's image: contrasts, clipped light, colours, detail, tone."""
    found, (blown, black) = contrasts(look), clipped(look)
    shape = found[0].shape
    glaring, unlit = patches(blown, shape, GLARE), patches(black, shape)
    found[BRIGHTER][glaring > 0] = 0  # the rim of a glare is not a thing; what shines in the dark may be someone
    planes = grouped_planes([*found, np.maximum(glaring, unlit), *small_look(look, shape)])
    return BlendMaps(of, planes, detail_of(look, np.maximum(blown, black)), tone_of(look, found[THINGS]))


def see(frame: FrameWarp, maps: BlendMaps | None, window: Window) -> Seen:
    """A frame's contribution to the cells of a window: its planes and its score."""
    assert maps is not None, "seams need a look"
    assert maps.detail is not None
    where = lattice_part(frame.lattice, window)
    pixels, weight = at_cells(frame.lattice.pixels[where]), at_cells(frame.lattice.weight[where])
    blue, green, red = frame.factors(window)
    gain = _light(blue, green, red)
    planes = _at_places(maps.planes, places_in(pixels, frame.lattice, maps.planes[0].shape))
    planes[:CLIPPED] = [times(one, gain) for one in planes[:CLIPPED]]
    planes[LOOK] = [times(one, by) for one, by in zip(planes[LOOK], (blue, green, red), strict=True)]
    detail = sampled(maps.detail.astype(np.float32), places_in(pixels, frame.lattice, maps.detail.shape))
    for one in planes[THINGS]:  # things seen only at the very border are unreliable, those of an overlay are none
        one[weight <= LEAST_WEIGHT] = 0
    covered = inside(frame.lattice, where)
    score = np.log(np.maximum(weight, LEAST_WEIGHT)) + SHARP * np.log(gain * detail + LEAST_DETAIL)
    score -= _unlike(frame, pixels) + hindrance(frame.lattice, where, covered)
    return Seen(covered, np.asarray(score, np.float32), np.stack(planes))


def _unlike(frame: FrameWarp, pixels: Lattice) -> Lattice | np.float32:
    """What a frame loses at its pixels (h, w, 2) for light unlike that of most frames there."""
    if frame.painted.light is None:
        return np.float32(0)
    size = np.abs(frame.painted.light.grid.mean(axis=2)) * np.float32(UNLIKE)
    return np.asarray(sampled(size, places_in(pixels, frame.lattice, size.shape)), np.float32)


def contrasts_at(
    frame: FrameWarp, groups: Sequence[PlaneStack], window: Window, at: Callable[[Lattice], Lattice] = at_cells
) -> Planes:
    """Grouped contrast planes as (k, h, w), at the cells of a window, or at other places between lattice points."""
    pixels = at(frame.lattice.pixels[lattice_part(frame.lattice, window)])
    planes = _at_places(groups, places_in(pixels, frame.lattice, groups[0].shape))
    gain = _light(*frame.factors(window, at))
    return np.stack([times(one, gain) for one in planes])


def _at_places(groups: Sequence[PlaneStack], places: Lattice) -> list[ImageGrey]:
    return [np.asarray(one, np.uint8) for group in groups for one in cv2.split(sampled(group, places))]


def _light(blue: Lattice | np.float32, green: Lattice | np.float32, red: Lattice | np.float32) -> Lattice | np.float32:
    """Factor of the luminance for these factors of the colours."""
    return np.float32(0.114) * blue + np.float32(0.587) * green + np.float32(0.299) * red


def times(plane: ImageGrey, factor: Lattice | np.float32) -> ImageGrey:
    """A plane (h, w) times a factor, clipped to 8 bit."""
    if isinstance(factor, np.ndarray):
        return np.asarray(cv2.multiply(plane, factor, dtype=cv2.CV_8U), np.uint8)
    table = np.clip(np.rint(np.arange(256) * factor), 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(plane, table), np.uint8)


def decide(cells: Cells, seen: Seen) -> Lattice:
    """Score margin of the new frame over those that show, with things before plain ground."""
    nowhere = only(seen.planes, cells.planes, FAR) - only(cells.planes, seen.planes, FAR)
    not_here, not_there = only(seen.planes, cells.planes, NEAR), only(cells.planes, seen.planes, NEAR)
    lost = _lost(cells.planes) * (1 - not_there) - _lost(seen.planes) * (1 - not_here)
    of_things = SALIENT * nowhere + ELSEWHERE * (not_here - not_there)
    return np.asarray(seen.score - cells.score + lost + of_things, np.float32)


def _lost(planes: Planes) -> Lattice:
    """What a frame loses (h, w) where its light is clipped."""
    return np.asarray(planes[CLIPPED] * np.float32(NO_LIGHT / 255), np.float32)


def only(one: Planes, other: Planes, reach: slice) -> Lattice:
    """(h, w): 1 where one has a thing that exceeds any contrast of the other within reach; 0 where not, with a narrow ramp
    between."""
    return beyond(one[THINGS], other[reach])


def beyond(things: Planes, around: Planes) -> Lattice:
    """By how much (h, w) things exceed the contrasts around, over all kinds of contrast: 0 to 1."""
    most = np.zeros(things.shape[1:], np.uint8)
    for thing, other in zip(things, around, strict=True):
        most = np.maximum(most, cv2.subtract(thing, other))
    return np.minimum(most, LEAST).astype(np.float32) / np.float32(LEAST)


def steered(cells: Cells) -> Owned:
    """The frames to show, with seams where they are least visible."""
    return least_seen(cells, (cells.planes[LOOK], cells.planes[SECOND_LOOK]))

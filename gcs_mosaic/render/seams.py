"""Each place from the frame that sees it best, with a transition of a few pixels: nothing is half transparent.

How well a frame sees a place is told by its weight (how far that is from its border, how finely it is resolved) and by how
sharp the frame is there, because some frames are blurred by motion. A thing that stands out in one frame where another has
none at all (a person, a vehicle that has moved on) counts more than any weight: so whatever was seen once stays on the map.
What stands still stands out in all frames, and then weight decides. Between the two is a thing that the other frame has some
way off: a tall one, seen from another side, or somebody who walks. There weight decides too, with a little more for the thing:
stacked pipes are not put together of pieces of several frames, and nobody is lost who stepped over the seam between two.

What is left of different light is taken up in two bands, after P. Burt and E. Adelson, "A Multiresolution Spline with
Application to Image Mosaics", ACM Transactions on Graphics 2(4), 1983: the seam is narrow for the picture and wide for its
tone (`tone`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.blending import LEAST_WEIGHT
from gcs_mosaic.render.cells import PARTLY, Cells, Owned, Seen, Window
from gcs_mosaic.render.looks import LEAST, Of, Sight, contrasts, detail_of, grouped_planes, small_look, tone_of
from gcs_mosaic.render.placed import PlacedFrame
from gcs_mosaic.render.saliency import WAYS
from gcs_mosaic.render.sampling import CUT, at_cells, inside, lattice_part, places_in, sampled
from gcs_mosaic.render.seam_path import least_seen
from gcs_mosaic.render.warp_grid import Lattice

Image = NDArray[np.uint8]

# The planes that are seen of a frame and kept of the one that shows, and the last ones, of the next best, too.
THINGS, NEAR, FAR = slice(0, WAYS), slice(WAYS, 2 * WAYS), slice(2 * WAYS, 3 * WAYS)
LOOK = slice(3 * WAYS, 3 * WAYS + 3)
SECOND_LOOK = slice(LOOK.stop, LOOK.stop + 3)
SEEN, KEPT = LOOK.stop, SECOND_LOOK.stop

LEAST_DETAIL = 1.0  # grey levels; what noise makes of bare ground
SHARP = 3.0  # exponent of the ratio of detail: a frame with a third of it less yields to one with a third of its weight
SALIENT = 20.0  # what a thing where the other frame has none adds to the log ratio of weights: more than weights can
# What it adds where the other frame has one some way off: more than the log ratio of weights changes over that way, so that
# of two frames that see somebody in two places not each can think the other one shows him.
ELSEWHERE = 1.0


def look_for_seams(look: Image, of: Of) -> Sight:
    """What is kept of a frame's picture: contrasts, colours, detail, tone."""
    found = contrasts(look)
    planes = grouped_planes([*found, *small_look(look, found[0].shape)])
    return Sight(of, planes, detail_of(look), tone_of(look, found[THINGS]))


def see(frame: PlacedFrame, sight: Sight | None, window: Window) -> Seen:
    """What a frame brings to the cells of a window: its planes and how well it sees them."""
    assert sight is not None, "seams need a look"
    assert sight.detail is not None
    where = lattice_part(frame.lattice, window)
    pixels, weight = at_cells(frame.lattice.pixels[where]), at_cells(frame.lattice.weight[where])
    blue, green, red = frame.factors(window)
    gain = _light(blue, green, red)
    planes = _at_places(sight.planes, places_in(pixels, frame.lattice, sight.planes[0].shape))
    planes = [times(one, by) for one, by in zip(planes, [gain] * 3 * WAYS + [blue, green, red], strict=True)]
    for one in planes[THINGS]:
        one[weight <= LEAST_WEIGHT] = 0  # what is seen at the very border only is nothing to go by
    detail = sampled(sight.detail.astype(np.float32), places_in(pixels, frame.lattice, sight.detail.shape))
    covered = inside(frame.lattice, where)
    score = np.log(np.maximum(weight, LEAST_WEIGHT)) + SHARP * np.log(gain * detail + LEAST_DETAIL)
    return Seen(covered, np.asarray(score - CUT * (covered == PARTLY), np.float32), np.stack(planes))


def contrasts_at(
    frame: PlacedFrame, groups: Sequence[Image], window: Window, at: Callable[[Lattice], Lattice] = at_cells
) -> Image:
    """Planes (k, h, w) of contrasts that come in groups, at the cells of a window, or at other places between lattice points."""
    pixels = at(frame.lattice.pixels[lattice_part(frame.lattice, window)])
    planes = _at_places(groups, places_in(pixels, frame.lattice, groups[0].shape))
    gain = _light(*frame.factors(window, at))
    return np.stack([times(one, gain) for one in planes])


def _at_places(groups: Sequence[Image], places: Lattice) -> list[Image]:
    return [np.asarray(one, np.uint8) for group in groups for one in cv2.split(sampled(group, places))]


def _light(blue: Lattice | np.float32, green: Lattice | np.float32, red: Lattice | np.float32) -> Lattice | np.float32:
    """What the light is multiplied by where the colours are by these."""
    return np.float32(0.114) * blue + np.float32(0.587) * green + np.float32(0.299) * red


def times(plane: NDArray[np.uint8], factor: Lattice | np.float32) -> Image:
    """A plane (h, w) times a factor, within eight bits."""
    if isinstance(factor, np.ndarray):
        return np.asarray(cv2.multiply(plane, factor, dtype=cv2.CV_8U), np.uint8)
    table = np.clip(np.rint(np.arange(256) * factor), 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(plane, table), np.uint8)


def decide(cells: Cells, seen: Seen) -> Lattice:
    """By how much the new frame sees the cells better than those that show, things before plain ground."""
    nowhere = only(seen.planes, cells.planes, FAR) - only(cells.planes, seen.planes, FAR)
    not_here = only(seen.planes, cells.planes, NEAR) - only(cells.planes, seen.planes, NEAR)
    return np.asarray(seen.score - cells.score + SALIENT * nowhere + ELSEWHERE * not_here, np.float32)


def only(one: Image, other: Image, reach: slice) -> Lattice:
    """(h, w): 1 where one has a thing that is beyond any contrast of the other so far around; 0 where not, and little between."""
    return beyond(one[THINGS], other[reach])


def beyond(things: Image, around: Image) -> Lattice:
    """How far (h, w) things stand out more than what there is around, in each way: 0 to 1."""
    most = np.zeros(things.shape[1:], np.uint8)
    for thing, other in zip(things, around, strict=True):
        most = np.maximum(most, cv2.subtract(thing, other))
    return np.minimum(most, LEAST).astype(np.float32) / np.float32(LEAST)


def steered(cells: Cells) -> Owned:
    """The frames that are to show, with seams where they are least seen."""
    return least_seen(cells, (cells.planes[LOOK], cells.planes[SECOND_LOOK]))

"""Each place from the frame that sees it best, with a transition of a few pixels: nothing is half transparent.

How well a frame sees a place is told by its weight (how far that is from its border, how finely it is resolved) and by how
sharp the frame is there, because some frames are blurred by motion. A thing that stands out in one frame where another has
none at all (a person, a vehicle that has moved on) counts more than any weight: so whatever was seen once stays on the map.
What stands still stands out in all frames, and then weight decides. Between the two is a thing that the other frame has some
way off: a tall one, seen from another side, or somebody who walks. There weight decides too, with a little more for the thing:
stacked pipes are not put together of pieces of several frames, and nobody is lost who stepped over the seam between two.

What is left of different light is taken up in two bands, after P. Burt and E. Adelson, "A Multiresolution Spline with
Application to Image Mosaics", ACM Transactions on Graphics 2(4), 1983: the seam is narrow for the picture and wide for its
tone, the colour of the ground over some ten pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.painting.blending import LEAST_WEIGHT, Part, mix_pixels
from gcs_mosaic.stitch.painting.course import least_seen
from gcs_mosaic.stitch.painting.lattice import LATTICE_STEP, Lattice
from gcs_mosaic.stitch.painting.layers import Layer, Measured
from gcs_mosaic.stitch.painting.saliency import LEAST_CONTRAST, POOL, WAYS, saliency
from gcs_mosaic.stitch.painting.warping import refined, upscale

Image = NDArray[np.uint8]

# What is measured of a frame, in this order, at each of the finer lattice points.
THINGS, NEAR, FAR = slice(0, WAYS), slice(WAYS, 2 * WAYS), slice(2 * WAYS, 3 * WAYS)
COLOURED, DETAILED, TONE = 3 * WAYS, 3 * WAYS + 1, slice(3 * WAYS + 2, None)

# Pixels of the picture that a frame is looked at in: what is finer than the one is detail, told over squares of the other,
# which are so large that a thing, or noise, does not make a frame the sharper one.
DETAIL, DETAIL_AROUND = 5, 241
LEAST_DETAIL = 1.0  # grey levels; what noise makes of bare ground
SHARP = 3.0  # exponent of the ratio of detail: a frame with a third of it less yields to one with a third of its weight
TONE_SHRINK = 8  # the size of a pixel of the map of tones, in pixels of the picture that a frame is looked at in
TONE_BLUR = 7  # pixels of that map, a side, that make a tone: so wide that no person changes it
BEYOND = 1.5  # times the contrast of anything around that a thing must have for the other frame not to have it
SALIENT = 20.0  # what a thing where the other frame has none adds to the log ratio of weights: more than weights can
# What it adds where the other frame has one some way off: more than the log ratio of weights changes over that way, so that
# of two frames that see somebody in two places not each can think the other one shows him.
ELSEWHERE = 1.0
SURE = 0.05  # log ratio of weights at which a lattice point is wholly on one side of the seam
LEAST_SURE = 0.5  # of 1, at every lattice point: the seam stays narrow even where two frames see equally well
FEATHER = 4  # tile px of transition between two lattice points that are wholly on different sides
SOFT = 4.0  # exponent of the ratio of weights by which tones are mixed: over about a quarter of a frame
MOST_SHIFT = 12.0  # grey levels that a tone is shifted at most; more is no light but a thing that has moved


def look_for_seams(look: Image) -> NDArray[np.float32]:
    """What `seam` needs to know of a frame's picture: contrast of things, of anything near, of anything far, how much things
    colour the tone, log detail, tone (b, g, r)."""
    things, near, far = saliency(look)
    maps = [_log_detail(look), *cv2.split(_tone(look))]
    return np.dstack([things, near, far, _coloured(things), *(cv2.resize(one, things.shape[1::-1]) for one in maps)])


def _coloured(things: NDArray[np.float32]) -> NDArray[np.float32]:
    """How far things may colour the tone of a place: the log (base 2) of 1 and the greatest contrast, in the least ones."""
    side = TONE_SHRINK * TONE_BLUR // POOL | 1
    return np.log2(1 + cv2.dilate((things / LEAST_CONTRAST).max(axis=-1), np.ones((side, side), np.uint8)))


def _log_detail(look: Image) -> NDArray[np.float32]:
    """How much detail there is around a place; the same ground has more of it in a sharper frame."""
    grey = cv2.cvtColor(look, cv2.COLOR_BGR2GRAY)
    fine = cv2.absdiff(grey, cv2.blur(grey, (DETAIL, DETAIL)))
    size = max(1, look.shape[1] // TONE_SHRINK), max(1, look.shape[0] // TONE_SHRINK)
    around = DETAIL_AROUND // TONE_SHRINK
    mean = cv2.blur(cv2.resize(fine.astype(np.float32), size, interpolation=cv2.INTER_AREA), (around, around))
    return np.asarray(np.log(mean + LEAST_DETAIL), dtype=np.float32)


def _tone(look: Image) -> NDArray[np.float32]:
    """The mean colour around a place."""
    size = max(1, look.shape[1] // TONE_SHRINK), max(1, look.shape[0] // TONE_SHRINK)
    small = cv2.resize(look, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cv2.blur(small, (TONE_BLUR, TONE_BLUR)), dtype=np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """What is known of a tile's picture at the finer lattice points: `weight` (33, 33), `measured` (33, 33, k)."""

    weight: Lattice
    measured: Lattice


def seam(shown: Layer, new: Part) -> Layer:
    """Each place from the frame that sees it best, things before plain ground; tones agree over a wider strip."""
    known = _guessed(new.measured) if shown.measured is None else shown.measured
    before = _Sight(refined(shown.weight), known.astype(np.float32))
    after = _Sight(refined(new.weight), new.measured.astype(np.float32))
    log_ratio = _log_ratio(before, after)
    nowhere, not_here = _things(before, after)
    decided = log_ratio + SALIENT * nowhere + ELSEWHERE * not_here
    is_new = decided > 0
    shown_shift, new_shift = _tone_shifts(before, after, log_ratio, not_here)
    if shown.is_full and not is_new.any():
        return replace(_shifted(shown, shown_shift), measured=_toned(before, shown_shift).astype(np.float16))
    picture = new.picture()
    if picture is None:
        return shown
    shown, picture = _shifted(shown, shown_shift), _shifted(picture, new_shift)
    decided = least_seen(decided, picture.colour, shown.colour)
    is_new = decided > 0
    mixed = mix_pixels(shown, picture, _share(decided))
    measured = np.where(is_new[..., None], _toned(after, new_shift), _toned(before, shown_shift))
    weight = np.where(is_new[::2, ::2], new.weight, shown.weight)
    return replace(mixed, weight=weight, measured=measured.astype(np.float16))


def _guessed(new: Measured) -> Measured:
    """What is taken to be known of a tile that an earlier run wrote, until it is made anew: plain ground of the right tone."""
    return np.dstack([np.zeros_like(new[..., :DETAILED]), new[..., DETAILED:]])


def _share(decided: Lattice) -> Image:
    """The new frame's share (256, 256), 0 to 255, of what was decided at the lattice points (above 0: it is to be shown)."""
    side = np.where(decided > 0, 1, -1) * np.clip(np.abs(decided) / SURE, LEAST_SURE, 1)
    steepness = LATTICE_STEP / 2 / (2 * FEATHER)
    share = upscale((side * steepness).astype(np.float32)) + 0.5
    return np.asarray(np.rint(np.clip(share, 0, 1) * 255), dtype=np.uint8)


def _log_ratio(shown: _Sight, new: _Sight) -> Lattice:
    """By how much the new frame sees the lattice points better than the shown one; above 0: it does."""
    log_ratio = np.log(np.maximum(new.weight, LEAST_WEIGHT) / np.maximum(shown.weight, LEAST_WEIGHT))
    log_ratio += SHARP * (new.measured[..., DETAILED] - shown.measured[..., DETAILED])
    return np.asarray(log_ratio, dtype=np.float32)


def _things(shown: _Sight, new: _Sight) -> tuple[Lattice, Lattice]:
    """Where only one of them has a thing, 1 if it is the new frame, -1 if it is the shown one, 0 where none or both have: of
    things that the other one has nowhere, and of those that it has not here."""
    of_new = _only(new.measured, shown.measured) * (new.weight > LEAST_WEIGHT)[..., None]
    of_shown = _only(shown.measured, new.measured) * (shown.weight > LEAST_WEIGHT)[..., None]
    things = np.asarray(of_new - of_shown, np.float32)
    return things[..., 0], things[..., 1]


def _only(one: Lattice, other: Lattice) -> Lattice:
    """(33, 33, 2): 1 where one has a thing that is beyond any contrast of the other far around, and near; 0 where not, and
    little between."""
    things = one[..., THINGS]
    beyond = [((things - BEYOND * other[..., reach]) / LEAST_CONTRAST).max(axis=-1) for reach in (FAR, NEAR)]
    return np.asarray(np.clip(np.dstack(beyond), 0, 1))


def _tone_shifts(shown: _Sight, new: _Sight, log_ratio: Lattice, things: Lattice) -> tuple[Lattice, Lattice]:
    """What the tones of what is shown and of the new frame are to be shifted by, (33, 33, 3) each, to agree.

    Nothing is shifted where the other one has no weight: the tile beside this one may not know of it at all. Nor where one
    has a thing that the other has not: it is no light that sets them apart.
    """
    new_share = 1 / (1 + np.exp(-np.clip(SOFT * log_ratio, -30, 30)))
    # The same thing may stand out twice as much in one frame as in the other, not four times as much.
    as_coloured = np.clip(2 - np.abs(new.measured[..., COLOURED] - shown.measured[..., COLOURED]), 0, 1)
    apart = (new.measured[..., TONE] - shown.measured[..., TONE]) * (as_coloured * (1 - np.abs(things)))[..., None]
    of_shown = (new_share * (new.weight > 0))[..., None] * apart
    of_new = ((new_share - 1) * (shown.weight > 0))[..., None] * apart
    return _bounded(of_shown), _bounded(of_new)


def _bounded(shift: Lattice) -> Lattice:
    return np.asarray(np.clip(shift, -MOST_SHIFT, MOST_SHIFT), dtype=np.float32)


def _toned(sight: _Sight, shift: Lattice) -> Lattice:
    """What is measured of a picture that has been shifted."""
    return np.dstack([sight.measured[..., : TONE.start], sight.measured[..., TONE] + shift])


def _shifted(layer: Layer, shift: Lattice) -> Layer:
    """The layer with its colours shifted, where it covers anything."""
    if np.abs(shift).max() < 0.5:
        return layer
    colour = cv2.add(layer.colour, upscale(shift), dtype=cv2.CV_8U)
    colour = colour if layer.is_full else cv2.copyTo(colour, layer.coverage)
    return replace(layer, colour=np.asarray(colour, np.uint8))

"""Light field: a smooth correction of a frame's tones, in which overlapping frames meet between their photographs.

The common tone of a place is between the mean and the median of the log brightness of all frames that see it, weighted by their
distance from their own borders: a few frames in another light than most do not decide it. A frame's field is what it lacks of
that. So it is in both frames of a seam the same, changes over half a frame where the light does, is zero where one frame alone
sees the ground, and depends on the frames beside it only: nothing adds up along a chain. A mean over overlaps in place of the
blocks that M. Uyttendaele, A. Eden and R. Szeliski, "Eliminating Ghosting and Exposure Artifacts in Image Mosaics", CVPR 2001,
section 4, average for the same purpose.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from gcs_mosaic.render.warp import NOWHERE
from gcs_mosaic.render.warp_grid import times_each
from gcs_mosaic.stitch.arrays import AnyArray, FloatImage, FloatPlanes, FloatRows, Lattice, Mask, PointsNx2

COLUMNS, ROWS = 8, 6  # nodes, in the middles of as many equal parts of a frame
STEPS = 128  # of a stored value per unit of log brightness: half a step is invisible
MOST = 127  # steps; a factor of 2.7
LEAST = 2  # steps; a field nowhere above is none: nobody sees 1.5 %
BLOCK = 4  # thumbnail px a side, taken together
UNLIKE = 0.25  # log brightness; what deviates more from an overlap's median (shadows, vehicles) counts as if by that
FINER = 16  # times the nodes, between which a field is cubic; linear ones would show as bands
FINE = ROWS * FINER, COLUMNS * FINER
DECISIVE = 4  # power of a weight: the frame that sees a place best shows it
ALIKE = 0.1  # log brightness; what is this near the common tone, nobody notices, and counts fully towards it
ROUNDS = 3  # of weighting anew; with more of them the light would change abruptly from one frame's to the other's
HELD = 0.5  # weight of a new frame's own light beside frames that stay as they are shown: on a seam it gives way


@dataclass(frozen=True, slots=True)
class LightField:
    """`logs`: int8 (ROWS, COLUMNS, bands), log factors in 1 / STEPS."""

    logs: bytes

    @property
    def grid(self) -> FloatImage:
        """Log factors (ROWS, COLUMNS, bands)."""
        steps = np.frombuffer(self.logs, np.int8).reshape(ROWS, COLUMNS, -1)
        return steps.astype(np.float32) / np.float32(STEPS)

    def fine(self) -> FloatPlanes:
        """Factors (bands, *FINE) over the frame, dense enough to be interpolated linearly."""
        planes = [cv2.resize(band, FINE[::-1], interpolation=cv2.INTER_CUBIC) for band in np.moveaxis(self.grid, 2, 0)]
        return np.asarray(np.exp(np.stack(planes)), np.float32)


@dataclass(frozen=True, slots=True)
class LightBeside:
    """What another frame shows at the nodes of one: float16 (ROWS * COLUMNS, 3 + bands). Its weight (0 to 1), where in it that is
    (fractions of its width and height), and its log brightness less this frame's, by band."""

    nodes: bytes

    @property
    def rows(self) -> FloatRows:
        stored = np.frombuffer(self.nodes, np.float16).astype(np.float32)
        rows: FloatRows = stored.reshape(ROWS * COLUMNS, -1)
        return rows


LightOverlap = tuple[LightBeside, LightBeside]  # frame j beside i, and i beside j


def light_overlap(
    log_ratio: FloatImage, there: FloatImage, usable: Mask, size_j: tuple[int, int]
) -> LightOverlap | None:
    """Of thumbnails i (h, w) and j of a size (width, height): log brightness of i less that of j (h, w, bands) at its pixels,
    where those lie in j (h, w, 2), and which count. None if next to none do."""
    height, width = usable.shape
    middle = np.median(log_ratio[usable], axis=0)
    apart = np.clip(log_ratio, middle - UNLIKE, middle + UNLIKE)
    at_j = np.asarray((there + 0.5) / np.array(size_j), np.float32)
    area = _area(at_j, usable) * width * height  # of j's picture that one of i's covers
    stack = np.dstack([usable, at_j, apart]) * usable[..., None]
    blocks = max(1, width // BLOCK), max(1, height // BLOCK)
    planes = np.moveaxis(stack, 2, 0).astype(np.float32)
    small = np.stack([cv2.resize(one, blocks, interpolation=cv2.INTER_AREA) for one in planes])
    count, *sums = small.reshape(len(small), -1)
    some = count > 0
    if area <= 0 or not some.any():
        return None
    share = count[some]
    at_i, means = _middles(*blocks)[some], np.asarray((np.stack(sums)[:, some] / share).T, np.float32)
    at_j, ratio = means[:, :2], means[:, 2:]
    whole = ROWS * COLUMNS / (blocks[0] * blocks[1])  # a node's part of a picture has this many times fewer blocks
    aspects = height / width, size_j[1] / size_j[0]
    return (
        _beside(at_i, share * taper(at_j, aspects[1]) * whole, at_j, -ratio),
        _beside(at_j, share * taper(at_i, aspects[0]) * whole * area, at_i, ratio),
    )


def taper(places: PointsNx2 | FloatRows, aspect: float) -> AnyArray:
    """Weight (n,) of a frame at places (n, 2) in it, fractions of its size: 0 at its border, 1 in the middle. `aspect`: height
    over width."""
    x, y = np.minimum(places, 1 - places).T
    return np.asarray(np.clip(np.minimum(x, y * aspect) * 2 / min(1.0, aspect), 0, 1), np.float32)


def node_shares(places: PointsNx2 | FloatRows) -> FloatRows:
    """The share (n, ROWS * COLUMNS) that each node has in places (n, 2) of a frame, fractions of its size; bilinear."""
    across, down = (_hats(places[:, k], count) for k, count in ((0, COLUMNS), (1, ROWS)))
    return np.asarray((down[:, :, None] * across[:, None, :]).reshape(len(places), -1), np.float32)


@cache
def nodes() -> FloatRows:
    """Where the nodes are (ROWS * COLUMNS, 2), fractions of a frame's size."""
    return _middles(COLUMNS, ROWS)


@cache
def own_weight(aspect: float) -> FloatRows:
    """A frame's own weight at its nodes (ROWS * COLUMNS, 1)."""
    places = _middles(COLUMNS * FINER, ROWS * FINER)
    shares = node_shares(places)
    return np.asarray((shares.T @ taper(places, aspect) / FINER**2)[:, None], np.float32)


def at_places(field: LightField | None, places: FloatRows) -> FloatRows | float:
    """Log factors (n, bands) at places (n, 2) of a frame, fractions of its size; 0 without a field."""
    if field is None:
        return 0.0
    return np.asarray(node_shares(places) @ field.grid.reshape(ROWS * COLUMNS, -1), np.float32)


def lacking(aspect: float, beside: Iterable[tuple[FloatRows, AnyArray]], own: float = 1.0) -> LightField | None:
    """The field of a frame, of all that is seen beside it: weights (nodes, 1), and how much brighter it is (nodes, bands), in log
    brightness. `own`: how much its own weight counts. None if nothing is to be corrected."""
    known = list(beside)
    if not known:
        return None
    weight = np.stack([own * own_weight(aspect), *(share for share, _ in known)])
    brighter = np.stack([np.zeros_like(known[0][1]), *(one for _, one in known)])
    steps = np.clip(np.rint(_common(weight, brighter) * STEPS), -MOST, MOST).astype(np.int8)
    if np.abs(steps).max() <= LEAST:
        return None
    return LightField(steps.tobytes())


def _common(weight: AnyArray, brighter: AnyArray) -> AnyArray:
    """The common tone (nodes, bands) of the weights (n, nodes, 1) and tones (n, nodes, bands) of frames: a mean in which what is
    far from it counts less. A few rounds, softened, of E. Weiszfeld's way to the median, Tohoku Math. J. 43, 1937."""
    common = _mean(weight, brighter)
    for _ in range(ROUNDS):
        far = np.abs(brighter - common).mean(axis=2, keepdims=True) / np.float32(ALIKE)
        common = _mean(weight / np.sqrt(1 + far**2), brighter)
    return common


def _mean(weight: AnyArray, values: AnyArray) -> AnyArray:
    return np.asarray((weight * values).sum(axis=0) / np.maximum(weight.sum(axis=0), np.float32(1e-6)))


def shown_part(aspect: float, beside: Iterable[tuple[FloatRows, AnyArray]]) -> FloatRows:
    """Which part of a frame's ground (nodes, 1) it shows itself, nearly, of what is seen beside it as in `lacking`."""
    own = own_weight(aspect) ** DECISIVE
    return np.asarray(own / (own + sum(share**DECISIVE for share, _ in beside)), np.float32)


def apart(one: LightField | None, other: LightField | None) -> float:
    """Maximum difference of two fields, in log brightness; 0 where nobody sees it."""
    grids = [0.0 if field is None else field.grid for field in (one, other)]
    most = float(np.abs(grids[0] - grids[1]).max())
    return most if most > LEAST / STEPS else 0.0


def factors(field: LightField, pixels: Lattice, width: int, height: int) -> Lattice:
    """Factor (h, w, bands) at pixels (h, w, 2) of a frame; at its border where nowhere (NaN)."""
    places = times_each(pixels + np.float32(0.5), (FINE[1] / width, FINE[0] / height)) - np.float32(0.5)
    places = np.nan_to_num(places, nan=NOWHERE)
    made = [
        cv2.remap(band, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        for band in field.fine()
    ]
    return np.asarray(cv2.merge(made), np.float32).reshape(*places.shape[:2], -1)


def _beside(here: FloatRows, weight: AnyArray, there: FloatRows, brighter: FloatRows) -> LightBeside:
    """Sums over blocks at places (n, 2) of a frame with these weights (n,): where in the other frame, and how much brighter."""
    sums = node_shares(here).T @ (np.hstack([np.ones((len(here), 1)), there, brighter]) * weight[:, None])
    found = sums / np.maximum(sums[:, :1], 1e-6)
    found[:, 0] = sums[:, 0]
    return LightBeside(found.astype(np.float16).tobytes())


def _area(at_j: FloatImage, usable: Mask) -> float:
    """How much of picture j a pixel of i covers, in the middle of those that count; 0 if none lie together."""
    right, down = (at_j[:-1, 1:] - at_j[:-1, :-1], at_j[1:, :-1] - at_j[:-1, :-1])
    together = usable[:-1, :-1] & usable[:-1, 1:] & usable[1:, :-1]
    if not together.any():
        return 0.0
    return float(np.median(np.abs(right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0])[together]))


def _middles(columns: int, rows: int) -> FloatRows:
    """Middles (rows * columns, 2) of equal parts of a frame, row by row, fractions of its size."""
    x, y = ((np.arange(count, dtype=np.float32) + np.float32(0.5)) / np.float32(count) for count in (columns, rows))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _hats(at: AnyArray, count: int) -> FloatRows:
    """(n, count): linear shares of nodes in the middles of `count` equal parts; beyond the outer ones these have all."""
    place = np.clip(at * count - 0.5, 0, count - 1)
    return np.asarray(np.maximum(1 - np.abs(place[:, None] - np.arange(count)), 0), np.float32)

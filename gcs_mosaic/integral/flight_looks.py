"""The looks at a window of a flight's map, cut out of its originals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.integral.focal_plane import camera_height, pixels_at
from gcs_mosaic.integral.heat_palette import is_brighter_where_warmer
from gcs_mosaic.integral.relief_plane import plane_of
from gcs_mosaic.integral.stack import GroundLook, GroundWindow
from gcs_mosaic.integral.why_not import nobody_sees, too_few
from gcs_mosaic.render.counts_range import sample_of
from gcs_mosaic.render.dense_places import STEP, between_steps
from gcs_mosaic.render.exposure import is_grey
from gcs_mosaic.render.frame_warp import brightening_of
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Bands, FloatImage, PointsNx2
from gcs_mosaic.stitch.camera.geometry import ground_sampling_distance
from gcs_mosaic.store.records import FrameRecord
from gcs_mosaic.views.decoding import original_pixels
from gcs_mosaic.views.flight_view import FlightView, pixels_of
from gcs_mosaic.views.pictures import REDUCTIONS

# Shares of the flying height above the map's ground between which the focus can be moved. Over woods the map may lie by the
# crowns: where these reach 60 % of the way up to the aircraft, as from 35 m over trees of 21 m, the ground is at -150 %.
# Above half of the way to the camera nothing is sought.
LOWEST, HIGHEST = -1.5, 0.5
MOST_LOOKS = 100  # in memory: 100 of 400 x 400 px in colour are 200 MB
ENOUGH_PLACES = 33  # along a side: what lies between two of them is in the box of them, but for less than the RIM
MOST_AT_ONCE = 4  # bands that OpenCV resizes together
RIM = 2.0  # px of the original kept around what is cut out, for interpolation

Some = TypeVar("Some")
PixelBox = tuple[int, int, int, int]  # left, top, right, bottom
ReadOriginal = Callable[[FlightView, FrameRecord, int], Bands | Unreadable]
Heights = tuple[float, float]  # the lowest and the highest, shares of the flying height


@dataclass(frozen=True, slots=True)
class FlightLooks:
    """Looks in order of arrival, at a revision of the map. `lost`: frames that saw the window, but whose originals cannot be
    read; `left_out`: of more than wanted."""

    revision: int
    looks: Sequence[GroundLook]
    lost: Sequence[str]
    left_out: int


def looks_at(view: FlightView, island: int, window: GroundWindow, most: int = MOST_LOOKS) -> FlightLooks:
    """All painted frames that see a window's middle, on the ground; of more than wanted those evenly spaced in order of arrival.
    Raises UsageError where no two of them can be read."""
    table = view.table()
    point = (window.x, window.y, window.x, window.y)
    near = [table.frames[index].number for index in table.near(island, point)]
    painted = [(number, one) for number in near if (one := view.painted(number)) is not None and _sees(one, window)]
    if not painted:
        raise UsageError(nobody_sees(island, window.x, window.y))
    looks, lost = list[GroundLook](), list[str]()
    for number, one in spread(painted, most):
        look = read_look(view, number, one, window)
        lost.append(one.name) if look is None else looks.append(look)
    if len({one.image.shape[2] for one in looks}) > 1:
        looks = [as_grey(one) for one in looks]
    if len(looks) < 2:
        raise UsageError(too_few(len(painted), lost))
    return FlightLooks(table.revision, looks, lost, max(0, len(painted) - most))


def spread(some: Sequence[Some], most: int) -> list[Some]:
    """All, or so many of them, as evenly spaced as can be, from the first to the last."""
    if len(some) <= most:
        return list(some)
    return [some[at] for at in np.linspace(0, len(some) - 1, most).round().astype(int).tolist()]


def as_grey(look: GroundLook) -> GroundLook:
    """With one band."""
    return look if look.image.shape[2] == 1 else replace(look, image=look.image.mean(axis=2, keepdims=True))


def _sees(painted: RenderItem, window: GroundWindow) -> bool:
    x, y = pixels_of(painted, np.array([[window.x, window.y]]))[0].tolist()
    (left, top), (right, bottom) = painted.dead.limits(painted.camera.width, painted.camera.height)
    return bool(left < x < right and top < y < bottom)  # NaN is outside too


def read_look(
    view: FlightView,
    number: int,
    painted: RenderItem,
    window: GroundWindow,
    within: Heights = (LOWEST, HIGHEST),
    read: ReadOriginal | None = None,
) -> GroundLook | None:
    """What a frame may show of a window in a focus within some heights. None where the original cannot be read, or is of
    another kind than what was painted. `read`: instead of `original_pixels`."""
    record = view.frame(number)
    if record is None or not record.width:
        return None
    scale = record.width / painted.camera.width
    reduction = _reduction(painted, window, scale)
    image = (read or original_pixels)(view, record, reduction)
    if isinstance(image, Unreadable) or not painted.display.fits(image):
        return None
    cut = _cut(painted, image, window, reduction / scale, within)
    return coarsened(cut, window, reduction * _own(painted, window, scale))


def _reduction(painted: RenderItem, window: GroundWindow, scale: float) -> int:
    """So many times smaller the original is read, and still is as fine as the window's pixels."""
    own = _own(painted, window, scale)
    return max(one for one in REDUCTIONS if one == 1 or one * own <= window.cell)


def _own(painted: RenderItem, window: GroundWindow, scale: float) -> float:
    """Canvas units of a pixel of the original at the window's middle, or at the frame's where it does not see that. `scale`: px
    of the original for each of the camera's."""
    middle = pixels_of(painted, np.array([[window.x, window.y]]))
    size = np.array([painted.camera.width, painted.camera.height])
    if not ((middle >= 0) & (middle < size)).all():  # NaN is neither
        middle = size[None] / 2
    return float(ground_sampling_distance(painted.pose, painted.camera, middle)[0]) / scale


def coarsened(look: GroundLook, window: GroundWindow, gsd: float) -> GroundLook:
    """No finer than the window's pixels, so that what is kept does not grow with the ground that a lens is laid over. `gsd`: of
    the look's image, in canvas units. Up to a pixel of the window is lost at the right and at the bottom."""
    height, width = look.image.shape[:2]
    times = min(int(window.cell / gsd), height, width)
    if times < 2:
        return look
    rows, columns = height // times, width // times
    whole = look.image[: rows * times, : columns * times]
    image = np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
    return replace(look, image=image.reshape(rows, columns, -1), reduction=look.reduction * times)


def _cut(painted: RenderItem, image: Bands, window: GroundWindow, reduction: float, within: Heights) -> GroundLook:
    """What may be seen of the window, in grey levels of one light. `reduction`: px of the camera per px of image."""
    left, top, right, bottom = _box(painted, image, window, reduction, within)
    low, high = np.array([left, top]) * reduction, np.array([right, bottom]) * reduction
    levels = painted.display.levels(image[top:bottom, left:right]).astype(np.float32)
    bright = _brightening(painted, (left, top, right, bottom), reduction)
    levels *= np.asarray(painted.gain, np.float32)
    if bright is not None:
        levels *= bright
    # Of the whole: a window may show tarmac alone. A quarter of the usual sample tells a share of a hundredth well enough.
    some = painted.display.levels(sample_of(image)[::2, ::2])
    one_band = is_grey(some)
    return GroundLook(
        name=painted.name,
        pose=painted.pose,
        camera=painted.camera,
        image=np.ascontiguousarray(levels[..., : 1 if one_band else None], np.float32),
        relief=plane_of(painted.relief, painted.camera, low, high),
        left=left * reduction,
        top=top * reduction,
        reduction=reduction,
        dead=painted.dead,
        still=painted.still,
        area=painted.area,
        heat=not one_band and is_brighter_where_warmer(some),
    )


def _brightening(painted: RenderItem, box: PixelBox, reduction: float) -> FloatImage | None:
    """Factor (h, w, bands or 1) of the pixels of a box besides the gain, bilinear between STEPs as on tiles; None for 1."""
    left, top, right, bottom = box
    x = left + STEP * np.arange(-(-(right - left) // STEP) + 1)
    y = top + STEP * np.arange(-(-(bottom - top) // STEP) + 1)
    nodes = np.stack(np.meshgrid(x * reduction - 0.5, y * reduction - 0.5), axis=-1).astype(np.float32)
    found = brightening_of(painted, nodes)
    if found is None:
        return None
    size, bands = (bottom - top, right - left), found.shape[2]
    if bands <= MOST_AT_ONCE:
        return between_steps(found.astype(np.float64), *size).reshape(*size, bands)
    return np.stack([between_steps(found[..., band].astype(np.float64), *size) for band in range(bands)], axis=-1)


def _box(
    painted: RenderItem, image: FloatImage | Bands, window: GroundWindow, reduction: float, within: Heights
) -> PixelBox:
    """Columns and rows of the image that show the window at any of these heights."""
    above = camera_height(painted.pose, painted.camera)
    places = _some_of(*window.lattice())
    seen = np.vstack([_pixels(painted, places, share * above) for share in (within[0], sum(within) / 2, within[1])])
    seen = seen[np.isfinite(seen).all(axis=1)]
    size = np.array([image.shape[1], image.shape[0]])
    if not len(seen):
        return 0, 0, int(size[0]), int(size[1])
    low = np.clip(np.floor(seen.min(axis=0) / reduction - RIM), 0, size - 1).astype(int)
    high = np.clip(np.ceil(seen.max(axis=0) / reduction + RIM), low + 1, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _some_of(places: PointsNx2, count: int) -> PointsNx2:
    """Of places in a square of count x count those on its rim, and some within, for the box around all of them."""
    along = np.unique(np.linspace(0, count - 1, min(count, ENOUGH_PLACES)).astype(np.intp))
    return np.asarray(places.reshape(count, count, 2)[np.ix_(along, along)].reshape(-1, 2))


def _pixels(painted: RenderItem, places: PointsNx2, height: float) -> PointsNx2:
    return pixels_at(painted.pose, painted.camera, painted.relief, places, height)

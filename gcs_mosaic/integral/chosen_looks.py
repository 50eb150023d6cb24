"""Which of many looks are laid together on a part of the map: as few as tell nearly all that they all do.

Noise and leaves fall with the root of the number of looks, and two looks through one gap are one: so they are taken as far from
each other as can be, and more than `MOST_LOOKS` only where one of them sees a place that fewer see.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_mosaic.integral.focal_plane import pixels_at
from gcs_mosaic.integral.stack import GroundWindow
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Mask, PointsNx2

MOST_LOOKS = 20  # at a place
PLACES = 17  # along a side of a window


def chosen(looks: Sequence[RenderItem], window: GroundWindow) -> list[int]:
    """Indices, in order of arrival, of the looks to be laid on a window at about the map's ground. One that sees a place with too
    few looks, or is beside such a place, is always among them."""
    if len(looks) <= MOST_LOOKS:
        return list(range(len(looks)))
    along = (np.arange(PLACES) / (PLACES - 1) - 0.5) * window.side
    x, y = np.meshgrid(window.x + along, window.y + along)
    places = np.column_stack([x.ravel(), y.ravel()])
    sees = [_sees(one, places).reshape(PLACES, PLACES) for one in looks]
    wanted = np.minimum(np.sum(sees, axis=0), MOST_LOOKS)
    counts = np.zeros((PLACES, PLACES), np.intp)
    found = []
    for index in _spread_out(np.array([[one.pose.x, one.pose.y] for one in looks]), np.array([window.x, window.y])):
        if not sees[index].any() or (counts < wanted)[_and_beside(sees[index])].any():
            counts += sees[index]
            found.append(index)
    return sorted(found)


def _spread_out(nadirs: PointsNx2, middle: PointsNx2) -> list[int]:
    """All indices: the one nearest to the middle (2,), then ever the one farthest from those before (T. F. Gonzalez, Theoretical
    Computer Science 38, 1985)."""
    order = [int(np.linalg.norm(nadirs - middle, axis=1).argmin())]
    away = np.linalg.norm(nadirs - nadirs[order[0]], axis=1)
    away[order[0]] = -1
    while len(order) < len(nadirs):
        order.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(nadirs - nadirs[order[-1]], axis=1))
        away[order] = -1
    return order


def _sees(look: RenderItem, places: PointsNx2) -> Mask:
    pixels = pixels_at(look.pose, look.camera, look.relief, places, 0.0)
    (left, top), (right, bottom) = look.dead.limits(look.camera.width, look.camera.height)
    return np.asarray(((pixels > [left, top]) & (pixels < [right, bottom])).all(axis=1))  # NaN is outside too


def _and_beside(sees: Mask) -> Mask:
    """With the eight neighbours of each place (n, n)."""
    wide = np.pad(sees, 1)
    sides = range(3)
    return np.asarray(
        np.logical_or.reduce(
            [wide[down : down + PLACES, across : across + PLACES] for down in sides for across in sides]
        )
    )

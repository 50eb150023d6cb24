"""A place on the map -> the original frames that saw it, the best first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import PointsNx2
from gcs_mosaic.stitch.camera.geometry import ground_sampling_distance
from gcs_mosaic.views.flight_view import FlightView, pixels_of
from gcs_mosaic.views.sharpness import sharpest
from gcs_mosaic.views.taken import Clock

if TYPE_CHECKING:
    from gcs_mosaic.store.ledger import Ledger
    from gcs_mosaic.store.records import FrameRecord

MOST = 200  # frames in one answer: more looks than anybody takes
RIM = 0.125  # of a frame's shorter side: nearer to its border a look is worth less, down to half of it at the border itself


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """One frame's look at a place. Pixels are those of the original file, counted from the centre of its top left one."""

    number: int
    name: str
    utc: float | None  # when it was taken, seconds since 1970, by `clock`
    width: int  # px, of the original
    height: int
    x: float
    y: float
    canvas_per_px: float  # ground resolution at this spot, canvas units per pixel of the original
    border_px: float  # from the frame's border
    covered: bool  # it is not painted itself, another frame shows all that it does
    sharpness: float | None  # as in `FrameRecord`
    clock: Clock | None = None  # see `CaptureTime`
    as_sharp: float = 1.0  # its sharpness as a share of that of the sharpest look at this place

    @property
    def worth(self) -> float:
        """Pixels per canvas unit, as many as are sharp; less near the border, where lenses are soft and what is sought may be cut
        off."""
        rim = RIM * min(self.width, self.height)
        return self.as_sharp * (0.5 + 0.5 * min(self.border_px / rim, 1.0)) / self.canvas_per_px


def sightings(view: FlightView, island: int, x: float, y: float) -> list[Sighting]:
    """Who saw a place on an island's canvas, the best first, by ground resolution, sharpness and distance from the border."""
    table, place = view.table(), np.array([[x, y]])
    near = [table.frames[index] for index in table.near(island, (x, y, x, y))]
    found: list[Sighting] = []
    if not near:
        return found
    with view.ledger() as ledger:
        for position in near:
            painted = ledger.painted_frame(position.number)
            if painted is not None and painted.island == island:
                found += _looks(ledger, position.number, painted, pixels_of(painted, place))
        shares = sharpest([one.sharpness for one in found]).tolist()
        compared = [replace(one, as_sharp=share) for one, share in zip(found, shares, strict=True)]
        return [_dated(view, ledger, one) for one in sorted(compared, key=lambda one: -one.worth)[:MOST]]


def _dated(view: FlightView, ledger: Ledger, one: Sighting) -> Sighting:
    frame = ledger.frame(one.number)
    taken = None if frame is None else view.times.of(frame, ledger.message_time(one.number))
    return one if taken is None else replace(one, utc=taken.s, clock=taken.by)


def _looks(ledger: Ledger, number: int, painted: RenderItem, pixel: PointsNx2) -> Iterator[Sighting]:
    """Of a painted frame, and of those that it covers."""
    gsd = float(ground_sampling_distance(painted.pose, painted.camera, pixel)[0])
    own = ledger.frame(number)
    if own is not None and np.isfinite(gsd):
        size = own.width or painted.camera.width, own.height or painted.camera.height
        scale = size[0] / painted.camera.width
        dead = [lines * scale for lines in painted.dead]
        deep = _depth(painted, pixel) * scale
        yield from _look(number, own, size, _original(pixel, scale), gsd / scale, dead, deep)
        for hidden, other, keyframe_from_frame in ledger.covered_by(number):
            size = other.width or size[0], other.height or size[1]
            seen = _original(_mapped(np.linalg.inv(np.array(keyframe_from_frame)), pixel), scale)
            yield from _look(hidden, other, size, seen, gsd / scale, None)


def _depth(painted: RenderItem, pixel: PointsNx2) -> float:
    """How far a pixel (1, 2) is from what holds no picture, px; infinite where all does."""
    if painted.area is None:
        return np.inf
    return float(painted.area.depth(pixel, painted.camera.width, painted.camera.height)[0])


def _look(
    number: int,
    frame: FrameRecord,
    size: tuple[int, int],
    pixel: PointsNx2,
    canvas_per_px: float,
    dead: Sequence[float] | None,
    deep: float = np.inf,
) -> Iterator[Sighting]:
    (x, y), (width, height) = pixel[0].tolist(), size
    left, top, right, bottom = dead or (0.0, 0.0, 0.0, 0.0)
    border = min(x + 0.5 - left, y + 0.5 - top, width - right - 0.5 - x, height - bottom - 0.5 - y, deep)
    if border > 0:  # NaN is outside too
        yield Sighting(
            number=number,
            name=frame.name,
            utc=None,
            width=width,
            height=height,
            x=x,
            y=y,
            canvas_per_px=canvas_per_px,
            border_px=border,
            covered=dead is None,
            sharpness=frame.sharpness,
        )


def _original(pixels: PointsNx2, scale: float) -> PointsNx2:
    """Pixels of a reduced picture as pixels of the original."""
    return np.asarray((pixels + 0.5) * scale - 0.5)


def _mapped(homography: PointsNx2, pixels: PointsNx2) -> PointsNx2:
    homogeneous = np.column_stack([pixels, np.ones(len(pixels))]) @ homography.T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])

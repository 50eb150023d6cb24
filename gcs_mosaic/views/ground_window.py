"""What a frame shows of a window of the ground, laid on the map's plane: all of one orientation, scale and middle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.dense_places import STEP, between_steps, sampled
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Bands, FloatImage, Lattice, Mask, PointsNx2
from gcs_mosaic.stitch.camera.geometry import ground_sampling_distance
from gcs_mosaic.views.coverage import Grid
from gcs_mosaic.views.even_light import flattened
from gcs_mosaic.views.flight_view import FlightView, pixels_of
from gcs_mosaic.views.pictures import REDUCTIONS, NoPicture, displayed

if TYPE_CHECKING:  # it loads what stitches, which the page starts without
    from gcs_mosaic.stitch.graph.placement import Homography

UNSEEN = 34  # grey level where a frame shows nothing: that of the page behind it


@dataclass(frozen=True, slots=True)
class OnGround:
    """How a frame lies; of one that another covers that one, and `keyframe_from_frame`."""

    painted: RenderItem
    keyframe_from_frame: Homography | None = None

    def pixels(self, places: PointsNx2) -> PointsNx2:
        """Pixels (n, 2) of the frame at canvas places (n, 2); NaN where the lens cannot see them."""
        seen = pixels_of(self.painted, places)
        if self.keyframe_from_frame is None:
            return seen
        mapped = np.column_stack([seen, np.ones(len(seen))]) @ np.linalg.inv(np.array(self.keyframe_from_frame)).T
        return np.asarray(mapped[:, :2] / mapped[:, 2:])


def on_ground(view: FlightView, number: int) -> OnGround | None:
    """How a frame lies, painted or covered; None if it has no place. Raises UsageError."""
    painted = view.painted(number)
    if painted is not None:
        return OnGround(painted)
    with view.ledger() as ledger:
        keyframe = ledger.keyframe_of(number)
        covered = [] if keyframe is None else ledger.covered_by(keyframe)
        painted = None if keyframe is None else ledger.painted_frame(keyframe)
    found = [homography for hidden, _, homography in covered if hidden == number]
    return OnGround(painted, found[0]) if painted is not None and found else None


def aligned_look(view: FlightView, number: int, island: int, window: Grid) -> Bands:
    """A frame's look at a window, (rows, columns, 3) BGR; what it does not see is dark grey. Raises NoPicture."""
    try:
        lies = on_ground(view, number)
    except UsageError as error:
        raise NoPicture("There is no flight here yet.", passing=True) from error
    if lies is None or lies.painted.island != island:
        raise NoPicture("This frame does not lie there.")
    image = displayed(view, number, reduction_for(view, number, lies.painted, window))
    shown, seen = laid(lies, image, window)
    if not seen.any():
        raise NoPicture("This frame does not see that place.")
    shown[~seen] = UNSEEN
    return shown


def flat_picture(view: FlightView, number: int, lies: OnGround, window: Grid, around: float) -> FloatImage | None:
    """A frame (h, w) as `flattened` over so many cells, about as fine as a window's cells; None if it cannot be shown. Raises
    NoPicture where that passes."""
    try:
        image = displayed(view, number, reduction_for(view, number, lies.painted, window))
    except NoPicture as reason:
        if reason.passing:
            raise
        return None
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    wide = lies.painted.camera.width * float(np.exp(lies.painted.pose.log_gsd)) / window.cell
    if wide < grey.shape[1]:
        size = max(8, round(wide)), max(8, round(wide * grey.shape[0] / grey.shape[1]))
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
    return flattened(grey, around)


def reduction_for(view: FlightView, number: int, painted: RenderItem, window: Grid) -> int:
    """So many times smaller the original may be read, and still is as fine as the window's cells."""
    middle = pixels_of(painted, np.array([window.place_of(window.columns / 2, window.rows / 2)]))
    record = view.frame(number)
    width = record.width if record is not None and record.width else painted.camera.width
    own = float(ground_sampling_distance(painted.pose, painted.camera, middle)[0]) * painted.camera.width / width
    return max(one for one in REDUCTIONS if one == 1 or one * own <= window.cell)


def laid(lies: OnGround, image: Bands, window: Grid) -> tuple[Bands, Mask]:
    """An image (h, w, bands) of a frame, reduced or not, on a window: (rows, columns, bands), and where it is seen."""
    at = _places(lies, image.shape[1], window)
    seen = _seen(lies.painted, at, image)
    return sampled(image, at), seen


def _places(lies: OnGround, width: int, window: Grid) -> Lattice:
    """Pixels (rows, columns, 2) of an image so wide at the window's cells; NaN where the lens cannot see them."""
    down, across = -(-window.rows // STEP) + 1, -(-window.columns // STEP) + 1
    x, y = np.meshgrid(np.arange(across) * STEP * window.cell, np.arange(down) * STEP * window.cell)
    pixels = lies.pixels(np.column_stack([window.left + x.ravel(), window.top + y.ravel()]))
    per_pixel = width / lies.painted.camera.width
    exact = ((pixels + 0.5) * per_pixel - 0.5).reshape(down, across, 2)
    return between_steps(exact, window.rows, window.columns)


def _seen(painted: RenderItem, at: Lattice, image: Bands) -> Mask:
    per_pixel = image.shape[1] / painted.camera.width
    low, high = painted.dead.limits(painted.camera.width, painted.camera.height)
    least = tuple((np.array(low) + 0.5) * per_pixel - 0.5)
    most = tuple((np.array(high) + 0.5) * per_pixel - 0.5)
    seen = np.asarray(cv2.inRange(at, least, most) > 0)
    if painted.area is None:
        return seen
    depth = painted.area.depth(at.reshape(-1, 2), image.shape[1], image.shape[0])
    return np.asarray(seen & (depth.reshape(seen.shape) > 0))

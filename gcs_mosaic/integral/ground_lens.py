"""A lens over a place of the map: its looks are kept in memory, so that moving the focus or the aperture only lays them anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.integral.aperture import SyntheticAperture, aperture_of
from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST, MOST_LOOKS, looks_at
from gcs_mosaic.integral.focal_plane import camera_height
from gcs_mosaic.integral.focus import Focus, ground_focus
from gcs_mosaic.integral.forms import LEAST_LOOKS
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, LookStack, laid_together
from gcs_mosaic.integral.why_not import apart, beyond
from gcs_mosaic.stitch.arrays import Vector2
from gcs_mosaic.stitch.camera.geometry import ground_sampling_distance
from gcs_mosaic.views.flight_view import FlightView, pixels_of
from gcs_mosaic.views.focal_lengths import focal_deviation


@dataclass(frozen=True, slots=True, eq=False)
class GroundLens:
    """The looks at a window of an island. Heights are shares of the flying height, above the map's ground: what images tell of
    heights does not depend on the focal length then."""

    revision: int  # of the map when it was opened
    window: GroundWindow
    looks: Sequence[GroundLook]
    lost: Sequence[str]  # frames whose originals cannot be read
    left_out: int  # looks beyond those that are kept in memory
    focal_deviation: float | None = (
        None  # of the log of the focal length, by which heights are in canvas units; None: not known
    )

    @property
    def middle(self) -> Vector2:
        return np.array([self.window.x, self.window.y])

    @property
    def flying_height(self) -> float:
        """Canvas units: that of the middle one of the looks."""
        return float(np.median([camera_height(one.pose, one.camera) for one in self.looks]))

    def opened(self, share: float) -> list[GroundLook]:
        """The looks of an aperture opened so far: those nearest to the middle of all that see the place, but two at least."""
        nadirs = np.array([[one.pose.x, one.pose.y] for one in self.looks])
        away = np.linalg.norm(nadirs - nadirs.mean(axis=0), axis=1)
        least = float(np.sort(away)[LEAST_LOOKS - 1])
        widest = max(share * float(away.max()), least)
        return [one for one, distance in zip(self.looks, away, strict=True) if distance <= widest]

    def stack(self, height: float, opened: float = 1.0) -> LookStack:
        """The looks on the plane at a height. Raises UsageError for one where nothing can be in focus."""
        return laid_together(self.opened(opened), self.window, self._units(height))

    def focus(self) -> Focus:
        """The ground's height as the looks tell it."""
        return ground_focus(self.looks, self.window, self.flying_height, self.aperture(0.0))

    def aperture(self, height: float, opened: float = 1.0) -> SyntheticAperture:
        """Of the looks at the middle. Raises UsageError where they do not overlap at this height."""
        found = aperture_of(self.opened(opened), self.middle, self._units(height))
        if found.looks < LEAST_LOOKS:
            raise UsageError(apart(height, found.looks, len(self.looks)))
        return found

    def _units(self, height: float) -> float:
        """Canvas units of a height. Raises UsageError for one where nothing can be in focus."""
        if not LOWEST <= height <= HIGHEST:
            raise UsageError(beyond(height, LOWEST, HIGHEST))
        return height * self.flying_height


def ground_lens(
    view: FlightView,
    island: int,
    place: tuple[float, float],
    cells: int,
    side: float | None = None,
    most: int = MOST_LOOKS,
) -> GroundLens:
    """A lens of cells x cells pixels about a place on an island's canvas: `side` canvas units wide, else as fine as the middle
    one of its looks, of which `most` are kept. Raises UsageError where no two frames see it, or can be read."""
    x, y = place
    cell = _usual_cell(view, island, place) if side is None else side / cells
    window = GroundWindow(x, y, cell * cells, cells)
    found = looks_at(view, island, window, most)
    deviation = focal_deviation(view, {one.name for one in found.looks})
    return GroundLens(found.revision, window, found.looks, found.lost, found.left_out, deviation)


def _usual_cell(view: FlightView, island: int, place: tuple[float, float]) -> float:
    """Canvas units of a pixel of the middle one of those that see a place; 1 where nobody does."""
    x, y = place
    table, at, gsds = view.table(), np.array([place]), list[float]()
    for index in table.near(island, (x, y, x, y)):
        painted = view.painted(table.frames[index].number)
        if painted is not None:
            gsds.append(float(ground_sampling_distance(painted.pose, painted.camera, pixels_of(painted, at))[0]))
    known = [one for one in gsds if np.isfinite(one) and one > 0]
    return float(np.median(known)) if known else 1.0

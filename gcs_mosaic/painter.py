"""Decides what is painted when: new frames at once, frames that an adjustment has moved when there is time."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np

from gcs_mosaic.stitch.bands import Bands
from gcs_mosaic.stitch.geometry import (
    Array,
    Camera,
    Pose,
    canvas_from_pixels,
    pixel_grid,
    pixels_from_canvas,
    reduced_view,
)
from gcs_mosaic.stitch.painting.canvas import Canvas, CanvasSettings
from gcs_mosaic.stitch.painting.display import Display, display_of
from gcs_mosaic.stitch.painting.exposure import (
    ExposureSettings,
    Gain,
    Levels,
    Observation,
    OverlapMeans,
    gain_beside,
    overlap_means,
    solve_gains,
)
from gcs_mosaic.stitch.painting.levels import PaintingLevels
from gcs_mosaic.stitch.painting.painted import Painted, TileKey, brightness_apart
from gcs_mosaic.stitch.painting.vignetting import Vignetting, VignettingEstimate, VignettingSettings
from gcs_mosaic.stitch.placement import Placement
from gcs_mosaic.stitch.relief.displacement import ReliefDisplacement, on_plane

LoadImage = Callable[[str], Bands | None]

CHECKED_AT_ONCE = 64  # frames whose displacement is looked at between two new frames: some hundredths of a second
MOVED_AT_ONCE = 2  # frames whose tiles are found anew between two new frames: a tenth of a second each at 12 MP
LIVE_BLOCK = 12  # tiles a side that are repainted together during a flight: a new frame waits 0.2 s for their writing


@dataclass(frozen=True, slots=True, kw_only=True)
class PaintSettings:
    """When what is painted."""

    canvas: CanvasSettings = field(default_factory=CanvasSettings)
    exposure: ExposureSettings = field(default_factory=ExposureSettings)
    vignetting: VignettingSettings = field(default_factory=VignettingSettings)
    bands: tuple[int, ...] = ()  # shown as red, green, blue, or one as grey, counted from 1; none: told by their number
    repaint_px: float = 1.0  # how far a corner may be off, in the frame's own pixels, before the frame is repainted
    final_px: float = 0.25  # the same at the end of a flight, when there is time
    final_gain: float = 0.01  # relative change of brightness that is worth repainting at the end; nobody sees less

    def __post_init__(self) -> None:
        if len(self.bands) not in (0, 1, 3) or min(self.bands, default=1) < 1:
            raise ValueError(
                f"bands: expected one, or three as red, green, blue, counted from 1, got {list(self.bands)}"
            )


class Painter:
    """The canvas, and what is to be painted on it.

    `record(painted)` is called whenever a frame is painted or is to be painted otherwise, before its tiles change.
    """

    def __init__(
        self,
        load_image: LoadImage,
        record: Callable[[Painted], None],
        settings: PaintSettings,
        scratch: Path | None = None,
    ) -> None:
        self._settings = settings
        self._record = record
        self._load_image = load_image
        self.canvas = Canvas(load_image, settings.canvas, scratch=scratch)
        self._painted: dict[str, Painted] = {}
        self._displays: dict[
            tuple[int, str], Display
        ] = {}  # by number of bands and depth, from the first frame of each kind
        self._levels = PaintingLevels()
        self._thumbnails: dict[str, Levels] = {}
        self._overlaps: list[tuple[str, str, OverlapMeans]] = []
        self._vignetting: dict[tuple[int, int], VignettingEstimate] = {}  # by width and height: each size is one camera
        self._unchecked: dict[str, Placement] = {}  # where frames lie now that may have moved
        # Those that moved too far, and how far in their own pixels.
        self._stale: dict[str, tuple[float, Placement]] = {}
        self._repainting: Iterator[set[TileKey]] | None = None

    @property
    def has_repaints(self) -> bool:
        """Whether some frames lie, or may lie, elsewhere than where they are painted, by more than is tolerated."""
        waiting = bool(self._unchecked or self._stale)
        return waiting or self._repainting is not None or self.canvas.behind > 0

    def is_painted(self, name: str) -> bool:
        return name in self._painted

    def paint_new(self, image: Bands, thumbnail: Bands, placement: Placement, order: int) -> set[TileKey]:
        """Paint a frame for the first time; returns the tiles that look different now."""
        display = self._display_of(image)
        self._thumbnails[placement.name] = display.levels(thumbnail)
        pose, camera = reduced_view(placement.pose, placement.camera, image.shape[1], image.shape[0])
        overlaps = self._find_overlaps(placement, display)
        vignetting = self._vignetting_of(camera).curve
        painted = Painted(
            name=placement.name,
            order=order,
            island=placement.island,
            pose=pose,
            camera=camera,
            relief=placement.relief,
            gain=self._gain_of(overlaps, vignetting, display),
            vignetting=vignetting,
            display=display,
            level=0,  # until it is settled among the others'
        )
        painted = self._levels.settled(painted)
        self._note(painted)
        return self.canvas.paint(image, painted)

    def follow(self, placements: Iterable[Placement]) -> None:
        """Take note of where painted frames lie now; what is to be done about it is left to `repaint_some`."""
        self._unchecked |= {placement.name: placement for placement in placements if placement.name in self._painted}

    def repaint_some(self) -> set[TileKey] | None:
        """A frame's worth of repainting or less, what is most displaced first.

        Returns tiles that look different now, or None if all is as it should be. After the adjustment of a long flight
        there are thousands of frames to look at: every call deals with some, so that no new frame waits for the others.
        """
        if self._unchecked:
            self._check_some()
            return set()
        if self._stale:
            self._move_some()
            return set()
        if self._repainting is None:
            self._repainting = self.canvas.repaint(LIVE_BLOCK)
        changed = next(self._repainting, None)
        if changed is None:
            self._repainting = None
        return changed

    def repaint_all(self, placements: Iterable[Placement]) -> Iterator[set[TileKey]]:
        """Bring everything to its final pose and brightness; yields tiles that look different now, frame by frame."""
        self._unchecked.clear()
        self._stale.clear()
        self._repainting = None
        looks = self._final_looks()
        for painted in list(self._painted.values()):
            gain, vignetting = looks[painted.name]
            final = replace(painted, gain=gain, vignetting=vignetting)
            if brightness_apart(final, painted) > self._settings.final_gain:
                self._change(final)
        for placement in placements:
            if placement.name in self._painted:
                off_px = _displacement(self._painted[placement.name], placement)
                if off_px > self._settings.final_px:
                    self._move(placement, off_px)
        for painted in list(self._painted.values()):
            if (settled := self._levels.settled(painted)) != painted:
                self._change(settled)
        yield from self.canvas.repaint()

    def close(self) -> None:
        self.canvas.close()

    def _check_some(self) -> None:
        for name in list(islice(self._unchecked, CHECKED_AT_ONCE)):
            placement = self._unchecked.pop(name)
            off_px = _displacement(self._painted[name], placement)
            self._stale.pop(name, None)
            if off_px > self._settings.repaint_px:
                self._stale[name] = off_px, placement

    def _move_some(self) -> None:
        for name in heapq.nlargest(MOVED_AT_ONCE, self._stale, key=lambda name: self._stale[name][0]):
            off_px, placement = self._stale.pop(name)
            self._move(placement, off_px)

    def _move(self, placement: Placement, off_px: float) -> None:
        painted = self._painted[placement.name]
        pose, camera = reduced_view(placement.pose, placement.camera, painted.camera.width, painted.camera.height)
        moved = replace(painted, island=placement.island, pose=pose, camera=camera, relief=placement.relief)
        self._change(self._levels.settled(moved), off_px)

    def _change(self, painted: Painted, urgency: float = 0.0) -> None:
        self._note(painted)
        self.canvas.move([painted], urgency)

    def _note(self, painted: Painted) -> None:
        self._record(painted)
        self._painted[painted.name] = painted

    def _display_of(self, image: Bands) -> Display:
        kind = image.shape[2], str(image.dtype)
        if kind not in self._displays:
            self._displays[kind] = display_of(image, self._settings.bands)
        return self._displays[kind]

    def _find_overlaps(self, placement: Placement, display: Display) -> list[tuple[OverlapMeans, Painted]]:
        """What a new frame has in common with painted ones of the same kind; kept for the end, and told the vignetting."""
        found: list[tuple[OverlapMeans, Painted]] = []
        for name in placement.neighbours:
            painted = self._painted.get(name)
            if painted is not None and painted.island == placement.island and painted.display == display:
                means = self._overlap(placement, painted)
                if means is not None:
                    self._overlaps.append((placement.name, name, means))
                    found.append((means, painted))
                    self._vignetting_of(painted.camera).add(means.radial)
        return found

    def _vignetting_of(self, camera: Camera) -> VignettingEstimate:
        size = camera.width, camera.height
        return self._vignetting.setdefault(size, VignettingEstimate(self._settings.vignetting))

    def _gain_of(
        self, overlaps: Sequence[tuple[OverlapMeans, Painted]], vignetting: Vignetting, display: Display
    ) -> Gain:
        """The brightness that fits the painted frames which a new one overlaps."""
        beside = [(means.flattened(vignetting, other.vignetting), other.gain) for means, other in overlaps]
        return gain_beside(beside, self._settings.exposure, len(display.black))

    def _overlap(self, placement: Placement, painted: Painted) -> OverlapMeans | None:
        small_i, small_j = self._thumbnails[placement.name], self._thumbnails[painted.name]
        scale_i = placement.camera.width / small_i.shape[1]
        scale_j = painted.camera.width / small_j.shape[1]

        def j_from_i(pixels: Array) -> Array:
            places = canvas_from_pixels(placement.pose, placement.camera, (pixels + 0.5) * scale_i - 0.5)
            seen = pixels_from_canvas(painted.pose, painted.camera, places)
            return np.asarray((seen + 0.5) / scale_j - 0.5)

        return overlap_means(small_i, small_j, j_from_i)

    def _final_looks(self) -> dict[str, tuple[Gain, Vignetting]]:
        """Gain and vignetting of each frame by all that is known."""
        curves = {name: self._vignetting_of(painted.camera).curve for name, painted in self._painted.items()}
        gains: dict[str, Gain] = {}
        for display in self._displays.values():  # frames of different kinds tell nothing of each other's exposure
            names = {name: i for i, name in enumerate(n for n, p in self._painted.items() if p.display == display)}
            seen: list[Observation] = [
                (names[i], names[j], means.flattened(curves[i], curves[j]))
                for i, j, means in self._overlaps
                if i in names
            ]
            solved = solve_gains(len(names), seen, self._settings.exposure, len(display.black))
            gains |= dict(zip(names, solved, strict=True))
        return {name: (gains[name], curves[name]) for name in self._painted}


def _displacement(painted: Painted, placement: Placement) -> float:
    """How far the frame is painted from where it should be, at most, in the frame's own pixels."""
    if painted.island != placement.island:
        return np.inf
    there = _places(painted.pose, painted.camera, painted.relief)
    here = _places(placement.pose, placement.camera, placement.relief)
    off = np.linalg.norm(there - here, axis=1) / np.exp(placement.pose.log_gsd)
    return float(np.nanmax(off)) if np.isfinite(off).any() else np.inf


def _places(pose: Pose, camera: Camera, relief: ReliefDisplacement | None) -> Array:
    """Canvas places of points all over the frame, (n, 2); NaN above the horizon."""
    pixels = pixel_grid(camera, 9, 7)
    return canvas_from_pixels(pose, camera, on_plane(relief, camera, pixels))

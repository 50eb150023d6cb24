"""Repaint queue: new frames are painted at once, frames moved by an adjustment when idle."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from gcs_mosaic.render.agreement import Aircraft
from gcs_mosaic.render.brightness import Brightness, Camera
from gcs_mosaic.render.camera_ranges import CameraRanges
from gcs_mosaic.render.compositor import BLOCK, CompositorSettings, TileCompositor
from gcs_mosaic.render.displacement import displacement
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.exposure import ExposureSettings
from gcs_mosaic.render.levels import PaintingLevels, coarser_at_first
from gcs_mosaic.render.render_list import RenderItem, TileKey, brightness_apart
from gcs_mosaic.render.vignetting import VignettingSettings
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, BorderWatch, DeadBorder
from gcs_mosaic.stitch.camera.geometry import reduced_view
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.features.extraction import Features, without_border
from gcs_mosaic.stitch.features.shelf import Shelve
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.transaction import Kept

BRIGHTNESS = ("as_taken", "auto")
CHECKED_AT_ONCE = 64  # frames whose displacement is checked between two new frames: some hundredths of a second
MOVED_AT_ONCE = 2  # frames whose tiles are recomputed between two new frames: a tenth of a second each at 12 MP
MOVED_TOGETHER = 8  # at the end, computed in parallel
OVERLAY_DIFFERS = 0.03  # of a frame: less is its outline, for which not all frames are repainted
SHARPENED_TOGETHER = 4  # of overlapping frames: one by one, the ground that they share would be painted as often
NEWER = 4  # frames that stay coarse while there are newer ones: what they show is still changed by the next
BLURRED_PX = 4.0  # displacement of a frame that is as bad as a coarse one: what looks worse is mended first
PAUSE_S = 3.0  # without a new frame: then fewer are sharpened too
LULL_S = 6.0  # without a new frame: all that waits is repainted together, so that each original is decoded once
LIVE_BLOCK = (
    8  # tiles a side repainted together during a flight: fewer share frames, more are seldom done before the next frame
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PaintSettings:
    """When and how frames are painted."""

    canvas: CompositorSettings = field(default_factory=CompositorSettings)
    exposure: ExposureSettings = field(default_factory=ExposureSettings)
    vignetting: VignettingSettings = field(default_factory=VignettingSettings)
    bands: tuple[int, ...] = ()  # as red, green, blue, or one as grey, counted from 1; empty: chosen by their number
    # "as_taken", or "auto": if the first frame is dark (of 16 bits: all so far), tiles are brightened. Matching is not affected.
    brightness: str = "as_taken"
    repaint_px: float = 1.0  # displacement of a corner, in the frame's own pixels, beyond which it is repainted
    final_px: float = 0.25  # the same at the end of a flight, when there is time
    final_gain: float = 0.01  # relative change of brightness worth repainting at the end; smaller ones are invisible

    def __post_init__(self) -> None:
        if self.brightness not in BRIGHTNESS:
            raise ValueError(f"brightness: {self.brightness!r} is not one of {', '.join(BRIGHTNESS)}")
        if len(self.bands) not in (0, 1, 3) or min(self.bands, default=1) < 1:
            raise ValueError(
                f"bands: expected one, or three as red, green, blue, counted from 1, got {list(self.bands)}"
            )


@dataclass(frozen=True, slots=True)
class Step:
    """A unit of repainting. `do` returns the tiles that change. If it raises and its changes are rolled back, `skip` abandons it
    for good: `what` stays painted as it is, and the other steps proceed."""

    what: str
    do: Callable[[], set[TileKey]]
    skip: Callable[[], object]


class RepaintQueue(Kept):
    """The queue of what is to be painted on a canvas, which it closes.

    A large frame is painted coarsely at first, so that its ground is on the map soon, and sharpened together with the next ones.
    `record(painted)` is called whenever a frame is painted or is to be repainted, before its tiles change. If not `live`, new
    frames wait for repainting. `shelve`: where their thumbnails go.
    """

    FIXED = frozenset({"_record", "_newest_s"})  # the latter by a clock that begins anew with each start

    def __init__(
        self,
        canvas: TileCompositor,
        record: Callable[[RenderItem], None],
        settings: PaintSettings,
        *,
        live: bool = True,
        shelve: Shelve | None = None,
    ) -> None:
        self._settings = settings
        self._live = live
        self._record = record
        self.canvas = canvas
        self._painted: dict[str, RenderItem] = {}
        self._ranges = CameraRanges(settings.bands, lighten=settings.brightness == "auto")
        self._refitted = False  # whether parts of the map may still show a range that was fitted anew since
        self._levels = PaintingLevels()
        self._borders: dict[Camera, BorderWatch] = {}
        self._overlays: dict[Camera, StillMask] = {}
        self._brightness = Brightness(settings.exposure, settings.vignetting, self._dead_of, shelve)
        self._changed: dict[str, float] = {}  # frames the canvas is to be told of, with their urgency
        self._coarse: dict[str, None] = {}  # frames painted coarsely at first, to be sharpened
        self._newest_s = -PAUSE_S  # when the newest frame was painted
        self._rimmed: dict[str, None] = {}  # frames painted with an outdated dead border, overlay or display
        self._unchecked: dict[str, Placement] = {}  # present placements of frames that may have moved
        # Frames displaced too far, with their displacement in their own pixels.
        self._stale: dict[str, tuple[float, Placement]] = {}

    def resume(self, shown: Iterable[RenderItem]) -> set[TileKey]:
        """Go on after `load`. The tiles on the disk show these frames so; they are stale until they are repainted. Returns all
        tiles that may be on the disk, others show what is nowhere painted any more."""
        before = list(shown)
        tiles = self.canvas.resume(before)
        self.canvas.remove([painted.name for painted in before if painted.name not in self._painted])
        self.canvas.move(self._painted.values())
        self._changed.clear()
        return tiles

    def painted(self) -> list[RenderItem]:
        """How each frame is to be painted now."""
        return list(self._painted.values())

    @property
    def has_repaints(self) -> bool:
        """Whether some frames are, or may be, displaced from where they are painted by more than the tolerance, or are to be
        sharpened now."""
        waiting = self._unchecked or self._stale or self._rimmed or self._changed or self._to_be_sharpened()
        return bool(waiting) or self.canvas.behind > 0

    @property
    def shows_old_range(self) -> bool:
        """Whether parts of the map are still shown in a range of counts that was fitted anew since."""
        return self._refitted and self.has_repaints

    def is_painted(self, name: str) -> bool:
        return name in self._painted

    def in_sight(self, features: Features, image: Bands, aircraft: Aircraft = None) -> Features:
        """Features of a frame (full-resolution pixels) without those near a dead border; its image as painted."""
        dead = self._dead_of(_camera_of(image, aircraft))
        return without_border(features, dead.scaled(features.width / image.shape[1]))

    def begin_look(self, name: str, image: Bands, aircraft: Aircraft = None, area: PictureArea | None = None) -> None:
        """Begin to analyse a frame's image while it is being placed."""
        camera = _camera_of(image, aircraft)
        display = self._ranges.known(image, camera)
        if self._live and display is not None:
            self.canvas.begin_look(name, image, display, self._dead_of(camera), area)

    def paint_new(self, image: Bands, thumbnail: Bands, placement: Placement, order: int) -> set[TileKey]:
        """Paint a frame for the first time; returns the tiles that changed."""
        ground = image if placement.area is None else placement.area.filled(image)
        pose, camera = reduced_view(placement.pose, placement.camera, image.shape[1], image.shape[0])
        whose = _camera_of(image, placement.aircraft)
        new = RenderItem(
            name=placement.name,
            order=order,
            island=placement.island,
            pose=pose,
            camera=camera,
            relief=placement.relief,
            dead=self._dead_of(whose),
            still=self._watch_overlay(whose, placement.still),
            area=placement.area,
            level=0,  # until its level is chosen
        )
        beside = [self._painted[name] for name in placement.neighbours if name in self._painted]
        new = replace(new, display=self._display_of(new, ground, thumbnail, beside, whose))
        new = replace(new, dead=self._watch_border(ground, new.display.of_camera, whose))
        beside = [replace(one, display=self._ranges.of(one)) for one in beside]
        bright = self._brightness.settled(new, thumbnail, beside, placement.aircraft)
        painted = self._levels.settled(bright)
        if self._live:
            return self.canvas.paint(image, self._note_first(painted), hastily=True)
        self._note(painted)
        self.canvas.look(image, painted)
        self._changed[painted.name] = 0.0
        return set()

    def _note_first(self, painted: RenderItem) -> RenderItem:
        """How a frame is painted at first: coarsely, if it is large."""
        self._newest_s = time.monotonic()
        first = coarser_at_first(painted)
        if first != painted:
            self._coarse[painted.name] = None
        self._note(first)
        return first

    def follow(self, placements: Iterable[Placement]) -> None:
        """Take note of new placements of painted frames; `repaint_some` handles them."""
        self._unchecked |= {placement.name: placement for placement in placements if placement.name in self._painted}

    def take_away(self, name: str) -> None:
        """Paint a frame no more; its tiles become stale."""
        waiting: list[dict[str, Any]] = [self._painted, self._changed, self._rimmed, self._unchecked, self._stale]
        for queue in (*waiting, self._coarse):
            queue.pop(name, None)
        for part in (self._ranges, self._levels, self._brightness):
            part.forget(name)
        self.canvas.remove([name])

    # Repainting

    def repaint_some(self) -> set[TileKey] | None:
        """At most one frame's worth of repainting, the most displaced first.

        Returns tiles that changed, or None if nothing is left to do. After the adjustment of a long flight there are thousands
        of frames to check: each call handles some, so that no new frame waits for all.
        """
        steps = self.next_steps()
        return set[TileKey]().union(*[step.do() for step in steps]) if steps else None

    def repaint_all(self, placements: Iterable[Placement]) -> Iterator[set[TileKey]]:
        """Bring everything to its final pose and brightness; yields tiles that changed, frame by frame."""
        for steps in self.final_steps(placements):
            yield set[TileKey]().union(*[step.do() for step in steps])

    def next_steps(self) -> list[Step]:
        """The next work of `repaint_some`, in independent steps.

        Tiles in the making are finished first: any frame that moves under them would undo what was done.
        """
        if self.canvas.is_at_work:
            return [self._tiles_step(self._block())]
        if self._unchecked:
            names = islice(self._unchecked, CHECKED_AT_ONCE)
            return [self._step(name, partial(self._check, name), self._unchecked) for name in names]
        if self._rimmed:
            names = islice(self._rimmed, MOVED_AT_ONCE)
            return [self._step(name, partial(self._rim, name), self._rimmed) for name in names]
        blurred = self._to_be_sharpened()
        most = heapq.nlargest(MOVED_AT_ONCE, self._stale, key=lambda name: self._stale[name][0])
        if most and (not blurred or self._stale[most[0]][0] > BLURRED_PX):
            return [self._step(name, partial(self._move_stale, name), self._stale) for name in most]
        if blurred:
            self.canvas.expect([self._painted[name] for name in blurred])
            return [self._step(name, partial(self._sharpen, name), self._coarse) for name in blurred]
        if self._changed:  # by `settling_steps`
            return self._carrying_steps(MOVED_AT_ONCE)
        self._refitted = self.shows_old_range
        return [self._tiles_step(self._block())] if self.canvas.behind else []

    def settling_steps(self, placements: Iterable[Placement]) -> Iterator[list[Step]]:
        """Decide the final pose, brightness and level of each frame, by all that is known now, in groups of independent steps.
        Each is to be done or skipped, in order; `repaint_some` or the rest of `final_steps` then paint them."""
        looks = [Step("the final brightness", self._take_final_looks, self._forget_moves)]
        moves = [Step(one.name, partial(self._move_finally, one), set) for one in placements]
        levels = [Step(name, partial(self._settle_level, name), set) for name in self._painted]
        yield from (looks, moves, levels)

    def final_steps(self, placements: Iterable[Placement]) -> Iterator[list[Step]]:
        """The work of `repaint_all`, in groups of independent steps. Each is to be done or skipped, in order."""
        yield from self.settling_steps(placements)
        while self._changed:  # once each, however often it changed
            yield self._carrying_steps(MOVED_TOGETHER)
        while self.canvas.behind:
            yield [self._tiles_step(BLOCK)]
        self._refitted = False

    def close(self) -> None:
        self.canvas.close()

    def _block(self) -> int:
        """How many tiles a side are repainted together now."""
        return BLOCK if time.monotonic() - self._newest_s > LULL_S else LIVE_BLOCK

    def _carrying_steps(self, most: int) -> list[Step]:
        names = list(islice(self._changed, most))
        self.canvas.expect([self._painted[name] for name in names])
        return [Step(name, partial(self._carry_over, name), partial(self._changed.pop, name)) for name in names]

    def _step(self, name: str, do: Callable[[], None], queue: dict[str, Any]) -> Step:
        def done() -> set[TileKey]:
            do()
            return set()

        return Step(name, done, lambda: queue.pop(name))

    def _tiles_step(self, block: int) -> Step:
        tiles = partial(self.canvas.repaint_step, block), partial(self.canvas.skip_step, block)
        return Step("a part of the map", *tiles)

    def _check(self, name: str) -> None:
        placement = self._unchecked.pop(name)
        off_px = displacement(self._painted[name], placement)
        self._stale.pop(name, None)
        if off_px > self._settings.repaint_px:
            self._stale[name] = off_px, placement

    def _rim(self, name: str) -> None:
        del self._rimmed[name]
        painted = self._painted[name]
        camera = self._brightness.camera_of(painted)
        hidden, display = (self._dead_of(camera), self._overlays.get(camera)), self._ranges.of(painted)
        self._change(replace(painted, dead=hidden[0], still=hidden[1], display=display))
        self._carry_over(name)

    def _move_stale(self, name: str) -> None:
        off_px, placement = self._stale.pop(name)
        self._move(placement, off_px)
        self._carry_over(name)

    def _to_be_sharpened(self) -> list[str]:
        """The next of the frames that were painted coarsely, if they are due."""
        is_pause = time.monotonic() - self._newest_s > PAUSE_S
        are_due = is_pause or len(self._coarse) >= SHARPENED_TOGETHER + NEWER
        return list(islice(self._coarse, SHARPENED_TOGETHER)) if are_due else []

    def _sharpen(self, name: str) -> None:
        """Paint a frame at its own level, and where it belongs."""
        del self._coarse[name]
        off_px, placement = self._stale.pop(name, (0.0, None))
        if placement is None:
            self._change(self._levels.settled(self._painted[name]), BLURRED_PX)
        else:
            self._move(placement, max(off_px, BLURRED_PX))
        self._carry_over(name)

    def _take_final_looks(self) -> set[TileKey]:
        self._forget_moves()
        present = dict(self._painted)
        relit = self._final_displays()
        self._brightness.compare_again(present | relit, relit)
        looks = self._brightness.final(present | relit)
        for painted in present.values():
            gain, vignetting, light = looks[painted.name]
            camera = self._brightness.camera_of(painted)
            hidden = self._dead_of(camera), self._overlays.get(camera)
            shown = relit.get(painted.name, painted)
            lit = replace(shown, gain=gain, vignetting=vignetting, light=light)
            final = replace(lit, dead=hidden[0], still=hidden[1])
            is_new = painted.name in relit or hidden != (painted.dead, painted.still)
            if is_new or brightness_apart(final, painted) > self._settings.final_gain:
                self._change(final)
        return set()

    def _final_displays(self) -> dict[str, RenderItem]:
        """Frames whose display changes at the end, with their final one."""
        displays: dict[str, Display] = {}
        for camera in self._ranges.cameras:
            displays |= self._ranges.settle(camera, self._brightness.counts, self._painted)
        changed = {name: one for name, one in displays.items() if one != self._painted[name].display}
        return {name: replace(self._painted[name], display=display) for name, display in changed.items()}

    def _forget_moves(self) -> None:
        self._unchecked.clear()
        self._stale.clear()
        self._rimmed.clear()
        self._coarse.clear()

    def _move_finally(self, placement: Placement) -> set[TileKey]:
        if placement.name in self._painted:
            off_px = displacement(self._painted[placement.name], placement)
            if off_px > self._settings.final_px:
                self._move(placement, off_px)
        return set()

    def _settle_level(self, name: str) -> set[TileKey]:
        painted = self._painted[name]
        if (settled := self._levels.settled(painted)) != painted:
            self._change(settled)
        return set()

    def _move(self, placement: Placement, off_px: float) -> None:
        painted = self._painted[placement.name]
        pose, camera = reduced_view(placement.pose, placement.camera, painted.camera.width, painted.camera.height)
        moved = replace(painted, island=placement.island, pose=pose, camera=camera, relief=placement.relief)
        settled = self._levels.settled(moved)
        self._change(coarser_at_first(settled) if placement.name in self._coarse else settled, off_px)

    def _change(self, painted: RenderItem, urgency: float = 0.0) -> None:
        self._note(painted)
        self._changed[painted.name] = max(urgency, self._changed.get(painted.name, 0.0))

    def _carry_over(self, name: str) -> set[TileKey]:
        """Tell the canvas how a frame is to be painted."""
        self.canvas.move([self._painted[name]], self._changed.pop(name))
        return set()

    def _note(self, painted: RenderItem) -> None:
        self._record(painted)
        self._painted[painted.name] = painted

    def _display_of(
        self, new: RenderItem, image: Bands, thumbnail: Bands, beside: Iterable[RenderItem], camera: Camera
    ) -> Display:
        """How a new frame is displayed. If it changes the range of its camera, its other frames are updated when idle."""
        if image.dtype == np.uint8:
            return self._ranges.fixed(image)
        of_counts = [(one, self._ranges.step(one.name)) for one in beside if self._ranges.has(one.name)]
        step = self._brightness.step_of(new, thumbnail, of_counts, camera[0])
        if self._ranges.take(new.name, new.dead.filled(image), camera, step):
            self._rimmed |= {name: None for name in self._ranges.frames_of(camera) if name in self._painted}
            self._borders[camera] = self._borders.get(camera, BorderWatch()).anew()
            self._refitted = True
        return self._ranges.of(new)

    def _dead_of(self, camera: Camera) -> DeadBorder:
        watch = self._borders.get(camera)
        return NO_BORDER if watch is None else watch.border

    def _watch_border(self, image: Bands, display: Display, camera: Camera) -> DeadBorder:
        """Dead border of this camera's frames, for which this one is evidence too; painted frames are updated when idle."""
        before = self._dead_of(camera)
        self._borders[camera] = self._borders.get(camera, BorderWatch()).after(image, display.levels)
        if self._dead_of(camera) != before:
            of_camera = (one.name for one in self._painted.values() if self._brightness.camera_of(one) == camera)
            self._rimmed |= dict.fromkeys(of_camera)
            self._brightness.compare_again(self._painted, self._rimmed)
        return self._dead_of(camera)

    def _watch_overlay(self, camera: Camera, seen: StillMask | None) -> StillMask | None:
        """What an overlay covers in this camera's frames, as the newest one tells if that differs enough; painted frames are
        updated when idle."""
        before = self._overlays.get(camera)
        if seen is not None and (before is None or before.differs(seen) > OVERLAY_DIFFERS):
            self._overlays[camera] = seen
            of_camera = (one.name for one in self._painted.values() if self._brightness.camera_of(one) == camera)
            self._rimmed |= dict.fromkeys(of_camera)
        return self._overlays.get(camera)


def _camera_of(image: Bands, aircraft: Aircraft) -> Camera:
    height, width, bands = image.shape
    return aircraft, (width, height), bands

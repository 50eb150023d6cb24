"""How the frames of each camera are displayed: those of 8 bits as the first of their kind, those of counts in one range for all
frames of a camera so far, fitted again when a frame would be clipped by it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs_mosaic.render.brightness import Camera, CountOverlap
from gcs_mosaic.render.count_steps import CountStep, agreed_steps, no_step
from gcs_mosaic.render.counts_range import Sketch, are_far_above_zero, sketch_of
from gcs_mosaic.render.display import Display, camera_display, display_of
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.transaction import Kept

# Of the range: a difference of black or white beyond which one that was fitted to more frames is taken, at each doubling of
# their number, and at the end.
LOOSE, TIGHT = 0.25, 0.02
UNSEEN = 0.005  # of the range, one grey level; a frame's own black and white that differ by less are not seen to


class CameraRanges(Kept):
    """Displays by frame. `bands` and `lighten` as in `display_of`."""

    FIXED = frozenset({"_bands", "_lighten"})

    def __init__(self, bands: Sequence[int] = (), *, lighten: bool = False) -> None:
        self._bands, self._lighten = tuple(bands), lighten
        self._fixed: dict[int, Display] = {}  # of 8-bit frames, by number of bands
        self._displays: dict[Camera, Display] = {}  # of cameras of counts
        self._sketches: dict[str, Sketch] = {}  # of their frames
        self._steps: dict[str, CountStep] = {}
        self._cameras: dict[str, Camera] = {}

    def known(self, image: Bands, camera: Camera) -> Display | None:
        """How the camera's frames have been displayed, if there were any."""
        return self._fixed.get(image.shape[2]) if image.dtype == np.uint8 else self._displays.get(camera)

    def fixed(self, image: Bands) -> Display:
        """The display of an 8-bit frame."""
        if image.shape[2] not in self._fixed:
            self._fixed[image.shape[2]] = display_of(image, self._bands, lighten=self._lighten)
        return self._fixed[image.shape[2]]

    def has(self, name: str) -> bool:
        """Whether it is a frame of counts."""
        return name in self._sketches

    def step(self, name: str) -> CountStep:
        return self._steps[name]

    def of(self, painted: RenderItem) -> Display:
        """How a frame is to be displayed now."""
        if painted.name not in self._sketches:
            return painted.display
        return _own(self._displays[self._cameras[painted.name]], self._steps[painted.name])

    def forget(self, name: str) -> None:
        """A frame that is painted no more."""
        for known in (self._sketches, self._steps, self._cameras):
            known.pop(name, None)

    def frames_of(self, camera: Camera) -> list[str]:
        """The camera's frames of counts so far."""
        return [name for name, other in self._cameras.items() if other == camera]

    def take(self, name: str, image: Bands, camera: Camera, step: CountStep) -> bool:
        """Take in a frame of counts (h, w, bands); returns whether the range of its camera has changed."""
        self._sketches[name], self._steps[name], self._cameras[name] = sketch_of(image), step, camera
        names, present = self.frames_of(camera), self._displays.get(camera)
        doubled = len(names) & (len(names) - 1) == 0
        if present is not None and not doubled and not self._is_clipped(name, present):
            return False
        fitted = self._fitted(names, self._steps)
        if present is not None and not _differs(fitted, present, TIGHT if self._is_clipped(name, present) else LOOSE):
            return False
        self._displays[camera] = fitted
        return present is not None

    def settle(
        self, camera: Camera, overlaps: Sequence[CountOverlap], painted: Mapping[str, RenderItem]
    ) -> dict[str, Display]:
        """The final displays of a camera's frames, from all they have in common; of those that look as they are painted, the
        present ones."""
        names = self.frames_of(camera)
        spans = {name: [band[-1] - band[0] for band in self._sketches[name]] for name in names}
        steps = agreed_steps(spans, [one for one in overlaps if one[0] in spans and one[1] in spans], self._steps)
        fitted, present = self._fitted(names, steps), self._displays[camera]
        if _differs(fitted, present, TIGHT):
            self._displays[camera] = fitted
        found: dict[str, Display] = {}
        for name in names:
            own, shown = _own(self._displays[camera], steps[name]), painted[name].display
            if own.of_camera == shown.of_camera and _looks_alike(own, shown):
                found[name] = shown
            else:
                found[name], self._steps[name] = own, steps[name]
        return found

    @property
    def cameras(self) -> list[Camera]:
        """Those of counts."""
        return list(self._displays)

    def _fitted(self, names: Sequence[str], steps: Mapping[str, CountStep]) -> Display:
        sketches = usual_sketches([self._sketches[name] for name in names], [steps[name] for name in names])
        return camera_display(sketches, self._bands, lighten=self._lighten)

    def _is_clipped(self, name: str, display: Display) -> bool:
        """Whether more of a frame than the range leaves out anyway is beyond it."""
        own = _own(display, self._steps[name])
        levels = own.levels(np.array(self._sketches[name]).T[None])[0]
        far = np.array(display.black) > 0
        return bool((levels[-1] > 255).any() or (levels[0] < 0)[far].any())


def fitted_displays(
    sketches: Mapping[str, Sketch], overlaps: Sequence[CountOverlap], bands: Sequence[int], *, lighten: bool
) -> dict[str, Display]:
    """The displays of all frames of a camera of counts, known at once: as `CameraRanges.settle` finds them."""
    spans = {name: [band[-1] - band[0] for band in sketch] for name, sketch in sketches.items()}
    steps = agreed_steps(spans, overlaps)
    usual = usual_sketches(list(sketches.values()), [steps[name] for name in sketches])
    display = camera_display(usual, bands, lighten=lighten)
    return {name: _own(display, steps[name]) for name in sketches}


def usual_sketches(sketches: Sequence[Sketch], steps: Iterable[CountStep]) -> list[Sketch]:
    """A camera's frames as they would be without their steps. Bands of counts that begin near zero have gains, not steps."""
    seen = np.array(sketches)  # (frames, bands, shares)
    far = [are_far_above_zero(seen[:, band]) for band in range(seen.shape[1])]
    for frame, step in enumerate(steps):
        for band in np.flatnonzero(far):
            seen[frame, band] = seen[frame, band] * step.scale[band] + step.offset[band]
    return [tuple(tuple(band) for band in one) for one in seen.tolist()]


def _own(display: Display, step: CountStep) -> Display:
    """How a frame with this step is displayed by a camera's display; as all others, if that is not seen."""
    own = [(1.0, 0.0)] * len(display.black)
    for band, (black, white) in enumerate(zip(display.black, display.white, strict=True)):
        scale, offset = step.scale[band], step.offset[band]
        ends = (black * scale + offset - black, white * scale + offset - white)
        if black > 0 and max(map(abs, ends)) > UNSEEN * (white - black):
            own[band] = round(scale, 4), round(offset, 1)
    if all(one == (1.0, 0.0) for one in own):
        return display
    scales, offsets = zip(*own, strict=True)
    return replace(display, scale=scales, offset=offsets)


def _differs(one: Display, other: Display, share: float) -> bool:
    """Whether two displays of a camera differ by more than a share of the range."""
    if (one.shown, len(one.knots)) != (other.shown, len(other.knots)):
        return True
    if [len(band) for band in one.knots] != [len(band) for band in other.knots]:
        return True
    ends = np.array([one.black, one.white], float), np.array([other.black, other.white], float)
    apart = np.abs(one.levels(ends[1][None])[0] - other.levels(ends[1][None])[0])
    return bool((apart > share * 255).any() or abs(one.gamma - other.gamma) + abs(one.factor - other.factor) > share)


def _looks_alike(one: Display, other: Display) -> bool:
    """Whether one's own black and white are the other's too, for two displays that differ in a frame's step alone."""
    none = no_step(len(one.black))
    of_one = np.array([one.scale or none.scale, one.offset or none.offset])
    of_other = np.array([other.scale or none.scale, other.offset or none.offset])
    ends = np.array([one.black, one.white], float)
    own = (ends - of_one[1]) / of_one[0]
    apart = np.abs(own * of_other[0] + of_other[1] - ends)
    return bool((apart <= UNSEEN * (ends[1] - ends[0])).all())

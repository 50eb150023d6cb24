"""Exposure of painted frames, from their overlaps."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass, replace

from gcs_mosaic.render.agreement import (
    Aircraft,
    Overlap,
    agreed_looks,
    are_near,
    counts_overlap_of,
    field_beside,
    overlap_of,
)
from gcs_mosaic.render.count_steps import CountsInOverlap, CountStep, step_beside
from gcs_mosaic.render.exposure import ExposureSettings, Gain, OverlapMeans, gain_beside, is_false_colour
from gcs_mosaic.render.light_field import HELD, LightField
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.vignetting import FLAT, Vignetting, VignettingEstimate, VignettingSettings
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.features.shelf import Shelve, Shelved, at_hand, exactly
from gcs_mosaic.stitch.transaction import Kept

Size = tuple[int, int]  # width, height of frames as painted
Camera = tuple[Aircraft, Size, int]  # with the number of bands
CountOverlap = tuple[str, str, CountsInOverlap]  # frame i, frame j, what they have in common


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """A frame's picture (h, w, bands) much reduced, as it came. It may lie on a shelf: it is asked for while frames come around
    it, and seldom later."""

    kept: Bands | Shelved

    @property
    def picture(self) -> Bands:
        return at_hand(self.kept)

    def shelved(self, shelve: Shelve) -> Thumbnail:
        return Thumbnail(shelve(self.picture))

    def __getstate__(self) -> list[object]:
        """What is pickled lies on no shelf. Raises OSError if it is lost."""
        return [exactly(self.kept)]


class Brightness(Kept):
    """Thumbnails of all painted frames; their overlaps determine gains, vignetting and light fields.

    `dead_of`: the known dead border of a camera's frames. `shelve`: where thumbnails go.
    """

    FIXED = frozenset({"_dead_of", "_shelve"})

    def __init__(
        self,
        exposure: ExposureSettings,
        vignetting: VignettingSettings,
        dead_of: Callable[[Camera], DeadBorder],
        shelve: Shelve | None = None,
    ) -> None:
        self._exposure = exposure
        self._no_estimate = VignettingEstimate(vignetting)
        self._dead_of = dead_of
        self._shelve = shelve
        self._thumbnails: dict[str, Thumbnail] = {}
        self._false_colour: set[str] = set()  # a palette that follows each frame's own range carries no exposure
        self._overlaps: list[Overlap] = []
        self.counts: list[CountOverlap] = []  # of frames of counts, each pair of one camera
        self._estimates: dict[Camera, VignettingEstimate] = {}
        self._carriers: dict[str, Aircraft] = {}  # of each frame's camera

    def step_of(
        self,
        new: RenderItem,
        thumbnail: Bands,
        beside: Iterable[tuple[RenderItem, CountStep]],
        aircraft: Aircraft = None,
    ) -> CountStep:
        """How the counts of a new frame compare to those of frames `beside` it with known steps; kept for the end."""
        camera = aircraft, size_of(new), thumbnail.shape[2]
        found: list[tuple[CountsInOverlap, CountStep]] = []
        for painted, step in beside:
            if painted.island == new.island and self.camera_of(painted) == camera:
                counts = counts_overlap_of(new, thumbnail, painted, self._thumbnails[painted.name].picture)
                if counts is not None:
                    self.counts.append((new.name, painted.name, counts))
                    found.append((counts, step))
        return step_beside(found, thumbnail.shape[2])

    def settled(
        self, new: RenderItem, thumbnail: Bands, beside: Iterable[RenderItem], aircraft: Aircraft = None
    ) -> RenderItem:
        """A frame with gain, vignetting and light field that match painted frames beside it; used as a reference from now
        on. Another `aircraft` has another lens."""
        kept = Thumbnail(thumbnail)
        self._thumbnails[new.name] = kept if self._shelve is None else kept.shelved(self._shelve)
        self._carriers[new.name] = aircraft
        if is_false_colour(new.display.levels(thumbnail)):
            self._false_colour.add(new.name)
        found = self._find_overlaps(new, beside)
        curves = self.curves_of(new)
        streams = len(set(self._carriers.values()))
        own = [(means, other) for means, other in found if self._carriers[other.name] == aircraft]
        near = [(means, other) for means, other in own if are_near(new, other, self._exposure, streams)]
        shares = [means.flattened(curves, other.vignetting) for means, other in near]
        lit = replace(new, gain=gain_beside(shares, self._exposure, len(new.display.black)), vignetting=curves)
        lights = [(other, means.light[0]) for means, other in found if means.light is not None]
        return replace(lit, light=field_beside(lit, lights, HELD))

    def forget(self, name: str) -> None:
        """A frame that is painted no more: what it shares with others is of no concern at the end."""
        self._overlaps = [one for one in self._overlaps if name not in one[:2]]
        self.counts = [one for one in self.counts if name not in one[:2]]

    def compare_again(self, painted: Mapping[str, RenderItem], names: Container[str]) -> None:
        """Recompute overlaps of these frames, whose dead borders or displays have changed.

        After a merge two frames may be painted on different islands for a while: their overlap is kept.
        """
        kept: list[Overlap] = []
        for i, j, means in self._overlaps:
            changed = (i in names or j in names) and painted[i].island == painted[j].island
            again = self._overlap(painted[i], painted[j]) if changed else means
            kept += [] if again is None else [(i, j, again.without_sums())]
        self._overlaps = kept

    def final(self, painted: Mapping[str, RenderItem]) -> dict[str, tuple[Gain, Vignetting, LightField | None]]:
        """Gain, vignetting and light field of each frame from all overlaps."""
        curves = {name: self.curves_of(one) for name, one in painted.items()}
        looks = agreed_looks(painted.values(), self._overlaps, curves, self._exposure, self._carriers)
        return {name: (gain, curves[name], light) for name, (gain, light) in looks.items()}

    def curves_of(self, painted: RenderItem) -> Vignetting:
        """The estimated vignetting of a frame's camera; none of a palette's colours, which are temperatures."""
        if painted.name in self._false_colour:
            return FLAT
        return self._estimates.get(self.camera_of(painted), self._no_estimate).curves

    def camera_of(self, painted: RenderItem) -> Camera:
        """The camera of a frame whose brightness was settled."""
        return self._carriers[painted.name], size_of(painted), len(painted.display.black)

    def _find_overlaps(self, new: RenderItem, beside: Iterable[RenderItem]) -> list[tuple[OverlapMeans, RenderItem]]:
        """Overlaps of a new frame with others of the same kind; kept for the end, and used for vignetting if one aircraft took
        both."""
        found: list[tuple[OverlapMeans, RenderItem]] = []
        for painted in beside:
            if painted.island == new.island and painted.display.kind == new.display.kind:
                means = self._overlap(new, painted)
                if means is not None:
                    self._overlaps.append((new.name, painted.name, means.without_sums()))
                    found.append((means, painted))
                    if self._carriers[painted.name] == self._carriers[new.name]:
                        camera = self.camera_of(painted)
                        self._estimates[camera] = self._estimates.get(camera, self._no_estimate).after(means.radial)
        return found

    def _overlap(self, one: RenderItem, other: RenderItem) -> OverlapMeans | None:
        """Excludes borders known to be dead, even if still painted."""
        if not self._false_colour.isdisjoint((one.name, other.name)):
            return None
        i, j = (replace(painted, dead=self._dead_of(self.camera_of(painted))) for painted in (one, other))
        small_i, small_j = (painted.display.levels(self._thumbnails[painted.name].picture) for painted in (i, j))
        return overlap_of(i, small_i, j, small_j)


def size_of(painted: RenderItem) -> Size:
    return painted.camera.width, painted.camera.height

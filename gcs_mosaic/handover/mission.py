"""A mission over what a flight has not seen: gaps, and patches seen too seldom, too coarsely, or where a person may be missed;
or over an area that is to be looked at through its trees.

It is advice: a person looks at it in the ground station, says from where and whether it is flown, and flies it. It has waypoints
and camera triggers by distance; nothing in it arms, takes off, sets a speed, returns or lands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from gcs_mosaic.detection.detection_map import DetectionMap
from gcs_mosaic.detection.detections import Detections
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.ellipsoid import LocalPlane, Places
from gcs_mosaic.handover.lawnmower import Sweep, in_order, sweep_over
from gcs_mosaic.handover.patches import Patch, patch_of, patches_below, patches_in, patches_of_gaps
from gcs_mosaic.handover.survey import IslandSurvey, survey_of
from gcs_mosaic.integral.how_to_fly import pattern_for
from gcs_mosaic.notes.texts import shown
from gcs_mosaic.views.coverage import SeenIsland, footprint_of
from gcs_mosaic.views.flight_view import FlightView

SIDE_OVERLAP = 0.6
BEYOND = 0.25  # of a footprint: how far a line goes beyond a patch, so that its first and last picture show known ground, too
MOST_PATCHES = 200  # the largest of an island
NO_ANCHOR = (
    "{what} has no anchor, and so no longitude to fly to: set two pins or more on the page; of pins that are set it says under "
    "Anchor why they lay nothing."
)
MOST_LINES = 500  # of an outline
TOO_LARGE = f"The area takes more than {MOST_LINES} lines: draw a smaller one, or fly higher."
MANY_ITEMS = 700  # some autopilots hold no more

CoverageOf = Callable[[int], SeenIsland]
DetectionOf = Callable[[int, Person, float], DetectionMap | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionWish:
    """What is to be flown again: ground seen fewer than `looks` times, or coarser than `gsd_m` metres a pixel (None: as it was
    flown), or where `person` would have been seen with a probability `below` that (None: it does not count). `height_m`: over
    ground, as it was flown, where the pictures do not tell; `island`: None for all with an anchor.

    With an `outline` (corners on that island's canvas) the ground inside it, whatever was seen of it: `looks` frames or more are
    to show each place, from `at_height` times the flight's own height."""

    island: int | None = None
    looks: int = 1
    gsd_m: float | None = None
    height_m: float | None = None
    below: float | None = None
    person: Person = field(default_factory=Person)
    outline: tuple[tuple[float, float], ...] = ()
    at_height: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A line with pictures each `step_m`: `places` (2, 2) are longitude and latitude of its ends; `patch` counts from 1."""

    patch: int
    places: Places
    height_m: float
    step_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """`start`: where the flight began (longitude, latitude), from where the patches are ordered; `error_m`: of the anchor at the
    worst patch (95 %); `length_m`: from the first waypoint to the last; `height_off`: what the height is known to, as a share (95
    %), None if it was given; `looks`: how many frames are to show each place, if that was asked for."""

    flight: str
    start: tuple[float, float]
    legs: tuple[Leg, ...]
    patches: int
    area_m2: float
    error_m: float
    length_m: float
    gsd_m: float
    height_off: float | None
    looks: int = 0
    left_out: tuple[int, ...] = ()

    @property
    def items(self) -> int:
        """Mission items: two waypoints and two triggers a leg."""
        return 4 * len(self.legs)

    def sentences(self) -> list[str]:
        """What whoever flies it must know."""
        heights = sorted({round(leg.height_m) for leg in self.legs})
        height = f"{heights[0]} m" if len(heights) == 1 else f"{heights[0]} to {heights[-1]} m"
        known = "as given" if self.height_off is None else f"by the pictures, ± {self.height_off:.0%}"
        found = [
            f"{_counted(self.patches, 'patch', 'patches')} of {self.area_m2:,.0f} m², {len(self.legs)} lines, "
            f"{self.length_m / 1000:.1f} km, {self.gsd_m * 100:.1f} cm a pixel.",
            f"Height {height} above home ({known}): the ground is taken to be as high as home. Over hills have the ground "
            "station follow the terrain.",
            f"The places are known within {math.ceil(self.error_m)} m (95 %); the patches are widened by that, by a footprint at "
            "most.",
            "Advice only: look at obstacles, airspace and height before it is flown. It arms nothing, and neither takes off nor "
            "lands: what happens after the last waypoint is the autopilot's setting.",
        ]
        if self.looks:
            found.append(f"{self.looks} frames or more show each place, whichever way the camera is turned.")
        if self.items > MANY_ITEMS:
            found.append(f"It has {self.items} items, more than some autopilots hold: export one island, or split it.")
        if self.left_out:
            found.append(f"Without an anchor, and not in it: island {', '.join(map(str, self.left_out))}.")
        return found


@dataclass(frozen=True, slots=True)
class _FlownPatch:
    """How a patch is flown; the sweep lies on the mission's plane."""

    sweep: Sweep
    height_m: float
    step_m: float
    area_m2: float
    error_m: float


@dataclass(frozen=True, slots=True)
class _Flying:
    """How the patches of an island are flown. `finer`: share of the flight's own height and footprint; `forward`, `side`:
    overlaps, and `around`: how far beyond a patch they still hold, as shares of a frame's shorter side."""

    anchor: Anchor
    survey: IslandSurvey
    height_m: float
    finer: float
    forward: float
    side: float
    around: float = 0.0


def planned(
    view: FlightView,
    anchors: Mapping[int, Anchor],
    islands: Sequence[int],
    coverage_of: CoverageOf,
    wish: MissionWish,
    detection_of: DetectionOf | None = None,
) -> Mission:
    """The mission over all patches of these islands. `anchors`: of those that have one; `detection_of`: of an island, a person
    and their side in canvas units, by default all frames are measured for that. Raises UsageError, in a sentence, if there is no
    anchor, nothing to be flown, or no height."""
    wanted = [one for one in islands if wish.island in (None, one)]
    laid = [one for one in wanted if one in anchors]
    if not laid:
        what = "The map" if wish.island is None else f"Island {wish.island}"
        raise UsageError(NO_ANCHOR.format(what=what))
    detection_of = detection_of or Detections(view, coverage_of).whole
    todo = {one: found for one in laid if (found := _patches(view, coverage_of, detection_of, one, anchors[one], wish))}
    if not todo:
        raise UsageError(nothing_to_fly(wish))
    flying = {one: _flying(view, one, anchors[one], wish) for one in todo}
    plane = anchors[laid[0]].plane
    patches = [_flown(plane, flying[one], patch) for one, found in todo.items() for patch in found]
    start = _start(view, laid[0], anchors[laid[0]])
    ordered = in_order([one.sweep for one in patches], plane.spots(np.array(start)))
    legs = [leg for k, (index, sweep) in enumerate(ordered, 1) for leg in _legs(plane, k, patches[index], sweep)]
    record = view.flight()
    return Mission(
        flight=shown(record.name if record else view.root.resolve().name),
        start=start,
        legs=tuple(legs),
        patches=len(patches),
        area_m2=sum(one.area_m2 for one in patches),
        error_m=max(one.error_m for one in patches),
        length_m=_length(plane, legs),
        gsd_m=median(one.survey.gsd_m * one.finer for one in flying.values()),
        height_off=None if wish.height_m is not None else max(one.survey.height_off for one in flying.values()),
        looks=pattern_for(wish.looks).looks if wish.outline else 0,
        left_out=tuple(one for one in wanted if one not in anchors),
    )


def _patches(
    view: FlightView, coverage_of: CoverageOf, detection_of: DetectionOf, island: int, anchor: Anchor, wish: MissionWish
) -> list[Patch]:
    seen = coverage_of(island)
    coverage, gaps = seen.coverage, seen.gaps
    if coverage is None:
        return []
    table = view.table()
    footprint = footprint_of(table.boxes[table.islands == island])
    if wish.outline:
        return [patch_of(np.array(wish.outline), footprint)]
    if wish.below is not None:
        found = detection_of(island, wish.person, wish.person.side_m / anchor.metres_per_unit)
        return _improbable(found, wish.below, footprint)[:MOST_PATCHES]
    if wish.looks == 1 and wish.gsd_m is None:
        return patches_of_gaps(coverage.grid, gaps[:MOST_PATCHES])
    coarsest = math.inf if wish.gsd_m is None else wish.gsd_m / anchor.metres_per_unit
    return patches_below(coverage, footprint, wish.looks, coarsest)[:MOST_PATCHES]


def _improbable(found: DetectionMap | None, least: float, footprint: float) -> list[Patch]:
    """Where the person would have been missed. Raises UsageError where nothing can be said."""
    if found is None:
        return []
    if found.is_grey:
        raise UsageError(
            "The pictures have one band: how a person stands out in them is not known, and no patch is below."
        )
    if not found.is_seen.any():
        raise UsageError(f"No picture can be measured, so nothing is known of a person: {' '.join(found.troubles)}")
    return patches_in(found.grid, found.below(least), footprint)


def nothing_to_fly(wish: MissionWish) -> str:
    """A sentence: why there is no mission."""
    if wish.below is not None:
        why = (
            f"by the model no patch of the flown area is below {wish.below:.0%} for that person, which clears no ground"
        )
    elif wish.looks == 1 and wish.gsd_m is None:
        why = "inside the flown area there is no gap"
    else:
        coarse = "" if wish.gsd_m is None else f" and none coarser than {wish.gsd_m:g} m a pixel"
        why = f"inside the flown area no patch was seen fewer than {wish.looks} times{coarse}"
    return f"There is nothing to fly again: {why}."


def _flying(view: FlightView, island: int, anchor: Anchor, wish: MissionWish) -> _Flying:
    survey = survey_of(view, island, anchor.metres_per_unit)
    height_m = survey.known_height(wish.height_m)
    if wish.outline:
        pattern = pattern_for(wish.looks)
        # Half a footprint around, so that places at the rim are seen from all sides, too.
        return _Flying(
            anchor, survey, height_m * wish.at_height, wish.at_height, pattern.forward, pattern.side, around=0.5
        )
    finer = 1.0 if wish.gsd_m is None else min(1.0, wish.gsd_m / survey.gsd_m)
    return _Flying(anchor, survey, height_m * finer, finer, survey.overlap, SIDE_OVERLAP)


def _flown(plane: LocalPlane, how: _Flying, patch: Patch) -> _FlownPatch:
    """Raises UsageError for more lines than anybody flies."""
    per_unit, side = how.anchor.metres_per_unit, how.survey.side_m * how.finer
    middle = patch.widened(0.0).mean(axis=0)
    error_m = how.anchor.error(*middle.tolist()).major_m
    size, spacing = patch.grid.cell * per_unit, side * (1 - how.side)
    if how.around and max(patch.grid.columns, patch.grid.rows) * size > MOST_LINES * spacing:
        raise UsageError(TOO_LARGE)
    cells = plane.spots(how.anchor.places(patch.widened((min(error_m, side) + how.around * side) / per_unit)))
    return _FlownPatch(
        sweep=sweep_over(cells, size, spacing, 0.0 if how.around else side * BEYOND),
        height_m=how.height_m,
        step_m=side * (1 - how.forward),
        area_m2=patch.area * per_unit**2,
        error_m=error_m,
    )


def _start(view: FlightView, island: int, anchor: Anchor) -> tuple[float, float]:
    """Where the first frame of an island was taken: longitude and latitude in degrees."""
    first = min((one for one in view.table().frames if one.island == island), key=lambda one: one.order)
    longitude, latitude = anchor.places(np.array([first.pose.x, first.pose.y])).tolist()
    return longitude, latitude


def _legs(plane: LocalPlane, number: int, patch: _FlownPatch, sweep: Sweep) -> list[Leg]:
    return [
        Leg(patch=number, places=plane.places(line), height_m=patch.height_m, step_m=patch.step_m)
        for line in sweep.lines
    ]


def _length(plane: LocalPlane, legs: Sequence[Leg]) -> float:
    spots = plane.spots(np.concatenate([leg.places for leg in legs]))
    return float(np.hypot(*np.diff(spots, axis=0).T).sum())


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"

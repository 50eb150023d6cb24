"""How a search went on over an island: what was seen and with which probability somebody would have been found, by the times of
the pictures; what was looked at, by the clock of those who looked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs_mosaic.detection.detection_map import DetectionMap
from gcs_mosaic.detection.detections import Detections
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.errors import UsageError
from gcs_mosaic.notes.search.reviews import Reviews
from gcs_mosaic.notes.search.seen_ground import StampedGround
from gcs_mosaic.stitch.arrays import Array, Mask
from gcs_mosaic.views.coverage import Coverage, SeenIsland, cells_of, flown_area, footprint_of
from gcs_mosaic.views.flight_view import FlightView, FrameTable

MOMENTS = 8  # at which the probability is told: each costs a map of it
COARSER = 2  # levels than an island's finest at which a look counts, as on the page
NO_SCALE = "how large the ground is, is not known: set two pins or give a known distance on the page, then make this file again"


@dataclass(frozen=True, slots=True)
class SoughtPerson:
    """Who is sought; `map_of`: of an island and a person of so many canvas units, raises UsageError in a sentence where it cannot
    be told; `metres`: of a canvas unit, by island."""

    person: Person
    detections: Detections
    map_of: Callable[[int, Person, float], DetectionMap | None]
    metres: Mapping[int, float]


@dataclass(frozen=True, slots=True)
class Looked:
    """An island's ground, when its cells (lines, columns) were looked at (seconds since 1970; NaN: by nobody), and the share of
    it that each looked at."""

    ground: StampedGround
    utc: Array
    shares: Mapping[str, float]

    @property
    def share(self) -> float:
        """That anybody looked at."""
        return _share(np.isfinite(self.utc), self.ground)


@dataclass(frozen=True, slots=True)
class Moment:
    """After so many pictures, the last at `s` (seconds since 1970; NaN: not known): `seen`, share of all that was flown;
    `probability`: of somebody anywhere in it, None where it is not told."""

    s: float
    pictures: int
    seen: float
    probability: float | None = None


@dataclass(frozen=True, slots=True)
class Flown:
    """The course over an island: `moments` in the order of the pictures; `found` at the end of them, or `trouble`, why nothing is
    told of the probability."""

    moments: Sequence[Moment] = ()
    found: DetectionMap | None = None
    trouble: str = ""
    stated: Sequence[Moment] = field(default=())  # those at which a probability is told


def looked_at(reviews: Reviews, ground: StampedGround, island: int, finest: int) -> Looked:
    """What was looked at of an island whose finest level is given; on the thread of the notes."""
    level = finest - COARSER
    by = {
        who: _share(np.isfinite(reviews.looked_in(ground, island, level, who)), ground) for who in reviews.reviewers()
    }
    return Looked(ground, reviews.looked_in(ground, island, level), {who: share for who, share in by.items() if share})


def flown_course(view: FlightView, island: int, seen: SeenIsland, sought: SoughtPerson | None) -> Flown:
    """Of an island as it was seen, and of somebody who is sought."""
    table = view.table()
    ours = _in_order(view, table, island)
    if seen.coverage is None or not ours:
        return Flown(trouble="no picture is on the map")
    moments = _seen(table, island, seen.coverage, ours)
    found, trouble = _found(island, sought)
    if found is None or sought is None:
        return Flown(moments, None, trouble)
    known = found.flown & np.isfinite(found.probability)
    steps = np.unique(np.linspace(0, len(ours), MOMENTS + 1).round().astype(int)[1:]) - 1
    stated = []
    for step in steps.tolist():
        numbers = {table.frames[index].number for index, _ in ours[: step + 1]}
        side = sought.person.side_m / sought.metres[island]
        then = found if step == steps[-1] else sought.detections.of_some(island, sought.person, side, numbers)
        if then is not None:
            share = float(np.nan_to_num(then.probability)[known].mean())
            stated.append(Moment(moments[step].s, moments[step].pictures, moments[step].seen, share))
    return Flown(moments, found, "", stated)


def _found(island: int, sought: SoughtPerson | None) -> tuple[DetectionMap | None, str]:
    if sought is None or island not in sought.metres:
        return None, NO_SCALE
    try:
        found = sought.map_of(island, sought.person, sought.person.side_m / sought.metres[island])
    except UsageError as error:
        return None, str(error)
    if found is None or found.is_grey or not (found.is_seen & found.flown).any():
        return None, "".join(() if found is None else found.troubles[:1]) or "no picture of it can be measured"
    return found, ""


def _in_order(view: FlightView, table: FrameTable, island: int) -> list[tuple[int, float]]:
    """Indices of an island's frames, and when they were taken; where that is not known of all, as they were given."""
    taken = view.taken(table)
    ours = [index for index, one in enumerate(table.frames) if one.island == island]
    if np.isfinite(taken[ours]).all():
        ours.sort(key=lambda index: (taken[index], table.frames[index].order))
    else:
        ours.sort(key=lambda index: table.frames[index].order)
    return [(index, float(taken[index])) for index in ours]


def _seen(table: FrameTable, island: int, coverage: Coverage, ours: Sequence[tuple[int, float]]) -> list[Moment]:
    flown = flown_area(coverage, footprint_of(table.boxes[table.islands == island]))
    seen, all_of_it = np.zeros_like(flown), max(int(flown.sum()), 1)
    moments = []
    for count, (index, s) in enumerate(ours, 1):
        if (cells := cells_of(coverage.grid, table.outlines[index])) is not None:
            seen[cells[0]] |= cells[1]
        moments.append(Moment(s, count, float((seen & flown).sum()) / all_of_it))
    return moments


def _share(cells: Mask, ground: StampedGround) -> float:
    count = int((ground.stamps > 0).sum())
    return float((cells & (ground.stamps > 0)).sum()) / count if count else 0.0

"""A flight's map on earth, for export: the pyramid of its anchored islands, and what each file says of itself."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.export import chosen_island
from gcs_mosaic.geo.mercator import MOST_LATITUDE_DEG
from gcs_mosaic.geo.pins import PinnedMap, Refused
from gcs_mosaic.geotiles.canvas_tiles import tiles_at_rest
from gcs_mosaic.geotiles.earth_islands import Bounds, EarthIsland, canvas_islands, earth_islands
from gcs_mosaic.geotiles.pyramid import GeoPyramid, middle_of
from gcs_mosaic.notes.anchors.anchoring import IslandAnchor
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.notes.texts import iso, shown
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.store.told_islands import told_islands
from gcs_mosaic.views.flight_view import FlightView

HOW = "set two pins or more on its page, or `gcs-mosaic anchor DIR --points FILE`"
ELSE = "png, tiff and placements need no anchor"


@dataclass(frozen=True, slots=True, kw_only=True)
class EarthMap:
    """`laid`: how the islands of the pyramid lie; `left_out`: islands without an anchor; `box`: what was cut out of it."""

    view: FlightView
    flight: str
    started_utc: float
    pyramid: GeoPyramid
    laid: Mapping[int, IslandAnchor]
    left_out: tuple[int, ...]
    box: Bounds | None = None

    @property
    def bounds(self) -> Bounds:
        """In degrees: of the islands, within the box."""
        whole = self.pyramid.bounds
        assert whole is not None, "a map without an island is not exported"
        return whole if self.box is None else _common(whole, self.box)

    @property
    def reach(self) -> Bounds:
        """As `bounds`; of a map across the 180th meridian longitudes go on beyond it."""
        whole = self.pyramid.reach
        assert whole is not None, "a map without an island is not exported"
        return whole if self.box is None else self.bounds

    @property
    def middle(self) -> tuple[float, float]:
        """Longitude and latitude in degrees."""
        return middle_of(self.reach)

    def finest_level(self, wanted: int | None) -> int:
        """Of Web Mercator: that of the map's own pixels, or a coarser one that is wanted. Raises UsageError."""
        levels = self.pyramid.levels
        assert levels is not None, "a map without an island is not exported"
        if wanted is None:
            return levels[1]
        if not levels[0] <= wanted <= levels[1]:
            raise UsageError(f"--zoom {wanted}: on earth this map has the levels {levels[0]} to {levels[1]}.")
        return wanted

    @property
    def error_m(self) -> float:
        """How far off the worst corner may be (95 %)."""
        return max(one.error_m for one in self.pyramid.islands)

    def about(self) -> dict[str, Any]:
        """What a file says of itself."""
        return {
            "software": f"gcs-mosaic {_version()}",
            "flight": self.flight,
            "flown": iso(self.started_utc),
            "exported": iso(time.time()),
            "error_m": math.ceil(self.error_m),
            "error": f"± {math.ceil(self.error_m)} m (95 %) at the worst corner",
            "islands": [_about(one, self.laid[one.id]) for one in self.pyramid.islands],
            "left_out": list(self.left_out),
        }

    def sentence(self) -> str:
        """The same in words."""
        by = " and ".join(sorted({_way(self.laid[one.id]) for one in self.pyramid.islands}))
        return f"gcs-mosaic: {self.flight}, flown {iso(self.started_utc)}; laid by {by}, {self.about()['error']}"


def earth_map(flight: Path, island: int | None = None, box: Bounds | None = None) -> EarthMap:
    """The islands of a flight that have an anchor, or one of them. Raises UsageError."""
    if box is not None:
        _check(box)
    folder = find_flight(flight)
    chosen_island(folder, island)  # raises if there is none
    view = FlightView(folder)
    record = view.flight()
    laid = anchors_of(view)
    canvas = canvas_islands({"islands": told_islands(folder)})
    wanted = [one for one in canvas if island in (None, one.id)]
    anchors = {number: one.anchor for number, one in laid.items() if one.anchor is not None}
    islands = earth_islands(wanted, anchors)
    if not islands:
        raise UsageError(_without(flight, island, laid))
    there = {one.id for one in islands}
    found = EarthMap(
        view=view,
        flight=shown(record.name if record else folder.resolve().name),
        started_utc=record.started_utc if record else 0.0,
        pyramid=GeoPyramid(islands, tiles_at_rest(folder)),
        laid=laid,
        left_out=tuple(one.id for one in wanted if one.id not in there),
    )
    return found if box is None else _cut_out(found, box)


def _check(box: Bounds) -> None:
    west, south, east, north = box
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):  # NaN is neither
        told = " ".join(f"{value:g}" for value in box)
        raise UsageError(
            f"--box {told} is no box: give west, south, east and north in degrees, as in 11.0 47.2 11.1 47.3."
        )


def _cut_out(found: EarthMap, box: Bounds) -> EarthMap:
    cut = replace(found, box=box)
    west, south, east, north = cut.bounds
    if west >= east or south >= north:
        whole = ",".join(f"{value:.5f}" for value in found.bounds)
        raise UsageError(f"--box lies beside the map, which reaches from west, south to east, north: {whole}.")
    return cut


def check_mercator(found: EarthMap) -> None:
    """Raises UsageError where Web Mercator, and its tiles, do not reach."""
    _, south, _, north = found.bounds
    if max(abs(south), abs(north)) > MOST_LATITUDE_DEG:
        raise UsageError(
            f"The map reaches beyond {MOST_LATITUDE_DEG:.0f} degrees, where Web Mercator and its tiles end: "
            "give --format kmz or geojson."
        )


def left_out_words(found: EarthMap) -> str:
    """For the message at the end."""
    if not found.left_out:
        return ""
    numbers = ", ".join(map(str, found.left_out))
    return f"; without an anchor, and not in it: {'island' if len(found.left_out) == 1 else 'islands'} {numbers}"


def _without(flight: Path, island: int | None, laid: Mapping[int, IslandAnchor]) -> str:
    refused = [
        one.result.reason for one in laid.values() if isinstance(one.result, Refused) and island in (None, one.island)
    ]
    what = f"The map in {flight}" if island is None else f"Island {island} of {flight}"
    if refused:
        return f"{what} has no anchor, and so no longitude. {refused[0]} The formats {ELSE}."
    return f"{what} has no anchor, and so no longitude: {HOW}; {ELSE}."


def _way(laid: IslandAnchor) -> str:
    if laid.by == "positions":
        return "the aircraft's positions"
    if not isinstance(laid.result, PinnedMap) or laid.result.fits:
        return "pins"
    if laid.result.misfits:
        verb = "does" if len(laid.result.misfits) == 1 else "do"
        return f"pins without {', '.join(map(shown, laid.result.misfits))}, which {verb} not fit the others"
    return "pins that do not fit each other"


def _about(island: EarthIsland, laid: IslandAnchor) -> dict[str, Any]:
    checked = laid.result.is_checked if isinstance(laid.result, PinnedMap) else True
    return {
        "island": island.id,
        "frames": island.frames,
        "anchor": laid.by,
        "checked": checked,
        "error_m": round(island.error_m, 1),
        "metres_per_pixel": island.anchor.metres_per_unit,
    }


def _common(one: Bounds, other: Bounds) -> Bounds:
    return max(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]), min(one[3], other[3])


def _version() -> str:
    try:
        return version("gcs-mosaic")
    except PackageNotFoundError:
        return "of a clone"

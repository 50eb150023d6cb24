"""`gcs-mosaic integral`: the integral of a place as a TIFF, and what is to be said of it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.earth_raster import GEO_KEYS, LINEAR_UNITS, METRE, MODEL_TYPE, PROJECTED, RASTER_TYPE
from gcs_mosaic.export.export import chosen_island
from gcs_mosaic.export.raster_file import GDAL_NODATA
from gcs_mosaic.export.target import refuse_our_own
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.transverse_mercator import LATITUDES_DEG, zone_of
from gcs_mosaic.geotiles.picture_grid import UtmZone
from gcs_mosaic.integral.aperture import SyntheticAperture
from gcs_mosaic.integral.focus import Focus
from gcs_mosaic.integral.forms import FORMS
from gcs_mosaic.integral.ground_lens import GroundLens, ground_lens
from gcs_mosaic.integral.ground_surface import GroundSurface
from gcs_mosaic.integral.hot_places import found_in, over_heights
from gcs_mosaic.integral.stack import GroundWindow
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.views.flight_view import FlightView

MOST_HEIGHTS = 100
BESIDE_S = 60.0  # that the ground is sought around a place where it is not seen
HINT_REACH = 10  # px between two hints that are one thing
MOST_CELLS = 2048
MODEL_TRANSFORMATION = 34264  # tag of GeoTIFF: an affine, as an island is turned on earth


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegralWish:
    """What is asked for. `heights`: shares of the flying height, None: the ground is sought; `flown_m`: metres above the ground
    that were flown, where somebody knows them, to tell heights in metres; `hints`: how many."""

    at: tuple[float, float]
    island: int | None = None
    heights: Sequence[float] | None = None
    cells: int = 512
    form: str = "mean"
    opened: float = 1.0
    flown_m: float | None = None
    hints: int = 0


def write_integral(flight: Path, target: Path, wish: IntegralWish) -> str:
    """Write it, a page of the file for each height; returns what is said of it. Raises UsageError."""
    refuse_our_own(target)
    if (wish.heights is not None and not 0 < len(wish.heights) <= MOST_HEIGHTS) or not 16 <= wish.cells <= MOST_CELLS:
        raise UsageError(f"Give at most {MOST_HEIGHTS} heights, and a side of 16 to {MOST_CELLS} pixels.")
    folder = find_flight(flight)
    view, island = FlightView(folder), chosen_island(folder, wish.island)["id"]
    lens = ground_lens(view, island, wish.at, wish.cells)
    lens.aperture(0.0 if wish.heights is None else wish.heights[0])  # says it where looks do not overlap
    focus = GroundSurface(view).focus_of(island, lens, BESIDE_S) if wish.heights is None else None
    heights = (focus.height,) if focus is not None else tuple(wish.heights or ())
    apertures = [lens.aperture(height, wish.opened) for height in heights]
    pages = [FORMS[wish.form](lens.stack(height, wish.opened)) for height in heights]
    laid = anchors_of(view).get(island)
    tags = () if laid is None or laid.anchor is None else earth_tags(lens.window, laid.anchor)
    with whole_file(target) as path:
        _write(path, lens, heights, pages, wish.form, tags)
    flying_m = None if wish.flown_m is None else above_map(wish.flown_m, heights, is_sought=focus is not None)
    said = [
        *_said(heights, apertures, flying_m),
        *_of_focus(focus),
        *_hints(lens, heights, wish, focus, flying_m),
        *_left_out(lens),
    ]
    where = "" if tags else "; without an anchor it has no coordinates on earth"
    size = f"{lens.window.cells} x {lens.window.cells} pixels of {lens.window.cell:.3g} canvas units"
    return "\n".join([*said, f"written to {target}, {size}{where}"])


def above_map(flown_m: float, heights: Sequence[float], *, is_sought: bool) -> float:
    """Metres from the map's ground to the cameras, of which heights are shares, by those flown above the ground beneath: that is
    where it was sought, else the lowest height asked for, but not above the map's."""
    ground = heights[0] if is_sought else min(0.0, *heights)
    return flown_m / (1 - ground)


def earth_tags(window: GroundWindow, anchor: Anchor) -> Sequence[tuple[Any, ...]]:
    """GeoTIFF's tags of a window: an affine from pixels to its zone of UTM. Over a lens' width that is exact to a millimetre.
    None near the poles, where there are no zones."""
    left, top = window.x - window.side / 2, window.y - window.side / 2
    corners = np.array([[left, top], [left + window.side, top], [left, top + window.side]])
    places = anchor.places(corners)
    longitude, latitude = places.mean(axis=0).tolist()
    if not LATITUDES_DEG[0] <= latitude <= LATITUDES_DEG[1]:  # NaN is not
        return ()
    zone = UtmZone(zone_of(longitude, latitude), is_north=latitude >= 0)
    corner, right, below = zone.points(places)
    across, down = (right - corner) / window.cells, (below - corner) / window.cells
    rows = np.zeros((4, 4))
    rows[:2, 0], rows[:2, 1], rows[:2, 3], rows[3, 3] = across, down, corner, 1.0
    keys = [(MODEL_TYPE, 1), (RASTER_TYPE, 1), (PROJECTED, zone.epsg), (LINEAR_UNITS, METRE)]
    directory = [1, 1, 0, len(keys), *(value for key, number in keys for value in (key, 0, 1, number))]
    return (MODEL_TRANSFORMATION, "d", 16, tuple(rows.ravel().tolist()), True), (
        GEO_KEYS,
        "H",
        len(directory),
        tuple(directory),
        True,
    )


def _write(
    path: Path,
    lens: GroundLens,
    heights: Sequence[float],
    pages: Sequence[FloatImage],
    form: str,
    tags: Sequence[tuple[Any, ...]],
) -> None:
    window = lens.window
    left, top = window.x - window.side / 2, window.y - window.side / 2
    about: dict[str, Any] = {
        "software": "gcs-mosaic",
        "canvas_from_pixel_edges": [[window.cell, 0.0, left], [0.0, window.cell, top]],
        "form": form,
        "heights": list(heights),  # shares of the flying height above the map's ground, one for each page
        "looks": [one.name for one in lens.looks],
        "not_readable": list(lens.lost),
    }
    with tifffile.TiffWriter(path) as file:
        for number, page in enumerate(pages):
            colour = page.shape[2] == 3
            grey = page.shape[2] == 1
            file.write(
                np.ascontiguousarray(page[..., 0] if grey else page[..., ::-1] if colour else page),
                photometric="rgb" if colour else "minisblack",
                planarconfig=None if grey else "contig",
                compression="zlib",
                metadata=None,
                software=False,
                description=json.dumps(about) if number == 0 else None,
                extratags=[(GDAL_NODATA, "s", 0, "nan", True), *tags],
            )


def _said(heights: Sequence[float], apertures: Sequence[SyntheticAperture], flying_m: float | None) -> Iterator[str]:
    for height, aperture in zip(heights, apertures, strict=True):
        yield (
            f"{aperture.looks} looks, {aperture.spread_deg:.0f} degrees between the outermost, "
            f"{aperture.width / aperture.height:.2f} flying heights apart; in focus {_height_words(height, flying_m)} "
            f"the map's ground"
        )


def _of_focus(focus: Focus | None) -> Iterator[str]:
    if focus is not None and focus.known:
        yield f"that is where the looks agree lowest, {focus.agreement:.1f} times as much as by chance: the ground"
    elif focus is not None and focus.beside:
        yield "that is where the ground was found around this place; here it is not seen by itself: try others by --height"
    elif focus is not None:
        where = "at many heights, as crowns do; this is the lowest" if focus.height else "at no height"
        yield f"where the ground lies is not known here, for the looks agree {where}: try several by --height"


def _hints(
    lens: GroundLens, heights: Sequence[float], wish: IntegralWish, focus: Focus | None, flying_m: float | None
) -> Iterator[str]:
    if not wish.hints:
        return
    unit_m = None if flying_m is None else flying_m / lens.flying_height
    guess = None if focus is None else focus.guess
    is_dark = wish.form == "min"
    every = [
        one
        for height in heights
        for one in found_in(lens, height, wish.opened, wish.hints, unit_m, guess, is_dark=is_dark)
    ]
    aside = lens.aperture(heights[0], wish.opened).width / 2
    for one in over_heights(every, HINT_REACH * lens.window.cell, aside)[: wish.hints]:
        yield (
            f"hint at {one.x:.0f},{one.y:.0f}, {one.score:.1f} deviations, {_height_words(one.height, flying_m)} "
            "the map's ground"
        )


def _left_out(lens: GroundLens) -> Iterator[str]:
    if lens.lost:
        yield f"left out: {len(lens.lost)} frames whose originals cannot be read, {lens.lost[0]} the first"
    if lens.left_out:
        yield f"left out: {lens.left_out} frames, as more looks are not kept in memory"


def _height_words(share: float, flying_m: float | None) -> str:
    where = "above" if share >= 0 else "below"
    metres = "" if flying_m is None else f" ({abs(share) * flying_m:.1f} m)"
    return f"{abs(share):.1%} of the flying height{metres} {where}"

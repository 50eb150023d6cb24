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
from gcs_mosaic.export.export import chosen_island
from gcs_mosaic.export.raster_file import GDAL_NODATA
from gcs_mosaic.export.target import refuse_our_own
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.integral.aperture import SyntheticAperture
from gcs_mosaic.integral.forms import FORMS, looks_of, mean
from gcs_mosaic.integral.ground_lens import GroundLens, ground_lens
from gcs_mosaic.integral.hot_places import HotPlace, oddity, over_heights, peaks
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.views.flight_view import FlightView

MOST_HEIGHTS = 100
HINT_REACH = 10  # px between two hints that are one thing
MOST_CELLS = 2048


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegralWish:
    """What is asked for. `heights`: shares of the flying height; `flown_m`: metres above the ground
    that were flown, where somebody knows them, to tell heights in metres; `hints`: how many."""

    at: tuple[float, float]
    island: int | None = None
    heights: Sequence[float] = (0.0,)
    cells: int = 512
    form: str = "mean"
    opened: float = 1.0
    flown_m: float | None = None
    hints: int = 0


def write_integral(flight: Path, target: Path, wish: IntegralWish) -> str:
    """Write it, a page of the file for each height; returns what is said of it. Raises UsageError."""
    refuse_our_own(target)
    if not 0 < len(wish.heights) <= MOST_HEIGHTS or not 16 <= wish.cells <= MOST_CELLS:
        raise UsageError(f"Give at most {MOST_HEIGHTS} heights, and a side of 16 to {MOST_CELLS} pixels.")
    folder = find_flight(flight)
    lens = ground_lens(FlightView(folder), chosen_island(folder, wish.island)["id"], wish.at, wish.cells)
    heights = tuple(wish.heights)
    apertures = [lens.aperture(height, wish.opened) for height in heights]
    pages, hints = list[FloatImage](), list[HotPlace]()
    for height in heights:
        stack = lens.stack(height, wish.opened)
        pages.append(FORMS[wish.form](stack))
        if wish.hints:
            hints += peaks(oddity(mean(stack), looks_of(stack)), lens.window, height, wish.hints)
    hints = over_heights(hints, HINT_REACH * lens.window.cell)[: wish.hints]
    with whole_file(target) as path:
        _write(path, lens, heights, pages, wish.form)
    return "\n".join(_said(lens, heights, apertures, wish, hints, target))


def _write(path: Path, lens: GroundLens, heights: Sequence[float], pages: Sequence[FloatImage], form: str) -> None:
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
            file.write(
                np.ascontiguousarray(page[..., ::-1] if colour else page),
                photometric="rgb" if colour else "minisblack",
                planarconfig="contig",
                compression="zlib",
                metadata=None,
                software=False,
                description=json.dumps(about) if number == 0 else None,
                extratags=[(GDAL_NODATA, "s", 0, "nan", True)],
            )


def _said(
    lens: GroundLens,
    heights: Sequence[float],
    apertures: Sequence[SyntheticAperture],
    wish: IntegralWish,
    hints: Sequence[HotPlace],
    target: Path,
) -> Iterator[str]:
    for height, aperture in zip(heights, apertures, strict=True):
        yield (
            f"{aperture.looks} looks, {aperture.spread_deg:.0f} degrees between the outermost, "
            f"{aperture.width / aperture.height:.2f} flying heights apart; in focus {_height_words(height, wish.flown_m)} "
            f"the map's ground"
        )
    for one in hints:
        yield (
            f"hint at {one.x:.0f},{one.y:.0f}, {one.score:.1f} deviations, {_height_words(one.height, wish.flown_m)} "
            "the map's ground"
        )
    if lens.lost:
        yield f"left out: {len(lens.lost)} frames whose originals cannot be read, {lens.lost[0]} the first"
    if lens.left_out:
        yield f"left out: {lens.left_out} frames, as more looks are not kept in memory"
    yield f"written to {target}, {lens.window.cells} x {lens.window.cells} pixels of {lens.window.cell:.3g} canvas units"


def _height_words(share: float, flown_m: float | None) -> str:
    where = "above" if share >= 0 else "below"
    metres = "" if flown_m is None else f" ({abs(share) * flown_m:.1f} m)"
    return f"{abs(share):.1%} of the flying height{metres} {where}"

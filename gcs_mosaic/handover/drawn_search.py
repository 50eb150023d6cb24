"""What is drawn in the file for the debriefing: layers over an island's picture, which can be hidden without a script, and curves
over time. SVG as text; no style is written into it, which the file's policy forbids."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.detection.detection_map import DetectionMap
from gcs_mosaic.handover.search_course import Looked
from gcs_mosaic.notes.finds.overview import Overview
from gcs_mosaic.notes.search.seen_ground import CELL
from gcs_mosaic.render.tile_grid import HALF_SPAN
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.coverage import Gap
from gcs_mosaic.views.layers import coloured, stops_of

COLOURS = cv2.COLORMAP_VIRIDIS  # as the page shows the probability
OPAQUE = 150  # of 255: the ground shows through
WIDE, HIGH, LEFT, BELOW = 640, 180, 44, 22  # of curves, in their own units


@dataclass(frozen=True, slots=True)
class DrawnLayer:
    """Something that lies over the map; `kind`: one of those that the style knows, see `overview.LAYERS`; `is_shown` at first."""

    kind: str
    title: str
    drawn: str
    is_shown: bool = True


@dataclass(frozen=True, slots=True)
class Curve:
    """Shares over time: (seconds, share) in order; `colour` as of SVG."""

    title: str
    colour: str
    points: Sequence[tuple[float, float]]


def layered(one: Overview, layers: Sequence[DrawnLayer]) -> str:
    """HTML of an island's picture with layers, each with a box that shows or hides it."""
    boxes = []
    for layer in layers:
        name, checked = f"{layer.kind}{one.island}", " checked" if layer.is_shown else ""
        boxes.append(
            f'<input type="checkbox" id="{name}" class="{layer.kind}"{checked}>'
            f'<label for="{name}">{html.escape(layer.title)}</label>'
        )
    drawn = [f'<g class="{layer.kind}">{layer.drawn}</g>' for layer in layers]
    return f'<div class="layered">{" ".join(boxes)}{one.figure(drawn)}</div>'


def ways(one: Overview, frames: Sequence[PositionRecord]) -> Iterator[str]:
    """The cameras' places in the order of the pictures, of each aircraft, with a dot where it begins."""
    width = max(one.image.shape[:2]) / 500
    for vehicle in sorted({frame.vehicle for frame in frames}, key=lambda system: system or 0):
        places = [(frame.pose.x, frame.pose.y) for frame in frames if frame.vehicle == vehicle]
        yield f'<polyline points="{_points(one, places)}" fill="none" stroke="#05f" stroke-width="{width:.1f}"/>'
        for x, y in _finite(one.points(places[:1])):
            yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{3 * width:.1f}" fill="#05f"><title>begins here</title></circle>'


def outline_of_gap(one: Overview, gap: Gap) -> str:
    width = max(one.image.shape[:2]) / 400
    return (
        f'<polygon points="{_points(one, gap.outline)}" fill="#f80" fill-opacity="0.35" stroke="#f80" '
        f'stroke-width="{width:.1f}"/>'
    )


def unreviewed(one: Overview, looked: Looked) -> str:
    """The ground that nobody has looked at as it is now; cells of a line in one."""
    bare = np.pad((looked.ground.stamps > 0) & np.isnan(looked.utc), ((0, 0), (1, 1))).astype(np.int8)
    lines, ends = np.nonzero(np.diff(bare, axis=1))
    pieces = []
    for line, first, last in zip(lines[::2].tolist(), ends[::2].tolist(), ends[1::2].tolist(), strict=True):
        left, top = ((at * CELL - HALF_SPAN) for at in (looked.ground.x + first, looked.ground.y + line))
        (x, y), (right, bottom) = one.points([(left, top), (left + (last - first) * CELL, top + CELL)])
        pieces.append(f"M{x:.1f} {y:.1f}H{right:.1f}V{bottom:.1f}H{x:.1f}z")
    return f'<path d="{"".join(pieces)}" fill="#000" fill-opacity="0.55"/>'


def probability(one: Overview, found: DetectionMap) -> str:
    """The layer of the page as a picture."""
    known = np.isfinite(found.probability) & found.flown
    colours = coloured(COLOURS, np.nan_to_num(found.probability))
    bgra = np.dstack([colours, np.where(known, OPAQUE, 0).astype(np.uint8)])
    data = base64.b64encode(cv2.imencode(".png", bgra)[1].tobytes()).decode("ascii")
    left, top, right, bottom = found.grid.box
    (x, y), (x1, y1) = one.points([(left, top), (right, bottom)])
    return (
        f'<image x="{x:.1f}" y="{y:.1f}" width="{x1 - x:.1f}" height="{y1 - y:.1f}" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{data}"/>'
    )


def colour_bar() -> str:
    """From 0 to 100 %."""
    stops = stops_of(COLOURS)
    wide = 100 / len(stops)
    parts = [
        f'<rect x="{wide * at:.1f}" width="{wide + 0.5:.1f}" height="8" fill="{colour}"/>'
        for at, colour in enumerate(stops)
    ]
    return f'<small>probability 0 % <svg class="bar" viewBox="0 0 100 8">{"".join(parts)}</svg> 100 %</small>'


def curves(drawn: Sequence[Curve], first: str, last: str) -> str:
    """Shares over the time from `first` to `last`, which are written below; nothing where there is no time between."""
    times = [s for curve in drawn for s, _ in curve.points if math.isfinite(s)]
    if not times or max(times) <= min(times):
        return ""
    begin, span = min(times), max(times) - min(times)
    wide, high = WIDE - LEFT - 8, HIGH - BELOW - 8

    def at(s: float, share: float) -> str:
        return f"{LEFT + wide * (s - begin) / span:.1f},{8 + high * (1 - share):.1f}"

    parts = []
    for share in (0, 0.5, 1):
        y = 8 + high * (1 - share)
        parts.append(f'<path d="M{LEFT} {y}H{LEFT + wide}" stroke="#bbb" stroke-width="1"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4}" text-anchor="end">{share:.0%}</text>')
    for curve in drawn:
        points = " ".join(at(s, share) for s, share in curve.points if math.isfinite(s))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{curve.colour}" stroke-width="2.5"/>')
    parts.append(f'<text x="{LEFT}" y="{HIGH - 6}">{html.escape(first)}</text>')
    parts.append(f'<text x="{LEFT + wide}" y="{HIGH - 6}" text-anchor="end">{html.escape(last)}</text>')
    return f'<svg class="curves" viewBox="0 0 {WIDE} {HIGH}">{"".join(parts)}</svg>{_key(drawn)}'


def _key(drawn: Iterable[Curve]) -> str:
    swatch = '<svg class="swatch" viewBox="0 0 20 8"><path d="M0 4H20" stroke="{}" stroke-width="3"/></svg>'
    return f"<small>{' '.join(swatch.format(one.colour) + ' ' + html.escape(one.title) for one in drawn)}</small>"


def _points(one: Overview, places: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in _finite(one.points(places)))


def _finite(points: Iterable[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    return ((x, y) for x, y in points if math.isfinite(x) and math.isfinite(y))

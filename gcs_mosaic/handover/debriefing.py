"""One file for the debriefing: the map, the aircraft's way, finds, unseen ground, islands and times, without a network or us."""

from __future__ import annotations

import html
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from gcs_mosaic.handover.beneath import BeneathLeaves
from gcs_mosaic.handover.mission import CoverageOf
from gcs_mosaic.notes.anchors.anchoring import IslandAnchor, geo_place
from gcs_mosaic.notes.finds.exports import anchor_words, in_number
from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.notes.finds.overview import Overview, overviews
from gcs_mosaic.notes.finds.report import cards, coordinate, document
from gcs_mosaic.notes.texts import iso, shown
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.flight_view import FlightView

MOST_MAPS = 24  # of the largest islands
MOST_GAPS = 50  # in the table of an island; all are drawn

Laid = Mapping[int, IslandAnchor]

TAKEN_BY = {
    "camera": "pictures taken, by the camera's clock",
    "message": "pictures taken, by the messages",
    "file": "pictures came, by their files",
}


def as_debriefing(
    view: FlightView, finds: Sequence[PlacedFind], laid: Laid, coverage_of: CoverageOf, made_utc: float
) -> str:
    """HTML that loads nothing and in which no script runs; times in UTC. Raises UsageError if there is no flight."""
    record, maps = view.flight(), overviews(view.root, MOST_MAPS)
    flight = shown(record.name if record else view.root.resolve().name)
    frames = view.table().frames
    parts = [
        _table(_facts(view, frames, made_utc, record.started_utc if record else None)),
        *(f"<h2>Island {one.island}</h2>{_island(one, view, finds, laid, coverage_of)}" for one in maps),
        f"<h2>{in_number(finds)}</h2>",
        *(f"<p>{html.escape(text)}</p>" for text in anchor_words(finds)),
        cards(finds, view, BeneathLeaves(view)),
    ]
    return document(f"{flight}: debriefing", "\n".join(parts))


def _facts(
    view: FlightView, frames: Sequence[PositionRecord], made_utc: float, started_utc: float | None
) -> Iterator[tuple[str, str]]:
    states = Counter(str(one.state) for one in view.frames())
    times = view.capture_times(view.table())
    taken = [times[one.number] for one in frames if one.number in times]
    if started_utc is not None:
        yield "stitching began", iso(started_utc)
    for clock, said in TAKEN_BY.items():
        ours = sorted((one for one in taken if one.by == clock), key=lambda one: one.s)
        if ours:
            yield said, f"{ours[0].iso('seconds')} to {ours[-1].iso('seconds')}"
    yield "frames", ", ".join(f"{count} {state}" for state, count in states.most_common()) or "none"
    yield "this file was made", iso(made_utc)


def _island(one: Overview, view: FlightView, finds: Sequence[PlacedFind], laid: Laid, coverage_of: CoverageOf) -> str:
    seen = coverage_of(one.island)
    coverage, gaps = seen.coverage, seen.gaps
    frames = sorted((frame for frame in view.table().frames if frame.island == one.island), key=lambda it: it.order)
    drawn = [*_ways(one, frames), *(_polygon(one, gap.outline) for gap in gaps), *one.marks(finds)]
    anchor = laid[one.island].anchor if one.island in laid else None
    metres = None if anchor is None else anchor.metres_per_unit
    facts = [("frames on the map", str(len(frames)))]
    if coverage is not None:
        facts.append(("seen", _area(float((coverage.looks > 0).sum()) * coverage.grid.cell**2, metres)))
        facts.append(("inside of it not seen", f"{_area(sum(gap.area for gap in gaps), metres)}, in {len(gaps)} gaps"))
    facts.append(("on earth", "not known: the island has no anchor" if anchor is None else _laid(laid[one.island])))
    rows = []
    for number, gap in enumerate(gaps[:MOST_GAPS], 1):
        geo = None if anchor is None else geo_place(anchor, *gap.inside)
        where = f"canvas {gap.inside[0]:.0f}, {gap.inside[1]:.0f}" if geo is None else coordinate(geo)
        rows.append((f"gap {number}", f"{_area(gap.area, metres)} about {where}"))
    told = "red: finds; blue: the way; orange: inside the flown area, seen by no frame"
    return f"{one.figure(drawn)}<small>{told}</small>{_table([*facts, *rows])}"


def _ways(one: Overview, frames: Sequence[PositionRecord]) -> Iterator[str]:
    """The cameras' places in the order of the pictures, of each aircraft."""
    width = max(one.image.shape[:2]) / 500
    for vehicle in sorted({frame.vehicle for frame in frames}, key=lambda system: system or 0):
        places = [(frame.pose.x, frame.pose.y) for frame in frames if frame.vehicle == vehicle]
        yield f'<polyline points="{_points(one, places)}" fill="none" stroke="#05f" stroke-width="{width:.1f}"/>'


def _polygon(one: Overview, outline: Sequence[tuple[float, float]]) -> str:
    width = max(one.image.shape[:2]) / 400
    return (
        f'<polygon points="{_points(one, outline)}" fill="#f80" fill-opacity="0.35" stroke="#f80" '
        f'stroke-width="{width:.1f}"/>'
    )


def _points(one: Overview, places: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in one.points(places) if math.isfinite(x) and math.isfinite(y))


def _area(units: float, metres_per_unit: float | None) -> str:
    """Canvas units squared as people say it."""
    if metres_per_unit is None:
        return f"{units / 1e6:.2f} million pixels"
    area = units * metres_per_unit**2
    return f"{area:,.0f} m²" if area < 100_000 else f"{area / 1e6:.2f} km²"


def _laid(one: IslandAnchor) -> str:
    by = "by pins" if one.by == "pins" else "by the aircraft's positions"
    return f"{by}, {one.anchor.metres_per_unit * 100:.1f} cm a pixel" if one.anchor is not None else "not known"


def _table(rows: Iterable[tuple[str, str]]) -> str:
    lines = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(told)}</td></tr>" for name, told in rows)
    return f"<table>{lines}</table>"

"""One file for the debriefing: the map, the aircraft's way, finds, what was not seen and not looked at, the probability that
somebody would have been found, and all that by time, without a network or us."""

from __future__ import annotations

import html
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs_mosaic.handover.beneath import BeneathLeaves
from gcs_mosaic.handover.drawn_search import (
    Curve,
    DrawnLayer,
    colour_bar,
    curves,
    layered,
    outline_of_gap,
    probability,
    unreviewed,
    ways,
)
from gcs_mosaic.handover.mission import CoverageOf
from gcs_mosaic.handover.search_course import Flown, Looked, Moment, SoughtPerson, flown_course
from gcs_mosaic.notes.anchors.anchoring import IslandAnchor, geo_place
from gcs_mosaic.notes.finds.exports import anchor_words, in_number
from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.notes.finds.overview import Overview, overviews
from gcs_mosaic.notes.finds.report import cards, coordinate, document
from gcs_mosaic.notes.texts import iso, shown
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.coverage import SeenIsland
from gcs_mosaic.views.flight_view import FlightView

MOST_MAPS = 24  # of the largest islands
MOST_GAPS = 50  # in the table of an island; all are drawn
MOST_LINES = 8  # of a table by time

Laid = Mapping[int, IslandAnchor]

TAKEN_BY = {
    "camera": "pictures taken, by the camera's clock",
    "message": "pictures taken, by the messages",
    "file": "pictures came, by their files",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Searched:
    """What people have added to a flight. `looked`: what was looked at, by island; `sought`: who is, None where no probability is
    to be told."""

    finds: Sequence[PlacedFind]
    laid: Laid
    looked: Mapping[int, Looked] = field(default_factory=dict)
    sought: SoughtPerson | None = None


def as_debriefing(view: FlightView, searched: Searched, coverage_of: CoverageOf, made_utc: float) -> str:
    """HTML that loads nothing and in which no script runs; times in UTC. Raises UsageError if there is no flight."""
    record, maps, finds = view.flight(), overviews(view.root, MOST_MAPS), searched.finds
    flight = shown(record.name if record else view.root.resolve().name)
    frames = view.table().frames
    parts = [
        _table(_facts(view, frames, made_utc, record.started_utc if record else None)),
        *(f"<h2>Island {one.island}</h2>{_island(one, view, searched, coverage_of)}" for one in maps),
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


def _island(one: Overview, view: FlightView, searched: Searched, coverage_of: CoverageOf) -> str:
    seen, looked = coverage_of(one.island), searched.looked.get(one.island)
    flown = flown_course(view, one.island, seen, searched.sought)
    frames = sorted((frame for frame in view.table().frames if frame.island == one.island), key=lambda it: it.order)
    layers = [
        DrawnLayer("way", "the aircraft's way", "".join(ways(one, frames))),
        DrawnLayer("gaps", "not seen by any frame (orange)", "".join(outline_of_gap(one, gap) for gap in seen.gaps)),
        DrawnLayer("marks", "finds", "".join(one.marks(searched.finds))),
    ]
    if looked is not None:
        layers.insert(
            2, DrawnLayer("unreviewed", "looked at by nobody (dark)", unreviewed(one, looked), is_shown=False)
        )
    if flown.found is not None:
        layers.insert(2, DrawnLayer("probability", "probability", probability(one, flown.found), is_shown=False))
    bar = colour_bar() if flown.found is not None else ""
    facts = _table(
        [*_of_ground(seen, len(frames), searched.laid.get(one.island)), *_of_people(looked, flown, searched)]
    )
    return f"{layered(one, layers)}{bar}{facts}{_by_time(view, one.island, flown, looked, searched.finds)}"


def _of_ground(seen: SeenIsland, frames: int, laid: IslandAnchor | None) -> Iterator[tuple[str, str]]:
    coverage, gaps = seen.coverage, seen.gaps
    anchor = None if laid is None else laid.anchor
    metres = None if anchor is None else anchor.metres_per_unit
    yield "frames on the map", str(frames)
    if coverage is not None:
        yield "seen", _area(float((coverage.looks > 0).sum()) * coverage.grid.cell**2, metres)
        yield (
            "inside of it not seen",
            f"{_area(sum(gap.area for gap in gaps), metres)}, in {len(gaps)} {'gap' if len(gaps) == 1 else 'gaps'}",
        )
    yield "on earth", "not known: the island has no anchor" if laid is None or anchor is None else _laid(laid)
    for number, gap in enumerate(gaps[:MOST_GAPS], 1):
        geo = None if anchor is None else geo_place(anchor, *gap.inside)
        where = f"canvas {gap.inside[0]:.0f}, {gap.inside[1]:.0f}" if geo is None else coordinate(geo)
        yield f"gap {number}", f"{_area(gap.area, metres)} about {where}"


def _of_people(looked: Looked | None, flown: Flown, searched: Searched) -> Iterator[tuple[str, str]]:
    """What was looked at, and would have been found."""
    if looked is not None:
        by = ", ".join(f"{shown(who)} {share:.0%}" for who, share in sorted(looked.shares.items()))
        yield "looked at, at full sharpness", f"{looked.share:.0%}{f' ({by})' if by else ''}"
    found, sought = flown.found, searched.sought
    if found is None or sought is None:
        yield "would somebody have been seen", f"not known: {flown.trouble}"
        return
    person = f"somebody {sought.person.posture} in {sought.person.clothes}"
    flown_share, seen_share = found.within(found.flown), found.within(found.is_seen & found.flown)
    told = [
        f"{flown_share or 0:.0%} in what was flown, gaps included",
        f"{seen_share or 0:.0%} on ground that was seen",
    ]
    if found.measured < found.frames:
        told.append(f"{found.measured} of {found.frames} pictures are measured")
    if found.covered < 1:
        told.append(
            f"of {math.ceil(100 * (1 - found.covered))} % of it nothing is stated, and it is not in these figures"
        )
    if found.leaves_unknown:
        told.append(
            f"on {math.ceil(100 * found.leaves_unknown)} % of it no two looks tell whether leaves hide the ground"
        )
    yield f"probability that {person} is in the pictures and stands out", "; ".join(told)
    yield "", "A model's advice, fitted to simulated flights: it clears no ground."


def _by_time(view: FlightView, island: int, flown: Flown, looked: Looked | None, finds: Sequence[PlacedFind]) -> str:
    """Two tables with curves: by the pictures' clock and by that of those who looked."""
    zone = "" if {one.by for one in view.capture_times(view.table()).values()} == {"camera"} else "Z"

    def when(s: float) -> str:
        return f"{iso(s)[:-1]}{zone}" if math.isfinite(s) else "not known"

    parts, moments = [], flown.stated or _thinned(flown.moments)
    if moments:
        parts.append(f"<h3>As it was flown</h3>{_flown_curves(flown, when)}")
        parts.append(
            _rows(("last picture", "pictures", "seen", "probability"), (_told(one, when(one.s)) for one in moments))
        )
    ours = sorted(one.find.created_utc for one in finds if one.place.island == island)
    if looked is not None and (ours or np.isfinite(looked.utc).any()):
        parts.append(f"<h3>As it was looked at</h3>{_of_looks(looked, ours)}")
    return "".join(parts)


def _flown_curves(flown: Flown, when: Callable[[float], str]) -> str:
    """Over the time; over the number of pictures where all files came at once, or nobody knows when."""
    first, last = flown.moments[0], flown.moments[-1]
    is_timed = all(math.isfinite(one.s) for one in flown.moments) and when(first.s) != when(last.s)

    def along(one: Moment) -> float:
        return one.s if is_timed else float(one.pictures)

    drawn = [Curve("seen, of all that was flown", "#05f", [(along(one), one.seen) for one in flown.moments])]
    if flown.stated:
        told = [(along(one), one.probability or 0.0) for one in flown.stated]
        drawn.append(Curve("probability, of all that was flown", "#083", told))
    ends = (when(first.s), when(last.s)) if is_timed else ("1 picture", f"{last.pictures} pictures")
    return curves(drawn, *ends)


def _told(one: Moment, when: str) -> tuple[str, ...]:
    return when, str(one.pictures), f"{one.seen:.0%}", "" if one.probability is None else f"{one.probability:.0%}"


def _of_looks(looked: Looked, finds: Sequence[float]) -> str:
    """Over the times at which each place was last looked at, and finds were marked (seconds since 1970)."""
    times = np.sort(looked.utc[np.isfinite(looked.utc)])
    count = max(int((looked.ground.stamps > 0).sum()), 1)
    moments = np.unique(np.concatenate([times, finds]))
    shares = np.searchsorted(times, moments, side="right") / count
    marked = np.searchsorted(np.array(finds), moments, side="right")
    drawn = [Curve("looked at, of all ground", "#a0a", list(zip(moments.tolist(), shares.tolist(), strict=True)))]
    rows = [(iso(moments[at]), f"{shares[at]:.0%}", str(marked[at])) for at in _steps(len(moments))]
    told = _rows(("until", "looked at", "finds marked"), rows)
    return f"{curves(drawn, iso(moments[0]), iso(moments[-1]))}{told}<small>Each place counts from its last look on.</small>"


def _thinned(moments: Sequence[Moment]) -> list[Moment]:
    return [moments[at] for at in _steps(len(moments))]


def _steps(count: int) -> list[int]:
    """At most `MOST_LINES` of so many, the last among them."""
    steps = np.unique(np.linspace(0, count, MOST_LINES + 1).round().astype(int)[1:]) - 1
    return [int(at) for at in steps if at >= 0]


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


def _rows(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    titles = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    lines = "".join(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><tr>{titles}</tr>{lines}</table>"

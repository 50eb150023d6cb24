"""Held-out error of the islands, for documents and display: how far apart the map places held-out matches."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.documents import finite, told_of
from gcs_mosaic.store.told_documents import HeldOutEntry

Figures = Mapping[int, HeldOut]  # by island
# Of the frames. Someone is told from a stone at some 20 px: where one match in twenty is torn by twice that, people and cars
# are doubled or cut.
TORN_P95_PX = 40.0


def largest(figures: Figures, count: int) -> Figures:
    """The figures of the `count` islands with most matches."""
    most = sorted(figures.items(), key=lambda item: -item[1].matches)[:count]
    return dict(sorted(most))


def held_out_entry(found: HeldOut) -> HeldOutEntry:
    return HeldOutEntry(median=_rounded(found.median_px), p95=_rounded(found.p95_px), matches=found.matches)


def held_out_words(island: object, entry: dict[str, Any]) -> str:
    """An island's entry as text."""
    median, p95 = ("endless" if px is None else f"{px:.1f} px" for px in (entry["median"], entry["p95"]))
    return f"held-out matches: {median} median, {p95} 95 % (island {island}, {entry['matches']:,} matches)"


def held_out_lines(figures: Figures) -> list[str]:
    """The islands' held-out errors, one line each."""
    return [held_out_words(island, told_of(held_out_entry(found))) for island, found in figures.items()]


def torn_lines(figures: Figures) -> list[str]:
    """A sentence for each island that is torn so far that things are doubled or cut."""
    return [_torn_words(island, found) for island, found in figures.items() if found.p95_px > TORN_P95_PX]


def _torn_words(island: int, found: HeldOut) -> str:
    apart = f"{found.p95_px:.0f} px or more" if math.isfinite(found.p95_px) else "without end"
    return (
        f"island {island} is torn: where its frames overlap one match in twenty is {apart} apart, so that a person may be on the "
        "map twice or in part. Look at the originals there (a click on the map), and trust no distance"
    )


def _rounded(px: float) -> float | None:
    known = finite(px)
    return None if known is None else round(known, 2)

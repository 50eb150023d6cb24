"""Stage 10, of counts: in which range those of each camera's frames are shown, and by which step each frame's differ; from all
that were placed and from what they see in common. Frames of 8 bits are shown as they are."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.cameras import by_camera
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.exposure_compensation import BookedFrame, book_of, booked_frames, placements_of, uncompensated
from gcs_mosaic.archive.features import SeenFrame
from gcs_mosaic.archive.frame_kinds import FrameKind
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.render.agreement import counts_overlap_of
from gcs_mosaic.render.brightness import CountOverlap
from gcs_mosaic.render.camera_ranges import fitted_displays
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.repaint_queue import PaintSettings
from gcs_mosaic.stitch.camera.dead_border import FRAMES


def with_ranges(
    engine: Engine,
    frames: Sequence[SeenFrame],
    kinds: Sequence[FrameKind],
    chunks: Sequence[tuple[str, Sequence[str]]],
    settings: PaintSettings,
) -> list[FrameKind]:
    """The kind of each frame, those of counts with their final display."""
    if not any(one.facts.counts for one in frames):
        return list(kinds)
    book = engine.listed(booked_frames(frames, kinds, chunks))
    starts = [int(at) for at in np.cumsum([0, *(len(names) for _, names in chunks)])]
    parts = [task(count_overlaps, book, first, stop) for first, stop in pairwise(starts)]
    engine.made("counts in overlaps", parts)
    keys = engine.listed([one.key for one in parts])
    (displays,) = engine.made("ranges", [task(ranges, book, keys, settings.bands, settings.brightness == "auto")])
    return [
        replace(kind, display=displays.get(one.frame.name, kind.display))
        for one, kind in zip(frames, kinds, strict=True)
    ]


def count_overlaps(artefacts: Artefacts, book: str, first: int, stop: int) -> Parts:
    """What some frames of counts have in common with linked ones before them."""
    known = book_of(artefacts, book)
    found = list[CountOverlap]()
    for one in list(known.values())[first:stop]:
        if not one.frame.facts.counts:
            continue
        linked = placements_of(artefacts, one.placements)[one.place].neighbours
        for other in (known[name] for name in linked if name in known and known[name].order < one.order):
            found += _overlap(artefacts, one, other)
    return {"summary": len(found), "overlaps": found}


def _overlap(artefacts: Artefacts, one: BookedFrame, other: BookedFrame) -> list[CountOverlap]:
    """None or one."""
    new, beside = (replace(uncompensated(artefacts, booked), relief=None) for booked in (one, other))
    if one.frame.facts.kind != other.frame.facts.kind or new.island != beside.island:
        return []
    small, beside_small = (artefacts.part(booked.frame.key, "thumbnail") for booked in (one, other))
    counts = counts_overlap_of(new, small, beside, beside_small)
    return [] if counts is None else [(new.name, beside.name, counts)]


def ranges(artefacts: Artefacts, book: str, overlaps: str, bands: tuple[int, ...], lighten: bool) -> Parts:
    """The display of each placed frame of counts, by name."""
    of_counts = [one.frame for one in book_of(artefacts, book).values() if one.frame.facts.counts]
    found: list[CountOverlap] = [
        one for key in artefacts.part(overlaps, "list") for one in artefacts.part(key, "overlaps")
    ]
    groups: dict[Hashable, list[SeenFrame]] = {}
    for one, camera in zip(of_counts, by_camera(of_counts, FRAMES), strict=True):
        groups.setdefault(camera, []).append(one)
    displays: dict[str, Display] = {}
    for some in groups.values():
        sketches = {one.frame.name: one.facts.counts for one in some}
        shared = [one for one in found if one[0] in sketches and one[1] in sketches]
        displays |= fitted_displays(sketches, shared, bands, lighten=lighten)
    return {"summary": displays}

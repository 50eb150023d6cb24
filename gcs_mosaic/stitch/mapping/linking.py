"""More links between what several aircraft, or several flights, have seen of one ground.

Islands are joined by the few pairs of frames that prove it. Where two flights lie over each other, that leaves most frames of one
without a link to the other, and the two maps apart by what either is bent. So, once they are joined and adjusted, each frame is
matched with those of the others around it, as a new frame is when it is placed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.view_graph import NOWHERE, ViewGraph
from gcs_mosaic.stitch.mapping.islands import AGREEMENT
from gcs_mosaic.stitch.registration.outcome import Registration


def link_across(graph: ViewGraph, search: Search) -> dict[int, int]:
    """Link placed frames with those of other aircraft that they overlap; returns how many links each island has gained."""
    gained: dict[int, int] = {}
    for frame in graph.placed().tolist():
        island = graph.island_of(frame)
        for other, registration in _new_links(graph, search, frame, island):
            graph.link(frame, other, registration)
            gained[island] = gained.get(island, 0) + 1
    return gained


def _new_links(graph: ViewGraph, search: Search, frame: int, island: int) -> Iterator[tuple[int, Registration]]:
    """Registrations of a frame with others' frames around it, where they agree with how the two lie."""
    others = {one for one in graph.members(island).tolist() if _aircraft(graph, one) != _aircraft(graph, frame)}
    if not others:
        return
    for other, found in search.neighbour_links(frame, graph.pose_of(frame), island).items():
        if found is not None and other in others and _agrees(graph, frame, other, found):
            yield other, found


def link_pairs(graph: ViewGraph, search: Search, pairs: Iterable[tuple[int, int]]) -> tuple[dict[int, int], int]:
    """Link these pairs of frames where they lie on one island and are not linked yet; returns how many links each island has
    gained, and how many registrations do not agree with how the frames lie."""
    gained, astray = dict[int, int](), 0
    for frame, other in pairs:
        island = int(graph.islands[frame])
        if island == NOWHERE or graph.islands[other] != island or other in graph.frames[frame].inliers:
            continue
        found = search.register(frame, other)
        if found is None:
            continue
        if _agrees(graph, frame, other, found):
            graph.link(frame, other, found)
            gained[island] = gained.get(island, 0) + 1
        else:
            astray += 1
    return gained, astray


def _aircraft(graph: ViewGraph, frame: int) -> int | None:
    return graph.aircraft_of[graph.frames[frame].camera]


def _agrees(graph: ViewGraph, frame: int, other: int, found: Registration) -> bool:
    """Whether both frames have these matches in about the same places: look-alikes are elsewhere."""
    here, there = (
        canvas_from_pixels(graph.pose_of(one), graph.camera_of(one), pixels)
        for one, pixels in ((frame, found.pixels_a), (other, found.pixels_b))
    )
    box = graph.boxes[frame]
    apart = np.median(np.linalg.norm(here - there, axis=1))
    return bool(apart < AGREEMENT * np.linalg.norm(box[2:] - box[:2]))  # of the horizon it is NaN: no

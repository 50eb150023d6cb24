"""One graph of two: the frames, links, lenses and islands of another flight, as they were found there.

Nothing is compared or moved: the islands of both lie apart, each on its own canvas, until matches join them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from gcs_mosaic.stitch.graph.view_graph import (
    FIRST_CELLS,
    FIRST_SHARE,
    NOWHERE,
    Aircraft,
    Bridge,
    CameraNumber,
    GraphFrame,
    ViewGraph,
)


@dataclass(frozen=True, slots=True)
class Renamed:
    """What tells another flight's frames and cameras from ours."""

    name_of: Callable[[str], str]
    aircraft_of: Callable[[Aircraft], Aircraft]


def unite(graph: ViewGraph, other: ViewGraph, renamed: Renamed) -> int:
    """Add another graph to this one; returns the number of its first island here. Its frames count as moved."""
    first, islands = len(graph.frames), len(graph.merged_into)
    cameras = _cameras(graph, other, renamed)
    graph.merged_into += [None if into is None else into + islands for into in other.merged_into]
    for state in other.frames:
        _add_frame(graph, _moved(state, first, cameras, renamed))
    graph.islands = np.append(graph.islands, np.where(other.islands == NOWHERE, NOWHERE, other.islands + islands))
    graph.cameras = np.append(graph.cameras, np.array(cameras, np.intp)[other.cameras])
    graph.boxes = np.concatenate([graph.boxes, other.boxes])
    graph.roots |= {island + islands: frame + first for island, frame in other.roots.items()}
    graph.lenses |= {(island + islands, cameras[camera]): lens for (island, camera), lens in other.lenses.items()}
    graph.unevenness |= {island + islands: uneven for island, uneven in other.unevenness.items()}
    _add_comparisons(graph, other, first)
    _add_knowledge(graph, other, first)
    return islands


def _cameras(graph: ViewGraph, other: ViewGraph, renamed: Renamed) -> list[CameraNumber]:
    """The numbers here of another graph's cameras: those of one aircraft with one size are one."""
    known = zip(other.sizes, other.aircraft_of, strict=True)
    return [graph.camera_with(one.width, one.height, renamed.aircraft_of(carrier)) for one, carrier in known]


def _moved(state: GraphFrame, first: int, cameras: Sequence[CameraNumber], renamed: Renamed) -> GraphFrame:
    """A frame by its new number; where it was drawn is of no concern on another map."""
    inliers = MappingProxyType({frame + first: count for frame, count in state.inliers.items()})
    name = renamed.name_of(state.name)
    return replace(state, name=name, camera=cameras[state.camera], drawn=None, inliers=inliers)


def _add_frame(graph: ViewGraph, state: GraphFrame) -> None:
    graph.numbers[state.name] = len(graph.frames)
    graph.frames.append(state)
    graph.retrieval.add(state.features)


def _add_comparisons(graph: ViewGraph, other: ViewGraph, first: int) -> None:
    graph.links |= {(a + first, b + first): link for (a, b), link in other.links.items()}
    graph.compared |= {(a + first, b + first): poses for (a, b), poses in other.compared.items()}
    graph.looked_again |= {(a + first, b + first) for a, b in other.looked_again}
    graph.found_again |= {(a + first, b + first): cells for (a, b), cells in other.found_again.items()}
    graph.bridges += [Bridge(one.frame_a + first, one.frame_b + first, one.registration) for one in other.bridges]


def _add_knowledge(graph: ViewGraph, other: ViewGraph, first: int) -> None:
    """Which frames wait, and what share of true overlaps was confirmed; what was assumed at first counts once."""
    placed = (other.placed() + first).tolist()
    for frame in placed:
        graph.waiting.note_placed(frame)
    for frame in other.waiting:
        graph.waiting.add(frame + first)
    graph.waiting.forget_comparisons()
    graph.moved |= set(placed)
    if other.frames:
        graph.last_placed, graph.placed_before = other.last_placed + first, None
    graph.cells_expected += other.cells_expected - FIRST_CELLS
    graph.cells_confirmed += other.cells_confirmed - FIRST_CELLS * FIRST_SHARE

"""Previews: smaller pictures of shots whose whole pictures came later. Once the whole one has a place it covers its preview.

A preview keeps its place and its links, so that nothing of the map moves; but it is not painted, and no frame of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_mosaic.stitch.arrays import Matrix3x3
from gcs_mosaic.stitch.camera.geometry import canvas_from_frame
from gcs_mosaic.stitch.graph.placement import Covered
from gcs_mosaic.stitch.graph.view_graph import NOWHERE, ViewGraph

SAME_SHAPE = 0.02  # relative difference of the ratios of their sides: a smaller picture of all of it, none that is cut


def covered_by_whole(graph: ViewGraph, preview: str, whole: str, covered: Sequence[Covered]) -> Covered | None:
    """The preview as covered by its whole picture, or by what covers that; None while they do not lie on one island."""
    hidden = next((one for one in covered if one.name == whole), None)
    small, large = (graph.numbers.get(name) for name in (preview, whole if hidden is None else hidden.by))
    if small is None or large is None or small == large:
        return None
    if graph.islands[small] == NOWHERE or graph.islands[small] != graph.islands[large]:
        return None
    by_from_frame = _by_places(graph, small, large) if hidden else _by_sizes(graph, small, large)
    if by_from_frame is None:
        by_from_frame = _by_places(graph, small, large)
    return _covered(preview, graph.frames[large].name, by_from_frame)


def with_previews(covered: Sequence[Covered], new: Sequence[Covered]) -> tuple[list[Covered], list[Covered]]:
    """All that is covered, with some previews more; and what of that is new: these, and what they themselves covered."""
    by = {one.name: one for one in new}
    followed = [_followed(one, by) for one in [*covered, *new]]
    return followed, [
        one for one, before in zip(followed, [*covered, *new], strict=True) if one is not before or one in new
    ]


def size_of_covered(graph: ViewGraph, covered: Covered, new: Sequence[Covered]) -> tuple[int, int]:
    """Width and height of a preview; of what it covered as well, which is as large as it by the rules of covering."""
    names = [covered.name, *(one.name for one in new)]
    features = graph.frames[next(graph.numbers[name] for name in names if name in graph.numbers)].features
    return features.width, features.height


def _followed(one: Covered, by: dict[str, Covered]) -> Covered:
    """Covered by what covers its keyframe, as long as that is one of these previews."""
    while one.by in by:
        above = by[one.by]
        one = _covered(one.name, above.by, np.array(above.by_from_frame) @ np.array(one.by_from_frame))
    return one


def _by_sizes(graph: ViewGraph, small: int, large: int) -> Matrix3x3 | None:
    """Pixels of the whole picture from those of a smaller one of all of it; pixel centres are whole numbers."""
    of_small, of_large = graph.frames[small].features, graph.frames[large].features
    x, y = of_large.width / of_small.width, of_large.height / of_small.height
    if abs(x / y - 1) > SAME_SHAPE:
        return None
    return np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])


def _by_places(graph: ViewGraph, small: int, large: int) -> Matrix3x3:
    """The same by where both lie now."""
    of_small, of_large = (canvas_from_frame(graph.pose_of(one), graph.camera_of(one)) for one in (small, large))
    return np.asarray(np.linalg.inv(of_large) @ of_small)


def _covered(name: str, by: str, by_from_frame: Matrix3x3) -> Covered:
    scaled = by_from_frame / by_from_frame[2, 2]
    return Covered(name, by, tuple(map(tuple, scaled.tolist())))

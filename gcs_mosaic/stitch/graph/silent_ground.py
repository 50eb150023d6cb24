"""Silent ground: waves, foam, a crowd, smoke. What never looks the same again says nothing about where a frame lies.

Of a frame with a bank and a river most of what it shows is not found in the next one, as of two twin houses on different lawns;
nothing in these two pictures tells one from the other. The flight does: lawns of the same look were found again where other
frames overlap, waves were not. So what frames that matched found of each other is kept by how it looks, and cells whose likes
were never found again are no witnesses.
"""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import FloatRows, Indices, Mask
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.frame_cells import CELLS, cell_of, centres, counts
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.homography import area_scale, inside, mapped
from gcs_mosaic.stitch.registration.outcome import Registration

COMPARABLE = 3  # features below which a cell is ignored
KEPT_PAIRS = 300  # the latest ones: some thousand cells
ALIKE = 1.5  # standard deviations of all looks between two of one kind
NEAREST = 48  # cells most alike that are asked; of these
MOST_AGREEING = 2  # may have been found again: at a bank an inlier of the land lies in the next cell
FROM_FRAMES = 3  # frames at least that they are of


def note_found_again(graph: ViewGraph, frame: int, other: int, found: Registration) -> None:
    """Keep which of a frame's cells another one should show by their registration, and which agree."""
    a, b = (graph.frames[one].features for one in (frame, other))
    middles, size = centres(a.width, a.height), np.array([b.width, b.height])
    seen = inside(mapped(found.b_from_a, middles), size) & (area_scale(found.b_from_a, middles) > 0) & full_cells(a)
    kept = {pair: cells for pair, cells in graph.found_again.items() if pair != (frame, other)}
    for oldest in list(kept)[: len(kept) + 1 - KEPT_PAIRS]:
        del kept[oldest]
    agreeing = counts(found.agreeing_a, a.width, a.height) > 0
    graph.found_again = kept | {(frame, other): (np.packbits(seen).tobytes(), np.packbits(agreeing).tobytes())}


def silent_cells(graph: ViewGraph, features: Features, but: int | None) -> Mask:
    """Cells (CELLS,) of a frame that show ground of a kind that this flight has never found again; what frame `but` has
    found is not asked."""
    nothing = np.zeros(CELLS, bool)
    if features.looks is None:
        return nothing
    looks, again, frames = _known(graph, features.looks.shape[1], but)
    if len(looks) < NEAREST:
        return nothing
    spread = np.maximum(looks.std(axis=0), np.float32(1e-6))
    apart = np.linalg.norm((looks / spread)[None] - (features.looks / spread)[:, None], axis=2)
    nearest = np.argpartition(apart, NEAREST - 1, axis=1)[:, :NEAREST]
    are_alike = np.take_along_axis(apart, nearest, axis=1).max(axis=1) <= ALIKE
    of_frames = np.sort(frames[nearest], axis=1)
    from_enough = 1 + (np.diff(of_frames, axis=1) > 0).sum(axis=1) >= FROM_FRAMES
    return np.asarray(are_alike & from_enough & (again[nearest].sum(axis=1) <= MOST_AGREEING))


def _known(graph: ViewGraph, length: int, but: int | None) -> tuple[FloatRows, Mask, Indices]:
    """Looks (n, length) of cells that should have been found again, whether they were (n,), and of which frame (n,)."""
    looks: list[FloatRows] = [np.empty((0, length), np.float32)]
    again, frames = [np.empty(0, bool)], [np.empty(0, np.intp)]
    for (frame, _), (seen, agreeing) in graph.found_again.items():
        of_frame = graph.frames[frame].features.looks
        if frame != but and of_frame is not None and of_frame.shape[1] == length:
            cells = _cells(seen)
            looks.append(of_frame[cells])
            again.append(_cells(agreeing)[cells])
            frames.append(np.full(int(cells.sum()), frame))
    return np.concatenate(looks), np.concatenate(again), np.concatenate(frames)


def telling(graph: ViewGraph, features: Features, but: int | None) -> Mask:
    """Which features (n,) lie on ground that may be found again."""
    return ~silent_cells(graph, features, but)[cell_of(features.points, features.width, features.height)]


def full_cells(features: Features) -> Mask:
    """Cells (CELLS,) of a frame in which there are features."""
    return np.asarray(counts(features.points, features.width, features.height) >= COMPARABLE)


def _cells(bits: bytes) -> Mask:
    return np.unpackbits(np.frombuffer(bits, np.uint8), count=CELLS).astype(bool)

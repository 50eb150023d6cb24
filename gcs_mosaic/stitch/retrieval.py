"""Which of all frames may show the same ground as this one? For when nothing is known of where it lies.

Every frame gives its strongest descriptors to one long list. A query compares its own strongest ones with all of them
in one matrix product; a frame scores by how much nearer its best match is than what other frames offer. The cost grows
in proportion to the number of frames, from a small constant: it is asked only when neighbours by place have failed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.features import Features

PER_FRAME = 200  # strongest descriptors kept of each frame; 10 % common ground still shares several
BACKGROUND_RANK = 8  # a match counts by how far it beats the one of the 8th best frame: ground is seen by several
CHUNK = 64  # frames compared at once; bounds the memory


class RetrievalIndex:
    """Strongest descriptors of many frames, in the order in which they were added."""

    def __init__(self) -> None:
        self._descriptors = np.empty((CHUNK, PER_FRAME, 128), np.uint8)
        self._count = 0

    def add(self, features: Features) -> None:
        """Append a frame; one with fewer features than are wanted repeats them."""
        if self._count == len(self._descriptors):
            self._descriptors = np.concatenate([self._descriptors, np.empty_like(self._descriptors)])
        strongest = features.descriptors[:PER_FRAME]
        fill = np.resize(np.arange(max(len(strongest), 1)), PER_FRAME)
        self._descriptors[self._count] = strongest[fill] if len(strongest) else 0
        self._count += 1

    def likeliest(self, features: Features, among: NDArray[np.intp], count: int) -> list[int]:
        """At most `count` of the frames `among` (m,) most like this one, best first."""
        query = features.descriptors[:PER_FRAME].astype(np.float32)
        if not len(among) or not len(query):
            return []
        nearness = np.concatenate(
            [self._nearness(query, among[i : i + CHUNK]) for i in range(0, len(among), CHUNK)], axis=1
        )
        rank = min(BACKGROUND_RANK, nearness.shape[1])
        background = -np.partition(-nearness, rank - 1, axis=1)[:, rank - 1 : rank]
        score = np.maximum(nearness - background, 0).sum(axis=0) if rank == BACKGROUND_RANK else nearness.sum(axis=0)
        return [int(among[i]) for i in np.argsort(-score, kind="stable")[:count]]

    def _nearness(self, query: NDArray[np.float32], frames: NDArray[np.intp]) -> NDArray[np.float32]:
        """Likeness (q, m) of the best match of each query descriptor in each frame."""
        stored = self._descriptors[frames].reshape(-1, 128).astype(np.float32)
        return np.asarray((query @ stored.T).reshape(len(query), len(frames), PER_FRAME).max(axis=2))

"""Image retrieval: which frames may show the same ground, when a frame's position is unknown.

An inverted file: descriptors are assigned to words (the cells of a k-means vocabulary learnt from the flight itself), and a
query compares its own strongest descriptors exactly, but only with those in the nearest words. A frame is scored by how much
closer its best match is than those of other frames. Sivic and Zisserman, "Video Google", ICCV 2003; exact distances inside the
cells as in Jégou et al., IEEE PAMI 33(1), 2011. The cost of a query still grows linearly with the number of frames, but a query
touches only about PROBES / WORDS of the stored descriptors.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable

import numpy as np

from gcs_mosaic.stitch.arrays import Descriptors, FloatRows, IndexRows, Indices
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.shelf import Shelve, Shelved, at_hand
from gcs_mosaic.stitch.transaction import Kept, Numbers, Snapshot

PER_FRAME = 200  # strongest descriptors stored per frame; 10 % overlap still shares several
QUERY = 100  # strongest descriptors used per query; all 200 find no more
BACKGROUND_RANK = 8  # a match scores by its margin over the 8th best frame's: ground is seen by several frames
WORDS = 256  # cells of the vocabulary
PROBES = 2  # nearest words searched per query descriptor; 4 find no more
LEARN_AT = (64, 512)  # frames at which the vocabulary is learnt (a single word before) and learnt again
SAMPLE = 50  # descriptors per word in the training sample
ROUNDS = 5  # of k-means: the cells need only be about equally full
BATCH = 20_000  # descriptors assigned to words at once; bounds memory
BLOCK = 64 * PER_FRAME  # descriptors kept together, 1.6 MB: a query reads what it needs of each


class RetrievalIndex(Kept):
    """Strongest descriptors of many frames, in order of insertion. `shelve`: where they go, but for the last of them."""

    FIXED = frozenset({"_blocks", "_rows", "_shelve"})  # see `snapshot`

    def __init__(self, shelve: Shelve | None = None) -> None:
        self._shelve = shelve
        self._blocks: list[Descriptors | Shelved] = []  # of BLOCK rows each; the first frame determines their kind
        self._count = 0
        self._words: FloatRows = np.empty((1, 0), np.float32)
        self._rows = [array("q")]  # rows of the descriptors in each word, ascending

    def snapshot(self) -> Snapshot:
        """Stored descriptors are append-only, so their count is enough and nothing large is copied."""
        filed = self._rows, tuple(len(rows) for rows in self._rows)
        return {**super().snapshot(), "_blocks": self._blocks.copy(), "_rows": filed}

    def restore(self, before: Snapshot) -> None:
        """Words that have grown are copied, not truncated in place: that raises while anything still holds a view of them."""
        of_words = zip(*before["_rows"], strict=True)
        rows = [row if len(row) == length else row[:length] for row, length in of_words]
        super().restore({**before, "_rows": rows})

    def saved(self) -> Snapshot:
        """The vocabulary; all else is made anew by `fill`."""
        return {"_words": Numbers.of(self._words)}

    def fill(self, frames: Iterable[Features]) -> None:
        """Add all frames of an index that was saved, in their order, without learning anything again."""
        self._rows = [array("q") for _ in self._words]
        for features in frames:
            self._keep(features)
        learnt = max((count for count in LEARN_AT if count <= self._count), default=0)
        self._file_in_batches(learnt * PER_FRAME)
        for start in range(learnt * PER_FRAME, self._count * PER_FRAME, PER_FRAME):  # as they were filed one by one
            self._file(start, start + PER_FRAME)

    def add(self, features: Features) -> None:
        """Append a frame; one with fewer than PER_FRAME features repeats them."""
        start = self._keep(features)
        if self._count in LEARN_AT:
            self._learn()
        else:
            self._file(start, self._count * PER_FRAME)

    def _keep(self, features: Features) -> int:
        """Append a frame's descriptors; returns the row of the first."""
        strongest = features.descriptors[:PER_FRAME]
        fill = np.resize(np.arange(max(len(strongest), 1)), PER_FRAME)
        if not self._count and not self._words.size:
            self._words = np.zeros((1, strongest.shape[1]), np.float32)
        start = self._count * PER_FRAME
        at = start % BLOCK
        if at == 0:
            self._begin_block(strongest)
        last = self._blocks[-1]
        assert isinstance(last, np.ndarray), "only full blocks are shelved"
        last[at : at + PER_FRAME] = strongest[fill] if len(strongest) else 0
        self._count += 1
        return start

    def _begin_block(self, alike: Descriptors) -> None:
        """Room for more descriptors like these (n, d). What is full changes no more."""
        last = self._blocks[-1] if self._blocks else None
        if self._shelve is not None and isinstance(last, np.ndarray):
            self._blocks[-1] = self._shelve(last)
        self._blocks.append(np.empty((BLOCK, alike.shape[1]), alike.dtype))

    def _stored(self, rows: Indices) -> Descriptors:
        """Descriptors (n, d) of these rows, ascending."""
        ends = np.searchsorted(rows, np.arange(len(self._blocks) + 1) * BLOCK)
        parts = zip(self._blocks, ends[:-1], ends[1:], strict=True)
        chosen = [at_hand(block)[rows[begin:end] % BLOCK] for block, begin, end in parts if begin < end]
        return np.concatenate(chosen)

    def likeliest(self, features: Features, among: Indices, count: int) -> list[int]:
        """The frames of `among` (m,) most similar to this one, best first, at most `count`."""
        query = features.descriptors[:QUERY].astype(np.float32)
        if not len(among) or not len(query):
            return []
        nearness = self._nearness(query, among)
        rank = min(BACKGROUND_RANK, nearness.shape[1])
        background = -np.partition(-nearness, rank - 1, axis=1)[:, rank - 1 : rank]
        score = np.maximum(nearness - background, 0).sum(axis=0) if rank == BACKGROUND_RANK else nearness.sum(axis=0)
        return [int(among[i]) for i in np.argsort(-score, kind="stable")[:count]]

    def _nearness(self, query: FloatRows, among: Indices) -> FloatRows:
        """Similarity (q, m) of the best match of each query descriptor in each frame, as far as the probed words hold one.

        Where they hold none, the similarity to the nearest word's mean is used: a match must exceed it.
        """
        column = np.full(self._count, -1)
        column[among] = np.arange(len(among))
        to_words = query @ self._words.T
        nearest = nearest_words(to_words, self._words, PROBES)
        nearness = np.repeat(np.take_along_axis(to_words, nearest[:, :1], axis=1), len(among), axis=1)
        rows_of = {word: self._rows_among(word, column) for word in np.unique(nearest).tolist()}
        rows_of = {word: rows for word, rows in rows_of.items() if len(rows)}
        if not rows_of:
            return nearness
        wanted = np.sort(np.concatenate(list(rows_of.values())))  # each is in one word
        stored = self._stored(wanted)
        for word, rows in rows_of.items():
            asking = np.flatnonzero((nearest == word).any(axis=1))
            frames, first = np.unique(rows // PER_FRAME, return_index=True)
            likeness = query[asking] @ stored[np.searchsorted(wanted, rows)].astype(np.float32).T
            place = np.ix_(asking, column[frames])
            nearness[place] = np.maximum(nearness[place], np.maximum.reduceat(likeness, first, axis=1))
        return nearness

    def _rows_among(self, word: int, column: Indices) -> Indices:
        """The rows in a word of those frames that have a column, ascending."""
        rows = np.array(self._rows[word])  # a copy: an array that is being viewed cannot grow
        return np.asarray(rows[column[rows // PER_FRAME] >= 0])

    def _learn(self) -> None:
        """Learn a vocabulary from everything stored and refile it."""
        seen = self._count * PER_FRAME
        words = learnt_words(self._stored(np.linspace(0, seen - 1, WORDS * SAMPLE).astype(int)))
        self._words, self._rows = words, [array("q") for _ in words]
        self._file_in_batches(seen)

    def _file_in_batches(self, stop: int) -> None:
        for start in range(0, stop, BATCH):
            self._file(start, min(start + BATCH, stop))

    def _file(self, start: int, stop: int) -> None:
        """Assign descriptors to words."""
        stored = self._stored(np.arange(start, stop)).astype(np.float32)
        for row, word in enumerate(nearest_words(stored @ self._words.T, self._words, 1)[:, 0], start):
            self._rows[word].append(row)


def learnt_words(descriptors: Descriptors) -> FloatRows:
    """A vocabulary (n / SAMPLE, d) from a sample of descriptors (n, d): Lloyd's k-means."""
    sample = descriptors.astype(np.float32)
    words = sample[::SAMPLE].copy()
    for _ in range(ROUNDS):
        word = nearest_words(sample @ words.T, words, 1)[:, 0]
        for filled in np.unique(word):
            words[filled] = sample[word == filled].mean(axis=0)
    return words


def nearest_words(likeness: FloatRows, words: FloatRows, count: int) -> IndexRows:
    """Nearest words (n, count), nearest first, from the dot products (n, w) with them."""
    closeness = likeness - (words * words).sum(axis=1) / 2
    if count == 1:
        return np.asarray(closeness.argmax(axis=1)[:, None])
    return np.asarray(np.argsort(-closeness, axis=1, kind="stable")[:, :count])

"""Stage 4: for each frame the frames that look most like it, by the measure of `stitch.features.retrieval`.

A vocabulary that grows with the archive, so that a word holds a bounded part of it; an inverted file for each block of frames;
and tasks that ask all blocks for some frames. Only the nearest eight frames of each descriptor count, so what is found in the
blocks is merged without a table of all frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame, strongest_of
from gcs_mosaic.archive.kinds import FrameKind
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.stitch.arrays import Descriptors, FloatRows, Indices
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.features.retrieval import (
    BACKGROUND_RANK,
    PER_FRAME,
    PROBES,
    QUERY,
    SAMPLE,
    WORDS,
    learnt_words,
    nearest_words,
)

ALIKE = 14  # frames found for each one
IN_ORDER = 2  # frames before it that it is compared with besides: neighbours in a flight
BLOCK = 1024  # frames of one inverted file: 27 MB
ASKED_TOGETHER = 128  # frames of one task
FEWEST = 64  # frames below which there is but one word, so that all are compared exactly
FRAMES_PER_WORD, MOST_WORDS = 32, 16384

Described = tuple[str, DeadBorder]  # a frame's features
Found = tuple[FloatRows, Indices]  # of each descriptor of a query the best similarities (q, r), and the frames (q, r)


def pairs_of(engine: Engine, frames: Sequence[SeenFrame], kinds: Sequence[FrameKind]) -> list[tuple[int, int]]:
    """Pairs of frames, by number, that are worth comparing; at most ALIKE + IN_ORDER for each frame."""
    described = [(one.key, kind.dead_as_taken) for one, kind in zip(frames, kinds, strict=True)]
    pairs = {(earlier, later) for later in range(len(frames)) for earlier in range(max(0, later - IN_ORDER), later)}
    for number, others in enumerate(_alike(engine, frames, described)):
        pairs |= {(min(number, other), max(number, other)) for other in others}
    return sorted(pairs)


def _alike(engine: Engine, frames: Sequence[SeenFrame], described: Sequence[Described]) -> list[list[int]]:
    """The most similar frames of each one, best first. Frames of different depths of descriptors never meet."""
    if len(frames) < 2:
        return [[] for _ in frames]
    words = task(vocabulary, tuple(_sample(described)), _words_for(len(frames)))
    engine.made("vocabulary", [words])
    blocks = [tuple(described[at : at + BLOCK]) for at in range(0, len(described), BLOCK)]
    files = [task(inverted, engine.listed(block), words.key) for block in blocks]
    engine.made("inverted files", files)
    keys = engine.listed([one.key for one in files])
    starts = range(0, len(frames), ASKED_TOGETHER)
    asked = [task(alike, words.key, keys, at, min(at + ASKED_TOGETHER, len(frames))) for at in starts]
    return [found for some in engine.made("retrieval", asked) for found in some]


def _words_for(frames: int) -> int:
    if frames < FEWEST:
        return 1
    return min(max(WORDS, frames // FRAMES_PER_WORD), MOST_WORDS)


def _sample(described: Sequence[Described]) -> list[Described]:
    """Frames spread over the archive, enough for the vocabulary."""
    count = min(len(described), -(-_words_for(len(described)) * SAMPLE // PER_FRAME))
    return [described[at] for at in np.linspace(0, len(described) - 1, count).astype(int).tolist()]


def vocabulary(artefacts: Artefacts, sample: tuple[Described, ...], words: int) -> Parts:
    """So many words, learnt from these frames; a single one says nothing and leaves nothing out."""
    known = np.concatenate([strongest_of(artefacts, *one) for one in sample])
    if words == 1:
        return {"summary": 1, "words": np.zeros((1, known.shape[1]), np.float32)}
    return {"summary": words, "words": learnt_words(known[np.linspace(0, len(known) - 1, words * SAMPLE).astype(int)])}


@dataclass(frozen=True, slots=True)
class InvertedFile:
    """The descriptors (n * PER_FRAME, d) of a block of frames, and of each word the rows that it holds: `rows` from one end to
    the next."""

    descriptors: Descriptors
    rows: Indices
    ends: Indices  # (words + 1,)

    def rows_of(self, word: int) -> Indices:
        return self.rows[self.ends[word] : self.ends[word + 1]]


def inverted(artefacts: Artefacts, block: str, words: str) -> Parts:
    """The inverted file of a block of frames."""
    frames, known = artefacts.part(block, "list"), artefacts.part(words, "words")
    descriptors = np.concatenate([strongest_of(artefacts, *one) for one in frames])
    word = np.concatenate(
        [
            nearest_words(some.astype(np.float32) @ known.T, known, 1)[:, 0]
            for some in np.array_split(descriptors, len(frames))
        ]
    )
    rows = np.argsort(word, kind="stable")
    ends = np.searchsorted(word[rows], np.arange(len(known) + 1))
    return {"summary": len(frames), "file": InvertedFile(descriptors, rows, ends)}


def alike(artefacts: Artefacts, words: str, files: str, first: int, stop: int) -> Parts:
    """For each frame of a stretch the ALIKE most similar frames, best first."""
    keys, known = artefacts.part(files, "list"), artefacts.part(words, "words")
    queries = {number: _descriptors_of(artefacts, keys, number) for number in range(first, stop)}
    best: dict[int, Found | None] = dict.fromkeys(queries)
    for block, key in enumerate(keys):
        file = _file(artefacts, key)
        for number, query in queries.items():
            best[number] = merged(best[number], found_in(file, known, query, number - block * BLOCK, block * BLOCK))
    return {"summary": [ranked(found) for found in best.values()]}


def _descriptors_of(artefacts: Artefacts, keys: Sequence[str], number: int) -> FloatRows:
    at = number % BLOCK * PER_FRAME
    return _file(artefacts, keys[number // BLOCK]).descriptors[at : at + QUERY].astype(np.float32)


@lru_cache(4)
def _file(artefacts: Artefacts, key: str) -> InvertedFile:
    found: InvertedFile = artefacts.part(key, "file")
    return found


def found_in(file: InvertedFile, words: FloatRows, query: FloatRows, own: int, offset: int) -> Found:
    """The nearest frames of a block to each descriptor of a query (q, d), as far as the probed words hold any; elsewhere the
    similarity to the nearest word counts. `own`: the frame itself, left out; frames are counted from `offset`."""
    frames = len(file.descriptors) // PER_FRAME
    to_words = query @ words.T
    nearest = nearest_words(to_words, words, PROBES)
    nearness = np.repeat(np.take_along_axis(to_words, nearest[:, :1], axis=1), frames, axis=1)
    for word in np.unique(nearest):
        rows = file.rows_of(word)
        if not len(rows):
            continue
        asking = np.flatnonzero((nearest == word).any(axis=1))
        seen, first = np.unique(rows // PER_FRAME, return_index=True)
        likeness = query[asking] @ file.descriptors[rows].astype(np.float32).T
        place = np.ix_(asking, seen)
        nearness[place] = np.maximum(nearness[place], np.maximum.reduceat(likeness, first, axis=1))
    if 0 <= own < frames:
        nearness[:, own] = -np.inf
    best = np.argsort(-nearness, axis=1, kind="stable")[:, :BACKGROUND_RANK]
    return np.take_along_axis(nearness, best, axis=1), best + offset


def merged(one: Found | None, other: Found) -> Found:
    """The best of both."""
    if one is None:
        return other
    nearness, frames = (np.concatenate([a, b], axis=1) for a, b in zip(one, other, strict=True))
    best = np.argsort(-nearness, axis=1, kind="stable")[:, :BACKGROUND_RANK]
    return np.take_along_axis(nearness, best, axis=1), np.take_along_axis(frames, best, axis=1)


def ranked(found: Found | None) -> list[int]:
    """Frames by how much nearer they are than the eighth nearest, over all descriptors; best first."""
    if found is None:
        return []
    nearness, frames = found
    known = np.isfinite(nearness)
    full = nearness.shape[1] == BACKGROUND_RANK and known.all()
    margin = nearness - nearness[:, -1:] if full else np.where(known, nearness, 0.0)
    score = np.bincount(frames[known], margin[known].astype(np.float64))
    order = np.argsort(-score, kind="stable")[:ALIKE]
    return [int(frame) for frame in order if score[frame] > 0]

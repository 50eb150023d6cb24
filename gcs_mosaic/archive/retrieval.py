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
from gcs_mosaic.archive.frame_kinds import FrameKind
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.stitch.arrays import Descriptors, FloatRows, IndexRows, Indices, Vector32
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
ASKED_TOGETHER = 512  # frames of one task: what it costs to open a word in each block is shared among them
MOST_AT_ONCE = 2**22  # similarities: bounds memory
FEWEST = 64  # frames below which there is but one word, so that all are compared exactly
FRAMES_PER_WORD, MOST_WORDS = 32, 16384

Described = tuple[str, DeadBorder]  # a frame's features


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

    @property
    def frames(self) -> int:
        return len(self.descriptors) // PER_FRAME

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
    query = np.concatenate([_descriptors_of(artefacts, keys, number) for number in range(first, stop)])
    asked = Asked.of(query, known, first)
    frames = 0
    for key in keys:
        file = _file(artefacts, key)
        asked.look_in(file, frames)
        frames += file.frames
    return {"summary": asked.ranked(frames)}


def _descriptors_of(artefacts: Artefacts, keys: Sequence[str], number: int) -> FloatRows:
    at = number % BLOCK * PER_FRAME
    return _file(artefacts, keys[number // BLOCK]).descriptors[at : at + QUERY].astype(np.float32)


@lru_cache(4)
def _file(artefacts: Artefacts, key: str) -> InvertedFile:
    found: InvertedFile = artefacts.part(key, "file")
    return found


@dataclass(frozen=True, slots=True)
class Asked:
    """The descriptors (n, d) of some frames, each asked of its PROBES nearest words: (n * PROBES) probes, word by word.

    Of each probe the nearest frames so far and their similarities, (n * PROBES, BACKGROUND_RANK): a table of all frames would
    make the work grow with the square of their number.
    """

    descriptors: FloatRows
    own: Indices  # (n,) the frame that each is of, which is left out
    least: Vector32  # (n,) similarity to the nearest word, which counts where the probed words hold nothing better
    probes: Indices  # (n * PROBES,) numbers of probes by word; n times PROBES, and which of them
    ends: Indices  # (words + 1,)
    nearness: FloatRows
    frames: IndexRows

    @classmethod
    def of(cls, query: FloatRows, words: FloatRows, first: int) -> Asked:
        """QUERY descriptors of each frame, which are numbered from `first`."""
        to_words = query @ words.T
        nearest = nearest_words(to_words, words, PROBES)
        count = nearest.shape[1]
        order = np.argsort(nearest, axis=None, kind="stable")
        return cls(
            descriptors=query,
            own=first + np.arange(len(query)) // QUERY,
            least=np.take_along_axis(to_words, nearest[:, :1], axis=1)[:, 0],
            probes=order,
            ends=np.searchsorted(nearest.ravel()[order], np.arange(len(words) + 1)),
            nearness=np.full((len(query) * count, BACKGROUND_RANK), -np.inf, np.float32),
            frames=np.full((len(query) * count, BACKGROUND_RANK), -1),
        )

    def look_in(self, file: InvertedFile, offset: int) -> None:
        """Ask a block of frames, whose first has the number `offset`."""
        for word in np.flatnonzero(np.diff(self.ends) * np.diff(file.ends)).tolist():
            probes, rows = self.probes[self.ends[word] : self.ends[word + 1]], file.rows_of(word)
            known = file.descriptors[rows].astype(np.float32).T
            seen, first = np.unique(rows // PER_FRAME, return_index=True)
            together = max(1, MOST_AT_ONCE // len(rows))
            for at in range(0, len(probes), together):
                self._ask(probes[at : at + together], known, first, seen + offset)

    def _ask(self, probes: Indices, known: FloatRows, first: Indices, seen: Indices) -> None:
        """Compare probes with the descriptors (d, m) that a word knows, those of each frame seen from its `first` on."""
        asking = probes // (len(self.nearness) // len(self.descriptors))
        likeness = np.maximum.reduceat(self.descriptors[asking] @ known, first, axis=1)
        likeness[self.own[asking][:, None] == seen] = -np.inf
        self.nearness[probes], self.frames[probes] = nearest_of(
            np.concatenate([self.nearness[probes], likeness], axis=1),
            np.concatenate([self.frames[probes], np.broadcast_to(seen, likeness.shape)], axis=1),
        )

    def ranked(self, frames: int) -> list[list[int]]:
        """Of each frame the others by how much nearer they are than the eighth nearest, over all descriptors; best first."""
        count = len(self.descriptors)
        nearness, numbers = without_twins(self.nearness.reshape(count, -1), self.frames.reshape(count, -1))
        nearness, numbers = nearest_of(nearness, numbers)
        nearness = np.maximum(nearness, self.least[:, None])
        background = nearness.min(axis=1, keepdims=True) if frames > BACKGROUND_RANK else 0.0
        margin = np.where(numbers < 0, 0.0, nearness - background)
        return [_best(margin[at : at + QUERY], numbers[at : at + QUERY]) for at in range(0, len(margin), QUERY)]


def nearest_of(nearness: FloatRows, frames: IndexRows) -> tuple[FloatRows, IndexRows]:
    """The BACKGROUND_RANK nearest in each row (n, m) of similarities and frames, in no order."""
    best = np.argpartition(-nearness, BACKGROUND_RANK - 1, axis=1)[:, :BACKGROUND_RANK]
    return np.take_along_axis(nearness, best, axis=1), np.take_along_axis(frames, best, axis=1)


def without_twins(nearness: FloatRows, frames: IndexRows) -> tuple[FloatRows, IndexRows]:
    """The same, with each frame once in each row: where two words know it, by the nearer one."""
    order = np.lexsort((-nearness, frames), axis=1)
    nearness, frames = np.take_along_axis(nearness, order, axis=1), np.take_along_axis(frames, order, axis=1)
    twin = np.zeros(frames.shape, bool)
    twin[:, 1:] = frames[:, 1:] == frames[:, :-1]
    return np.where(twin, np.float32(-np.inf), nearness), np.where(twin, -1, frames)


def _best(margin: FloatRows, frames: IndexRows) -> list[int]:
    known = frames >= 0
    score = dict.fromkeys(frames[known].tolist(), 0.0)
    for frame, more in zip(frames[known].tolist(), margin[known].tolist(), strict=True):
        score[frame] += more
    order = sorted((frame for frame, worth in score.items() if worth > 0), key=lambda frame: (-score[frame], frame))
    return order[:ALIKE]

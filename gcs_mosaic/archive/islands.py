"""Stage 7: the islands of all frames, joined as far as pairs of frames prove it.

Serial as the last of the joining; the islands' joint adjustments are left to the next stage.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame
from gcs_mosaic.archive.frame_kinds import FrameKind
from gcs_mosaic.archive.look_up import NumberedFrame, PairBook
from gcs_mosaic.archive.pairs import KnownPairs, Pair
from gcs_mosaic.archive.stretches import placed_stretches, together
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.stitch.graph.placement import Covered, Placement, Rejection
from gcs_mosaic.stitch.mosaic import StitchSettings

OF_A_FLIGHT = 1000  # frames, for which the settings are
CHUNK = 64  # frames of an island whose ground is found together


@dataclass(frozen=True, slots=True)
class Assembled:
    """What became of the frames, and where the adjustments that are to follow lie: `tasks` are the islands' numbers, parts of
    the artefact `key`, which has `ChunkMatches` too. `islands`: by number, the island that each was merged into."""

    key: str
    islands: tuple[int | None, ...]
    tasks: tuple[tuple[int, int], ...]  # an island and its number of frames
    placed: dict[str, int]  # the island of each placed frame
    covered: tuple[Covered, ...]
    rejected: tuple[Rejection, ...]


@dataclass(frozen=True, slots=True)
class ChunkMatches:
    """Some frames of an island that follow one another, and where the registrations of the pairs lie that link them with any.
    `around`: numbers of the chunks in which those other frames are, this one's too."""

    frames: tuple[NumberedFrame, ...]
    links: tuple[tuple[Pair, str], ...]
    around: tuple[int, ...]


def assembled(
    engine: Engine, frames: Sequence[NumberedFrame], known: KnownPairs, settings: StitchSettings, stretch: int
) -> Assembled:
    """All frames, placed. `stretch`: how many are placed by one task."""
    settings = stricter(settings, len(frames))
    left = placed_stretches(engine, frames, known, settings, stretch)
    one = task(islands, left.parts, left.pairs, settings)
    merged, tasks, placed, covered, rejected = engine.made("islands", [one])[0]
    return Assembled(one.key, merged, tasks, placed, covered, rejected)


def stricter(settings: StitchSettings, frames: int) -> StitchSettings:
    """The evidence that joins two islands, for so many frames: look-alikes are as many times more frequent than in a flight as
    there are more frames, and in the whole no more wrong joins are allowed. In steps, so that stretches are kept where a few
    frames are added."""
    more = max(0.0, round(math.log10(max(frames, 1) / OF_A_FLIGHT), 1))
    strict = replace(settings.islands, least_evidence=settings.islands.least_evidence + more)
    return replace(settings, islands=strict)


def numbered_frames(frames: Sequence[SeenFrame], kinds: Sequence[FrameKind]) -> list[NumberedFrame]:
    """The frames in their order. Another folder may be another aircraft's, or another year's, whose lens is not the same."""
    folders: dict[tuple[str, str], int] = {}
    return [
        NumberedFrame(
            number,
            one.frame.name,
            one.key,
            kind.dead_as_taken,
            folders.setdefault(one.frame.file.folder, len(folders)),
        )
        for number, (one, kind) in enumerate(zip(frames, kinds, strict=True))
    ]


def islands(artefacts: Artefacts, parts: tuple[str, ...], pairs: str, settings: StitchSettings) -> Parts:
    """Join what is left to join, and see what there is."""
    found = together(artefacts, parts, pairs, settings)
    found.book.check()
    mosaic = found.mosaic
    tasks = {task.island: replace(task, settings=settings.adjustment) for task in mosaic.adjustments()}
    of_islands: dict[int, list[Placement]] = {}
    for placement in mosaic.placements():
        of_islands.setdefault(placement.island, []).append(placement)
    summary = (
        tuple(island.merged_into for island in mosaic.islands),
        tuple((number, len(task.members)) for number, task in tasks.items()),
        {placement.name: island for island, some in of_islands.items() for placement in some},
        tuple(mosaic.covered()),
        (*found.rejected, *mosaic.finish()),
    )
    placements = {f"placements {number}": some for number, some in of_islands.items()}
    adjustments = {f"adjustment {number}": task for number, task in tasks.items()}
    matches = {
        f"matches {island} {chunk}": one
        for island in tasks
        for chunk, one in enumerate(chunk_matches(found.book, of_islands[island]))
    }
    return {"summary": summary, **placements, **adjustments, **matches}


def chunk_matches(book: PairBook, placements: Sequence[Placement]) -> Iterator[ChunkMatches]:
    """What links each chunk of an island."""
    chunk_of = {placement.name: row // CHUNK for row, placement in enumerate(placements)}
    for at in range(0, len(placements), CHUNK):
        some = placements[at : at + CHUNK]
        # Not where frames were registered only when their place was known, to test a join: that is kept nowhere.
        links = {
            book.key(one.name, other) for one in some for other in one.neighbours if book.registered(one.name, other)
        }
        around = {chunk_of[name] for one in some for name in (one.name, *one.neighbours)}
        yield ChunkMatches(tuple(book.frame(one.name) for one in some), tuple(sorted(links)), tuple(sorted(around)))

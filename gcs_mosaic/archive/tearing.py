"""Stage 9: how far apart the finished map places what was held out of all that placed it, an island's figure of quality."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from gcs_mosaic.archive.adjustment import PlacedChunk
from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import places_of
from gcs_mosaic.archive.islands import ChunkMatches
from gcs_mosaic.archive.look_up import NumberedFrame
from gcs_mosaic.archive.pairs import Pair, StoredRegistration
from gcs_mosaic.archive.tasks import Made, Parts, task
from gcs_mosaic.stitch.camera.relief import ReliefSettings
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.graph.tearing import FrameInPlace, HeldOut, HeldOutMatches, held_out_error, some_of
from gcs_mosaic.stitch.registration.held_out import held_out, held_out_doubtful


def measured(
    engine: Engine, chunks: Sequence[PlacedChunk], placed: Sequence[str], settings: ReliefSettings
) -> dict[int, HeldOut]:
    """The figure of each island that has one: failing to measure a map does not end it. `placed`: the artefacts that hold the
    chunks' placements in the end."""
    of_islands: dict[tuple[int, str], list[str]] = {}
    for chunk, key in zip(chunks, placed, strict=True):
        if chunk.matches is not None:
            of_islands.setdefault((chunk.island, chunk.matches), []).append(key)
    tasks = [
        task(torn_apart, island, matches, engine.listed(keys), settings)
        for (island, matches), keys in of_islands.items()
    ]
    outcomes = engine.run("held-out error", tasks)
    found = (
        (island, one.summary) for (island, _), one in zip(of_islands, outcomes, strict=True) if isinstance(one, Made)
    )
    return {island: HeldOut(*figures) for island, figures in found if figures is not None}


def torn_apart(artefacts: Artefacts, island: int, matches: str, placed: str, settings: ReliefSettings) -> Parts:
    """The held-out error of an island, as median, 95th percentile and number of matches; None with too few of these."""
    keys: Sequence[str] = artefacts.part(placed, "list")
    chunks = [artefacts.part(matches, f"matches {island} {number}") for number in range(len(keys))]
    placements = [one for key in keys for one in artefacts.part(key, "placements")]
    pairs = some_of(sorted({pair: key for chunk in chunks for pair, key in chunk.links}.items()))
    frames = _in_place(artefacts, chunks, placements, {number for pair, _ in pairs for number in pair})
    views = [(one.pose, one.camera) for one in placements]
    found = held_out_error(list(_held_out(artefacts, pairs, _numbered(chunks))), frames, views, settings)
    return {"summary": None if found is None else (found.median_px, found.p95_px, found.matches)}


def _numbered(chunks: Iterable[ChunkMatches]) -> dict[int, NumberedFrame]:
    return {frame.number: frame for chunk in chunks for frame in chunk.frames}


def _in_place(
    artefacts: Artefacts, chunks: Sequence[ChunkMatches], placements: Sequence[Placement], wanted: set[int]
) -> dict[int, FrameInPlace]:
    """The wanted frames by number."""
    both = zip(_numbered(chunks).values(), placements, strict=True)
    return {
        frame.number: FrameInPlace(places_of(artefacts, frame.key, frame.dead), one.pose, one.camera, one.relief)
        for frame, one in both
        if frame.number in wanted
    }


def _held_out(
    artefacts: Artefacts, pairs: Iterable[tuple[Pair, str]], frames: Mapping[int, NumberedFrame]
) -> Iterator[HeldOutMatches]:
    for pair, key in pairs:
        found: StoredRegistration = artefacts.part(key, "found")[tuple(frames[number].key for number in pair)]
        doubtful = held_out_doubtful(found.tentative, found.features)
        yield HeldOutMatches(pair, found.features[held_out(found.features)], doubtful)

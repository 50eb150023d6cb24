"""Stage 8: the relief displacement of each frame, from the ground that it sees.

What frames of an island see of one ground is found for some frames at a time, from their matches and those of the frames linked
with them. Tracks of features that go further are cut off there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs_mosaic.archive.adjustment import PlacedChunk
from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import places_of
from gcs_mosaic.archive.islands import ChunkMatches
from gcs_mosaic.archive.look_up import NumberedFrame
from gcs_mosaic.archive.pairs import Pair, StoredRegistration
from gcs_mosaic.archive.tasks import Parts, task
from gcs_mosaic.stitch.arrays import FeaturePairsNx2
from gcs_mosaic.stitch.bundle.matched_points import MatchedPoints, sightings
from gcs_mosaic.stitch.bundle.relief import displacements
from gcs_mosaic.stitch.camera.relief import ReliefSettings
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.registration.held_out import held_out

TOGETHER = 1  # chunks of a batch: seconds' work each


def with_relief(engine: Engine, chunks: Sequence[PlacedChunk], settings: ReliefSettings) -> list[tuple[str, list[str]]]:
    """The artefacts that hold the placements of each chunk, with the names of its frames."""
    tasks = [task(relief, chunk.key, chunk.part, chunk.island, chunk.matches, settings) for chunk in chunks]
    names = engine.made("relief", tasks, TOGETHER)
    return [(one.key, some) for one, some in zip(tasks, names, strict=True)]


def relief(
    artefacts: Artefacts, key: str, part: int, island: int, matches: str | None, settings: ReliefSettings
) -> Parts:
    """The placements of a chunk."""
    placements: list[Placement] = artefacts.part(key, f"placements {part}")
    if matches is not None and settings.cells:
        placements = _with_relief(artefacts, placements, Surroundings(artefacts, key, part, island, matches), settings)
    return {"summary": [one.name for one in placements], "placements": placements}


def _with_relief(
    artefacts: Artefacts, own: Sequence[Placement], surroundings: Surroundings, settings: ReliefSettings
) -> list[Placement]:
    """`own` with their reliefs, from all frames around."""
    matched, placements = surroundings.matched(artefacts), surroundings.placements
    views = [(one.pose, one.camera) for one in placements]
    rows = {one.name: row for row, one in enumerate(placements)}
    found = displacements(sightings(matched), views, settings, of=[rows[one.name] for one in own])
    return [replace(one, relief=sheet) for one, sheet in zip(own, found, strict=True)]


class Surroundings:
    """The frames of a chunk and all that are linked with any of them, and the links among all of these."""

    def __init__(self, artefacts: Artefacts, key: str, part: int, island: int, matches: str) -> None:
        own: ChunkMatches = artefacts.part(matches, f"matches {island} {part}")
        chunks: list[ChunkMatches] = [artefacts.part(matches, f"matches {island} {chunk}") for chunk in own.around]
        inside = {frame.number for frame in own.frames} | {number for pair, _ in own.links for number in pair}
        numbered = [frame for chunk in chunks for frame in chunk.frames]
        placed = [one for chunk in own.around for one in artefacts.part(key, f"placements {chunk}")]
        both = [both for both in zip(numbered, placed, strict=True) if both[0].number in inside]
        self.frames = [frame for frame, _ in both]
        self.placements = [placement for _, placement in both]
        links = {pair: of_pair for chunk in chunks for pair, of_pair in chunk.links if inside.issuperset(pair)}
        self._links: Mapping[Pair, str] = dict(sorted(links.items()))

    def matched(self, artefacts: Artefacts) -> MatchedPoints:
        """The matches of all links, but for those held out."""
        rows, by_number = {one.number: row for row, one in enumerate(self.frames)}, {f.number: f for f in self.frames}
        groups = {key: artefacts.part(key, "found") for key in sorted(set(self._links.values()))}
        matches = [_matches(groups[key], by_number, pair) for pair, key in self._links.items()]
        features = [places_of(artefacts, one.key, one.dead) for one in self.frames]
        return MatchedPoints(
            pairs=np.array([[rows[number] for number in pair] for pair in self._links], np.intp),
            counts=np.array([len(some) for some in matches], np.intp),
            features=np.concatenate(matches),
            points=np.concatenate([one.points for one in features]),
            lengths=np.array([len(one) for one in features], np.intp),
            scales=np.array([one.scale for one in features]),
        )


def _matches(
    found: Mapping[tuple[str, ...], StoredRegistration], frames: Mapping[int, NumberedFrame], pair: Pair
) -> FeaturePairsNx2:
    features = found[tuple(frames[number].key for number in pair)].features
    return features[~held_out(features)]

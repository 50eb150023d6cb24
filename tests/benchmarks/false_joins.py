"""Whether an archive joins what does not belong together: `python -m tests.benchmarks.false_joins FRAMES...`.

An archive of so many frames (`look_alikes`: strangers, repeated structures, second visits a year later) is reprocessed up to the
adjustment of its islands, with 500 features a frame, and compared with the truth. Says how many pairs were compared and
registered, which of them falsely; which islands hold frames of two lands, or frames laid elsewhere than they were taken after one
similarity for each island; which second visits were joined with the first; and what each stage has cost. Pictures are rendered
into a folder of `--folder` (the user's cache) once.

`--live LANDS`: so many of the lands that were visited twice are flown for the live program too, ten frames and ten.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console

from gcs_mosaic.archive.adjustment import adjusted_islands
from gcs_mosaic.archive.arrivals import arrivals_of
from gcs_mosaic.archive.cluster import workers_at
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame, features_of, places_of
from gcs_mosaic.archive.frame_kinds import FrameKind, kinds_of
from gcs_mosaic.archive.islands import assembled, numbered_frames
from gcs_mosaic.archive.pairs import KnownPairs, StoredRegistration, registered
from gcs_mosaic.archive.progress import Lines, StageCost
from gcs_mosaic.archive.retrieval import pairs_of
from gcs_mosaic.archive.sources import sources_of
from gcs_mosaic.archive.stretches import STRETCH
from gcs_mosaic.config.tree import Config
from gcs_mosaic.stitch.features.extraction import extract
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import Mosaic
from tests.benchmarks.joins import RIGHT, FoundIsland, Pair, Return, found_islands, judged, returns
from tests.benchmarks.look_alikes import Taken, Visit, archive_in, name_of, number_of, taken, visits

FEATURES = 500  # of a frame
FLOWN = 10  # frames of either visit that are flown for the live program


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of an archive; frames are called by their numbers. kinds: what each registration is."""

    truth: list[Taken]
    compared: list[Pair]
    kinds: dict[Pair, str]
    placements: list[Placement]
    costs: list[StageCost]

    @property
    def islands(self) -> list[FoundIsland]:
        return found_islands(self.placements, self.truth, self.kinds)

    @property
    def returns(self) -> list[Return]:
        return returns(self.placements, self.truth, self.compared, self.kinds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", nargs="+", type=int)
    parser.add_argument("--folder", type=Path, default=Path.home() / ".cache" / "gcs-mosaic-look-alikes")
    parser.add_argument("--barracks", action="store_true", help="also blocks that are known to be confused")
    parser.add_argument("--live", type=int, default=0, metavar="LANDS")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    for count in asked.frames:
        flights = visits(count, barracks=asked.barracks)
        name = f"{count}-barracks" if asked.barracks else f"{count}"
        folder = archive_in(asked.folder / name, flights, asked.workers)
        found = reprocessed(folder, taken(flights), asked.workers)
        for line in [*told(found), *told_returns(found.returns), *told_costs(found), *live(found, folder, asked.live)]:
            print(line, flush=True)


def config() -> Config:
    """As ever, with fewer features."""
    given = Config()
    return replace(given, stitch=replace(given.stitch, features=replace(given.stitch.features, count=FEATURES)))


def reprocessed(folder: Path, truth: list[Taken], workers: int) -> Outcome:
    """All stages up to the adjustment of islands, without artefacts of before."""
    lines, settings = Lines(Console(stderr=True)), config()
    with tempfile.TemporaryDirectory(prefix="gcs-mosaic-benchmark-") as store, workers_at(None, workers) as client:
        engine = Engine(client, store, lines)
        arrivals = arrivals_of(engine, sources_of([str(folder)]).files, settings.frames)
        seen, _ = features_of(engine, arrivals.frames, settings)
        kinds = kinds_of(engine, seen, settings)
        pairs = pairs_of(engine, seen, kinds)
        known = registered(engine, seen, kinds, pairs, settings.stitch.registration)
        chunks = adjusted_islands(
            engine, assembled(engine, numbered_frames(seen, kinds), known, settings.stitch, STRETCH)
        )
        placements = [one for chunk in chunks for one in engine.part(chunk.key, f"placements {chunk.part}")]
        numbers = [number_of(one.frame.name) for one in seen]
        compared = [(numbers[a], numbers[b]) for a, b in pairs]
        return Outcome(truth, compared, dict(_judged(engine, seen, kinds, known, truth)), placements, lines.costs)


def _judged(
    engine: Engine, seen: Sequence[SeenFrame], kinds: Sequence[FrameKind], known: KnownPairs, truth: Sequence[Taken]
) -> Iterator[tuple[Pair, str]]:
    """What each registration is."""
    features = [places_of(engine.artefacts, one.key, kind.dead_as_taken) for one, kind in zip(seen, kinds, strict=True)]
    groups: dict[str, list[Pair]] = {}
    for pair, (key, is_one) in known.found.items():
        groups.setdefault(key, []).extend([pair] if is_one else [])
    for key, pairs in groups.items():
        found: dict[tuple[str, str], StoredRegistration] = engine.part(key, "found") if pairs else {}
        for a, b in pairs:
            whole = found[seen[a].key, seen[b].key].whole(features[a], features[b])
            one, other = number_of(seen[a].frame.name), number_of(seen[b].frame.name)
            yield (one, other), judged(truth[one], truth[other], whole.pixels_a, whole.pixels_b)


def told(found: Outcome) -> Iterator[str]:
    """Pairs, registrations and islands."""
    degree = Counter(frame for pair in found.compared for frame in pair)
    false = Counter(kind for kind in found.kinds.values() if kind != RIGHT)
    frames, islands = len(found.truth), found.islands
    yield f"{frames} frames of {len({one.land for one in found.truth})} lands"
    yield f"  pairs: {len(found.compared) / frames:.1f} a frame; a frame is in {max(degree.values())} at most"
    yield f"  registered: {len(found.kinds)}; false: {_listed(false)}"
    yield f"  placed: {len(found.placements)} on {len(islands)} islands"
    linked = sum(len(one.false_links) for one in islands)
    yield f"  false joins: {sum(one.strangers > 0 for one in islands)} islands of two lands or more, "
    yield f"    {sum(len(one.far) for one in islands)} frames laid far off on {sum(bool(one.far) for one in islands)} islands"
    yield f"    by {linked} false registrations that became links"
    for one in islands:
        if one.is_false:
            yield f"    {told_island(one, found)}"


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {what}" for what, count in counts.most_common()) or "none"


def told_island(one: FoundIsland, found: Outcome) -> str:
    """An island that is not right."""
    first = {truth.land: truth.visit for truth in reversed(found.truth)}
    lands = ", ".join(f"{count} of {first[land].ground} {land}" for land, count in one.lands.most_common())
    links = Counter(found.kinds[pair] for pair in one.false_links)
    return f"{lands}; {len(one.far)} far off; false links: {_listed(links)}"


def told_returns(all_of_them: Sequence[Return]) -> Iterator[str]:
    """Second visits by how different they are."""
    yield f"  second visits joined: {sum(one.joined > 0 for one in all_of_them)} of {len(all_of_them)}"
    for what in ("ground", "grown", "height"):
        groups: dict[str, list[Return]] = {}
        for one in all_of_them:
            groups.setdefault(told_difference(one.visit, what), []).append(one)
        for difference, some in sorted(groups.items()):
            yield (
                f"    {difference:18} joined {sum(one.joined > 0 for one in some):4} of {len(some):4}; "
                f"of {len(some) * 12} frames "
                f"{sum(one.placed for one in some)} placed, {sum(one.joined for one in some)} on an island of the first; "
                f"{sum(one.compared for one in some)} pairs compared, {sum(one.registered for one in some)} rightly registered"
            )


def told_difference(visit: Visit, what: str) -> str:
    """One of the things that are different on a second visit."""
    later = visit.later
    assert later is not None
    return {"ground": visit.ground, "grown": f"grown {later.grown:.0%}", "height": f"height {later.height:.2f}"}[what]


def told_costs(found: Outcome) -> Iterator[str]:
    """Core seconds a frame of each stage."""
    frames = len(found.truth)
    for cost in found.costs:
        yield f"  {cost.stage:18}{1000 * cost.core_s / frames:9.2f} core ms a frame{cost.longest_s:9.2f} s the longest task"


def live(found: Outcome, folder: Path, lands: int) -> Iterator[str]:
    """The first frames of some second visits and of the first ones, through the live program."""
    chosen = [one for one in found.returns if one.visit.ground != "canopy"][:lands]
    firsts = {one.land: one.visit for one in found.truth if one.visit.later is None}
    for one in chosen:
        joined = flown(folder, firsts[one.visit.land], one.visit)
        differences = ", ".join(told_difference(one.visit, what) for what in ("ground", "grown", "height"))
        ours = f"archive {one.joined} of {one.visit.frames}"
        yield f"  live, land {one.visit.land} ({differences}): {joined} of {FLOWN} joined; {ours}"


def flown(folder: Path, *both: Visit) -> int:
    """Frames of the second of two visits that come to lie on an island of the first."""
    mosaic = Mosaic(config().stitch)
    for number in (visit.first + k for visit in both for k in range(FLOWN)):
        image = cv2.imread(str(folder / name_of(number)))
        mosaic.place(extract(np.asarray(image, np.uint8), config().stitch.features), name_of(number))
        mosaic.adjust()
    mosaic.retry_waiting()
    while mosaic.connect_some():
        mosaic.adjust()
    first, second = (
        Counter(p.island for p in mosaic.placements() if 0 <= number_of(p.name) - visit.first < visit.frames)
        for visit in both
    )
    return sum(count for island, count in second.items() if island in first)


if __name__ == "__main__":
    main()

"""The mosaic: frames in, placements out.

Usage:

    mosaic = Mosaic()
    for name, image in frames:
        print(mosaic.add(image, name))   # Placement, Covered, Waiting or Rejection
        mosaic.adjust()                  # as the map grows; usually there is nothing to do
        for placement in mosaic.moved():
            ...                          # every new or changed placement, including this frame's
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.bundle.island import IslandTask, island_task
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.schedule import Upkeep, UpkeepSettings
from gcs_mosaic.stitch.bundle.worker import Worker
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract, with_overlay
from gcs_mosaic.stitch.features.fixed_pattern import MEMORY, StillPattern
from gcs_mosaic.stitch.features.shelf import Shelve, Shelved
from gcs_mosaic.stitch.graph.candidates import Search, SearchSettings
from gcs_mosaic.stitch.graph.observer import Observer, island_residuals
from gcs_mosaic.stitch.graph.placement import Covered, Outcome, Placement, Rejection, Waiting, placement_of
from gcs_mosaic.stitch.graph.tearing import HeldOut, Tearing
from gcs_mosaic.stitch.graph.union import Renamed, unite
from gcs_mosaic.stitch.graph.view_graph import Aircraft, ViewGraph
from gcs_mosaic.stitch.mapping.covering import Covering, CoverSettings
from gcs_mosaic.stitch.mapping.incremental_mapper import Assembly
from gcs_mosaic.stitch.mapping.islands import Bridges, Island, IslandSettings
from gcs_mosaic.stitch.mapping.linking import link_across, link_pairs
from gcs_mosaic.stitch.mapping.previews import covered_by_whole, size_of_covered, with_previews
from gcs_mosaic.stitch.mapping.resection import Placing, PlausibilitySettings
from gcs_mosaic.stitch.mapping.second_look import Finer, SecondLookSettings
from gcs_mosaic.stitch.registration.settings import RegistrationSettings
from gcs_mosaic.stitch.transaction import Kept, transaction

NOTHING = ", it is flat or noise alone, as of a closed shutter or a covered lens"


@dataclass(frozen=True, slots=True, kw_only=True)
class StitchSettings:
    """How frames are placed."""

    features: FeatureSettings = field(default_factory=FeatureSettings)
    registration: RegistrationSettings = field(default_factory=RegistrationSettings)
    cover: CoverSettings = field(default_factory=CoverSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    plausibility: PlausibilitySettings = field(default_factory=PlausibilitySettings)
    islands: IslandSettings = field(default_factory=IslandSettings)
    adjustment: AdjustmentSettings = field(default_factory=AdjustmentSettings)
    upkeep: UpkeepSettings = field(default_factory=UpkeepSettings)
    second_look: SecondLookSettings = field(default_factory=SecondLookSettings)
    memory_mb: int = 64  # features kept in memory, of some 150 to 250 frames; the others go to a scratch file


class Mosaic(Kept):
    """Places frames on one canvas per island, from their pixels alone.

    Large islands are adjusted by `worker` in the background while frames are still being placed; without a worker, inside
    `adjust`. `punctual`: results are deterministic, however fast the worker is. `observer` is notified of every placement
    decision. A frame that raises leaves no trace; when several islands are adjusted or frames compared, each one is either done
    or unchanged. `shelve`: where the large arrays of features go; without, they stay in memory. `search`: what compares frames,
    made as a `Search` is. `finer`: finds a frame's features at a finer picture, see `second_look`; without, none is looked at a
    second time.
    """

    FIXED = frozenset({"settings", "_search", "_covering", "_assembly", "_observer"})
    in_order = False  # whether each frame has to overlap the one placed before it

    def __init__(
        self,
        settings: StitchSettings | None = None,
        worker: Worker | None = None,
        *,
        punctual: bool = False,
        observer: Observer | None = None,
        shelve: Shelve | None = None,
        search: Callable[..., Search] = Search,
        finer: Finer | None = None,
    ) -> None:
        self.settings = settings or StitchSettings()
        adjustment = self.settings.adjustment
        self._graph = ViewGraph(adjustment.focal_prior, adjustment.matches_per_pair, shelve)
        self._search = search(self._graph, self.settings.search, self.settings.registration, observer)
        self._upkeep = Upkeep(
            self._graph, self.settings.upkeep, adjustment, worker, punctual=punctual, adjusted=self._tell_adjusted
        )
        self._observer = observer
        placing = Placing(self._graph, self._search, self.settings.plausibility, adjustment)
        bridges = Bridges(self._graph, self._search, self.settings.islands)
        self._assembly = Assembly(
            self._graph, self._search, placing, bridges, self._upkeep, observer, self.settings.second_look, finer
        )
        self._covering = Covering(self._graph, self._search, self.settings.cover)
        self._covered: list[Covered] = []
        self._previews: dict[str, str] = {}  # and the frames of their whole pictures
        self._replaced: set[str] = set()  # previews of the graph that are covered by these, as no other frame of it is
        self._still = StillPattern()
        # By camera, the frames of the graph from before it was known what an overlay covers; the latest of them.
        self._uncovered: dict[int, tuple[int, ...]] = {}
        self._tearing = Tearing(self._graph, adjustment.relief)

    @property
    def islands(self) -> list[Island]:
        """All islands ever founded, by number."""
        return [Island(number, into) for number, into in enumerate(self._graph.merged_into)]

    def add(self, image: Bands, name: str) -> Outcome:
        """Extract the features of an image (h, w[, bands]), uint8 or uint16, and place it."""
        return self.place(extract(image, self.settings.features), name)

    def place(self, features: Features, name: str, order: int | None = None, aircraft: Aircraft = None) -> Outcome:
        """Place a frame by its features. `order`: its capture index; default: frames are placed in capture order. `aircraft`:
        what carried the camera, where several fly: each camera has a lens of its own."""
        with transaction(self):
            self._graph.turn_to(self._graph.order + 1 if order is None else order, aircraft)
            features = self._still.without(features, self.settings.features, aircraft)
            if len(features) < self.settings.plausibility.least_features:
                why = NOTHING if features.shows_nothing else ""
                return Rejection(name, f"too little to see: {len(features)} features{why}")
            compared = self._covering.look(name, features, self._previews)
            if isinstance(compared, Covered):
                self._covered.append(compared)
                return compared
            frame = self._graph.append(name, features)
            self._cover_earlier(frame, features.still)
            return placement_of(self._graph, frame) if self._assembly.take_in(frame, compared) else Waiting(name)

    def note_whole(self, preview: str, whole: str) -> None:
        """Two frames are one shot: of `preview` a whole picture follows, or has come. Once that is placed, see `replaced`."""
        self._previews[preview] = whole

    def replaced(self) -> list[tuple[Covered, tuple[int, int]]]:
        """Previews that are covered from now on, since their whole pictures have a place, and what they covered; with their sizes
        in pixels. Links keep them where they are, so nothing else moves."""
        with transaction(self):
            pairs = [pair for pair in self._previews.items() if pair[0] not in self._replaced]
            new = [one for pair in pairs if (one := covered_by_whole(self._graph, *pair, self._covered))]
            if not new:
                return []
            self._replaced |= {one.name for one in new}
            self._covered, changed = with_previews(self._covered, new)
            return [(one, size_of_covered(self._graph, one, new)) for one in changed]

    def _cover_earlier(self, frame: int, still: StillMask | None) -> None:
        """Tell a camera's earlier frames what an overlay covers, once that is known."""
        camera = self._graph.frames[frame].camera
        earlier = self._uncovered.get(camera, ())
        if still is None:
            self._uncovered[camera] = (*earlier, frame)[-MEMORY:]
            return
        for other in self._uncovered.pop(camera, ()):
            self._graph.note(other, features=with_overlay(self._graph.frames[other].features, still))

    def take_over(self, other: Mosaic, renamed: Renamed) -> None:
        """Add what another flight has found; `connect_some` and `adjust` then join what overlaps. `other` is used up."""
        with transaction(self):
            first = unite(self._graph, other._graph, renamed)
            for island, frames in other._upkeep.grown.items():
                self._upkeep.grow(island + first, frames)
            self._covered += [
                replace(one, name=renamed.name_of(one.name), by=renamed.name_of(one.by)) for one in other._covered
            ]
            names = other._previews.items()
            self._previews |= {renamed.name_of(preview): renamed.name_of(whole) for preview, whole in names}
            self._replaced |= {renamed.name_of(name) for name in other._replaced}

    def fold(self) -> None:
        """At the end, before it is saved to be taken over: keep no places of features, and of links only what adjustments and
        comparisons of the frames with others use."""
        self._graph.fold()

    def unfold(self, points_of: Callable[[str, int], Shelved]) -> None:
        """Once what was folded is taken over: where the places of each frame's features are, by its name and their number."""
        self._graph.unfold(points_of)

    def retry_waiting(self) -> None:
        """Retry all waiting frames with everything learnt since: for the end of a flight.

        A frame that raises is left unchanged and the others are still tried; the first error is raised at the end.
        """
        self._assembly.retry_waiting()

    def connect_some(self, frames: int = 2) -> bool:
        """When idle, and at the end of a flight: compare some frames with the most similar ones they are not connected with. Call
        again while it returns True, then call `adjust`.

        Two frames whose comparison raises are left unchanged and not compared again; the first error is raised at the end. So
        calling again after an error is safe and terminates.
        """
        return self._assembly.connect_some(frames)

    def connect(self, pairs: Iterable[tuple[str, str]]) -> bool:
        """Compare frames of which is known that they look alike, where they are not connected: as `connect_some`, which looks for
        such pairs itself. Whether any was connected; then call `adjust`."""
        return self._assembly.connect(self._numbers(pairs))

    def link(self, pairs: Iterable[tuple[str, str]]) -> tuple[int, int]:
        """Link frames that lie on one island, where that agrees with how they were registered; then call `adjust`. Returns how
        many were linked, and how many registrations do not agree."""
        with transaction(self):
            gained, astray = link_pairs(self._graph, self._search, self._numbers(pairs))
            self._make_due(gained)
        return sum(gained.values()), astray

    def _numbers(self, pairs: Iterable[tuple[str, str]]) -> list[tuple[int, int]]:
        """Frames by their numbers; what is covered or was rejected has none."""
        numbers = self._graph.numbers
        return [(numbers[one], numbers[other]) for one, other in pairs if one in numbers and other in numbers]

    def link_across(self) -> None:
        """Link what several aircraft or flights have seen of one ground, wherever it overlaps; then call `adjust`."""
        with transaction(self):
            self._make_due(link_across(self._graph, self._search))

    def _make_due(self, islands: Iterable[int]) -> None:
        for island in islands:
            self._upkeep.grow(island, self._graph.count_members(island))  # all of it

    def adjust(self, *, everything: bool = False) -> None:
        """After each frame: adjust the islands that have grown enough since their last adjustment.

        With `everything`, all that have grown at all, synchronously: for the end of a flight. Each island is either adjusted or
        left unchanged; if one raises, the call may be repeated.
        """
        self._upkeep.finish() if everything else self._upkeep.after_frame()
        if everything:
            self._tearing.forget_all()

    def adjustments(self) -> list[IslandTask]:
        """The joint adjustment of each island with links, at the present poses: for who makes it elsewhere instead of here."""
        islands = sorted(self._graph.frame_counts())
        tasks = [island_task(self._graph, island, self.settings.adjustment) for island in islands]
        return [task for task in tasks if task is not None]

    def adjust_in_a_pause(self) -> bool:
        """When idle: adjust all islands that have grown. Call again while it returns True."""
        return self._upkeep.in_a_pause()

    @property
    def problem(self) -> str | None:
        """Message for the operator: the worker has failed, so frames wait for adjustments."""
        return self._upkeep.problem

    def moved(self) -> list[Placement]:
        """All placements that are new or have changed since the last call, in frame order.

        Besides the frame just placed: frames that waited for it, islands it merged, and whatever an adjustment moved.
        """
        moved = [placement_of(self._graph, frame) for frame in self._own(sorted(self._graph.moved))]
        self._graph.moved.clear()
        return moved

    def anchor_drawn_pose(self, name: str, pose: Pose, camera: Camera) -> None:
        """Record that a frame has been drawn at this pose: adjustments keep it there as far as one similarity can."""
        self._graph.note(self._graph.numbers[name], drawn=(pose, camera))

    def placements(self) -> list[Placement]:
        """All placed frames, in order of arrival."""
        return [placement_of(self._graph, frame) for frame in self._own(self._graph.placed().tolist())]

    def _own(self, frames: Iterable[int]) -> list[int]:
        """Those that are shots of their own."""
        return [frame for frame in frames if self._graph.frames[frame].name not in self._replaced]

    def covered(self) -> list[Covered]:
        """All covered frames, in order of arrival."""
        return list(self._covered)

    def frame_counts(self) -> dict[int, int]:
        """Number of placed frames by island."""
        counts, numbers = self._graph.frame_counts(), self._graph.numbers
        for name in self._replaced:
            counts[self._graph.island_of(numbers[name])] -= 1
        return counts

    def held_out(self) -> dict[int, HeldOut]:
        """Held-out match error of each island with its present poses; small islands are omitted."""
        return self._tearing.of_islands()

    def waiting(self) -> list[Waiting]:
        """Frames without a match so far."""
        return [Waiting(self._graph.frames[frame].name) for frame in self._graph.waiting]

    def finish(self) -> list[Rejection]:
        """No more frames will come: reject those still waiting."""
        return [Rejection(w.name, "matches no other frame") for w in self.waiting()]

    def _tell_adjusted(self, island: int) -> None:
        self._tearing.forget(island)
        if self._observer:
            self._observer.adjusted(island, lambda: island_residuals(self._graph, island))

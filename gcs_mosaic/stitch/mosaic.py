"""The mosaic: frames in, placements out.

In use:

    mosaic = Mosaic()
    for name, image in frames:
        print(mosaic.add(image, name))   # Placement, Covered, Waiting or Rejection
        mosaic.adjust()                  # as the map grows; mostly there is nothing to do
        for placement in mosaic.moved():
            ...                          # all that lie elsewhere than before, this frame among them
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.schedule import Upkeep, UpkeepSettings
from gcs_mosaic.stitch.bundle.worker import Worker
from gcs_mosaic.stitch.camera.bands import Bands
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.features.fixed_pattern import StillPattern
from gcs_mosaic.stitch.graph.candidates import Search, SearchSettings
from gcs_mosaic.stitch.graph.observer import Observer, island_residuals
from gcs_mosaic.stitch.graph.placement import Covered, Outcome, Placement, Rejection, Waiting, placement_of
from gcs_mosaic.stitch.graph.tearing import HeldOut, Tearing
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.mapping.covering import Covering, CoverSettings
from gcs_mosaic.stitch.mapping.incremental_mapper import Assembly
from gcs_mosaic.stitch.mapping.islands import Bridges, Island, IslandSettings
from gcs_mosaic.stitch.mapping.resection import Placing, PlausibilitySettings
from gcs_mosaic.stitch.registration.registration import RegistrationSettings
from gcs_mosaic.stitch.transaction import Kept, transaction


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


class Mosaic(Kept):
    """Places frames on one canvas per island, from their pixels alone.

    Large islands are adjusted by `worker` while frames go on being placed, without one in `adjust`. `punctual`: the same
    frames always give the same map, however fast the worker is. `observer` is told what decides where frames lie.
    A frame that raises has changed nothing; of several islands to adjust, or frames to compare, each one is or is as it was.
    """

    FIXED = frozenset({"settings", "_search", "_covering", "_assembly", "_observer"})

    def __init__(
        self,
        settings: StitchSettings | None = None,
        worker: Worker | None = None,
        *,
        punctual: bool = False,
        observer: Observer | None = None,
    ) -> None:
        self.settings = settings or StitchSettings()
        adjustment = self.settings.adjustment
        self._graph = ViewGraph(adjustment.focal_prior, adjustment.matches_per_pair)
        self._search = Search(self._graph, self.settings.search, self.settings.registration, observer)
        self._upkeep = Upkeep(
            self._graph, self.settings.upkeep, adjustment, worker, punctual=punctual, adjusted=self._tell_adjusted
        )
        self._observer = observer
        placing = Placing(self._graph, self._search, self.settings.plausibility, adjustment)
        bridges = Bridges(self._graph, self._search, self.settings.islands)
        self._assembly = Assembly(self._graph, self._search, placing, bridges, self._upkeep, observer)
        self._covering = Covering(self._graph, self._search, self.settings.cover)
        self._covered: list[Covered] = []
        self._still = StillPattern()
        self._tearing = Tearing(self._graph, adjustment.relief)

    @property
    def islands(self) -> list[Island]:
        """All islands there have ever been, by number."""
        return [Island(number, into) for number, into in enumerate(self._graph.merged_into)]

    def add(self, image: Bands, name: str) -> Outcome:
        """Find the features of an image (h, w[, bands]) uint8 or uint16 and place it."""
        return self.place(extract(image, self.settings.features), name)

    def place(self, features: Features, name: str, order: int | None = None) -> Outcome:
        """Place a frame by its features. `order`: its number in the order of capture; none: frames are placed in that order."""
        with transaction(self):
            self._graph.turn_to(self._graph.order + 1 if order is None else order)
            features = self._still.without(features, self.settings.features)
            if len(features) < self.settings.plausibility.least_features:
                return Rejection(name, f"too little to see: {len(features)} features")
            compared = self._covering.look(name, features)
            if isinstance(compared, Covered):
                self._covered.append(compared)
                return compared
            frame = self._graph.append(name, features)
            return placement_of(self._graph, frame) if self._assembly.take_in(frame, compared) else Waiting(name)

    def retry_waiting(self) -> None:
        """Try all that wait with whatever has become known since: for the end of a flight.

        A frame that raises is as it was, the others are tried; the first error is raised at the end.
        """
        self._assembly.retry_waiting()

    def connect_some(self, frames: int = 2) -> bool:
        """While no frame comes, and at the end of a flight: compare some frames with those that look most like them and are
        not connected with them. To be called again while it returns True; `adjust` is to follow.

        Two frames that raise are as they were and are not compared again; the first error is raised at the end. So it may be
        called again after one, too, and comes to an end.
        """
        return self._assembly.connect_some(frames)

    def adjust(self, *, everything: bool = False) -> None:
        """After each frame: adjust the islands that have grown enough since the last time.

        With `everything` all that have grown at all, and here and now: for the end of a flight. Each island is adjusted or
        left as it was; if it raises, for one of them, it may be called again.
        """
        self._upkeep.finish() if everything else self._upkeep.after_frame()
        if everything:
            self._tearing.forget_all()

    def adjust_in_a_pause(self) -> bool:
        """While no frame comes: adjust all islands that have grown. To be called again while it returns True."""
        return self._upkeep.in_a_pause()

    @property
    def problem(self) -> str | None:
        """What the operator should know: the worker has failed, so frames wait for adjustments."""
        return self._upkeep.problem

    def moved(self) -> list[Placement]:
        """All placements that are new or lie elsewhere than when this was last asked, in the order of their frames.

        Besides the frame just placed these are frames that had waited for it, islands that it joined, and what the
        adjustment moved.
        """
        moved = [placement_of(self._graph, frame) for frame in sorted(self._graph.moved)]
        self._graph.moved.clear()
        return moved

    def hold(self, name: str, pose: Pose, camera: Camera) -> None:
        """Tell that a frame has been drawn at this pose: adjustments keep it there as far as one similarity can."""
        self._graph.note(self._graph.numbers[name], held=(pose, camera))

    def placements(self) -> list[Placement]:
        """All placed frames, in the order in which they came."""
        return [placement_of(self._graph, frame) for frame in self._graph.placed().tolist()]

    def covered(self) -> list[Covered]:
        """All frames that placed ones cover, in the order in which they came."""
        return list(self._covered)

    def frame_counts(self) -> dict[int, int]:
        """Placed frames by island."""
        return self._graph.frame_counts()

    def held_out(self) -> dict[int, HeldOut]:
        """How far each island, as its frames lie now, tears matches apart that it was not fitted to; none of small ones."""
        return self._tearing.of_islands()

    def waiting(self) -> list[Waiting]:
        """Frames that match nothing so far."""
        return [Waiting(self._graph.frames[frame].name) for frame in self._graph.waiting]

    def finish(self) -> list[Rejection]:
        """Nothing more will come: what still waits is rejected."""
        return [Rejection(w.name, "matches no other frame") for w in self.waiting()]

    def _tell_adjusted(self, island: int) -> None:
        self._tearing.forget(island)
        if self._observer:
            self._observer.adjusted(island, lambda: island_residuals(self._graph, island))

"""The processing pipeline, shared by live flights and folders of frames."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from gcs_mosaic.app.pipeline.method import method_of
from gcs_mosaic.app.pipeline.render_stage import RenderStage
from gcs_mosaic.app.pipeline.resuming import Run, boot_id, runs_of, settings_of, shelf_of, source_of, utc_of_zero
from gcs_mosaic.app.pipeline.rewritten import previews_of
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, UndecodableFrame, finer_reduction
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.messages import Frame, Notice
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.bundle.worker import WorkerProcess
from gcs_mosaic.stitch.features.extraction import Features, extract
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.placement import Covered, Outcome, Placement, Rejection, Waiting
from gcs_mosaic.stitch.graph.union import Renamed
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.stitch.transaction import Kept, Snapshot, transaction
from gcs_mosaic.store.array_shelf import ArrayShelf
from gcs_mosaic.store.checkpoint import Checkpoints
from gcs_mosaic.store.flight_store import FlightStore, StoreHooks
from gcs_mosaic.store.records import Accounts, FrameState, IslandRecord
from gcs_mosaic.store.stages import stage

logger = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Done:
    """Outcome of a frame, for the operator. `seconds` by stage."""

    name: str
    state: FrameState
    reason: str | None
    island: int | None
    seconds: dict[str, float]
    covered_by: str | None = None
    on_map: tuple[str, ...] = ()  # frames placed by this step: this one, and waiting ones


class Pipeline(Kept):
    """Owns the mosaic, the canvas and the output folder of one flight. For use by one thread.

    A frame is placed and painted, or it is rejected and the state is as if it had never arrived, whatever was raised. Other
    failures do not reject it: an island that cannot be adjusted stays as it was, another frame that cannot be painted stays
    unpainted and is retried with the next ones, a part of the map that cannot be repainted keeps its content. All failures
    are reported.

    `say` receives notices for the operator; `around` is the store's. `punctual`: the same frames always give the same map,
    whatever the machine's speed. `paint_live`: paint each frame on arrival, not all at the end. `paint_first`: and before the
    map is adjusted to it, for which `adjust` is called afterwards. `observer` is called while frames are placed. `checkpoints`:
    where checkpoints are written, if any; `shelf`: where features are, its own by default; `camera_of` tells whose camera took a
    frame.
    """

    FIXED = frozenset(
        {
            "_shelf",
            "_worker",
            "decoders",
            "_say",
            "features_of",
            "_checkpoints",
            "_of_flight",
            "_camera_of",
            "_stitch",
            "_paint_first",
        }
    )

    def __init__(
        self,
        out: Path,
        config: Config,
        say: Callable[[Notice], None],
        around: StoreHooks | None = None,
        *,
        punctual: bool = False,
        paint_live: bool = True,
        paint_first: bool = False,
        observer: Observer | None = None,
        checkpoints: Checkpoints | None = None,
        shelf: ArrayShelf | None = None,
        camera_of: Callable[[Frame], int | None] = lambda frame: frame.vehicle,
    ) -> None:
        self.store = FlightStore(
            out,
            originals=config.originals,
            tiles=config.tiles,
            canvas=config.paint.canvas,
            around=around,
        )
        self._worker, self._shelf = WorkerProcess(), shelf or shelf_of(config, out)
        self.decoders = Decoders(config.decode, config.frames.max_pixels)
        parts = self._worker, self.load_original, self._note_painted, out, observer, self._shelf.shelve
        method = method_of(config, *parts, self._finer_features, punctual=punctual, paint_live=paint_live)
        self.mosaic, self._renderer = method.mosaic, method.renderer
        # Features of an image, by `reduction`, used for placing. May be called from any thread.
        self.features_of, self.feature_pixels = method.features_of, method.feature_pixels
        self._said_problems: dict[str, str | None] = {}  # last one reported, by source or by operation
        self._reduction, self._camera_of, self._stitch = config.reduction, camera_of, config.stitch
        self._processed: dict[str, None] = {}  # frame names, in order of processing
        self._of_flight = _of_flight(config)
        self._checkpoints, self._say, self._paint_first = checkpoints, say, paint_first
        self._render_stage = RenderStage(self._renderer, self.store, self, self.load_original, say)

    @property
    def has_repaints(self) -> bool:
        """Whether some frames have moved from where they are painted."""
        return self._renderer.has_repaints

    @property
    def shows_old_range(self) -> bool:
        """Whether parts of the map are still shown in a range of counts that was fitted anew since."""
        return self._renderer.shows_old_range

    def accounts(self) -> Accounts:
        return self.store.accounts()

    # Resuming

    def take_over(self, saved: Snapshot, renamed: Renamed) -> None:
        """Add what another flight has found, by its checkpoint; its frames are in the store already. Call `resume` afterwards.

        Raises whatever a checkpoint raises that does not fit; then all is as before.
        """
        other = Mosaic(self.mosaic.settings, shelve=self._shelf.shelve)
        other.load(saved["mosaic"])
        with transaction(self):
            self.mosaic.take_over(other, renamed)
            self._processed |= {renamed.name_of(name): None for name in saved["_processed"]}

    def resume(self, saved: Snapshot | None) -> list[Frame]:
        """Resume the folder's flight from what `checkpoint` saved; None stitches all of it again from its originals.

        Returns the frames still to be processed, in order of arrival. Call `save` afterwards.
        """
        counts = len(self.store.ledger.events()), len(self.store.ledger.frames())
        self._of_flight["runs"] = [*runs_of(saved), Run(*counts, utc_of_zero(), boot_id())]
        if saved is None or not self._loaded(saved["pipeline"]):
            self.store.ledger.set_canvas(self.store.canvas)
        for preview, whole in previews_of(self.store.ledger):
            self.mosaic.note_whole(preview, whole)
        shown = [painted for island in self.store.ledger.islands() for painted in self.store.ledger.painted(island.id)]
        placed = [placement.name for placement in self.mosaic.placements()]
        again = self.store.resume(self._processed.keys(), placed, [covered.name for covered in self.mosaic.covered()])
        self.store.remove_tiles_but(self._renderer.resume(shown))
        waiting = [waiting.name for waiting in self.mosaic.waiting()]
        self.store.tell_whole(self.mosaic.placements(), self._renderer.painted(), self.mosaic.covered(), waiting)
        return again

    def _loaded(self, saved: Snapshot) -> bool:
        try:
            with transaction(self):
                self.load(saved)
        except Exception as error:
            logger.exception("the checkpoint could not be taken up")
            text = f"the flight's checkpoint does not fit ({error!r}), so its frames are stitched again"
            self._say(Notice(source="out", level="warning", text=text))
            return False
        return True

    def checkpoint(self, *, at_once: bool = False) -> None:
        """Write a checkpoint; `at_once`, or when it costs little. Call after `save`."""
        if self._checkpoints is not None:
            self._checkpoints.write(self._state, self.store.ledger.make_durable, at_once=at_once)
            self._say_problem("checkpoint", self._checkpoints.problem)

    def checkpoint_into(self, checkpoints: Checkpoints | None) -> None:
        """Write whole checkpoints there from now on: what was written may be gone."""
        if self._checkpoints is not None:
            self._checkpoints.close()
        self._checkpoints = checkpoints

    def _state(self) -> Snapshot:
        return self._of_flight | {"pipeline": self.saved()}

    # Arrivals

    def accept(self, frame: Frame) -> Frame | None:
        """Record a new frame and keep its original; returns the frame to process, as kept.

        None if the same image arrived before.
        """
        kept, said = self.store.accept(frame)
        for notice in said:
            self._say(notice)
        return kept

    # Processing

    def process(self, prepared: DecodedFrame | UndecodableFrame) -> Done:
        """Place and paint a frame and any waiting frames it makes placeable. Call `save` afterwards."""
        name = prepared.frame.name
        try:
            with transaction(self):
                done = self._process(prepared)
                self._processed[name] = None
                return done
        except Exception as error:  # no fault in one frame may end the flight or go unreported
            logger.exception("%s could not be processed", name)
            reason = f"it could not be processed ({error!r})"
            self._say(Notice(source="pipeline", level="error", text=f"{name}: {reason}"))
            self._processed[name] = None
            self.store.settle(name, FrameState.REJECTED, reason)
            return Done(name, FrameState.REJECTED, reason, None, {})

    def skip(self, name: str, reason: str) -> None:
        """Do not process a frame that was accepted: another one shows the same. Call `save` afterwards."""
        self._processed[name] = None
        self.store.settle(name, FrameState.DUPLICATE, reason)

    def note_whole(self, preview: str, whole: str) -> None:
        """The frame `whole` is the whole picture of a smaller preview that was accepted before: where both are placed, only that
        one is painted."""
        self.mosaic.note_whole(preview, whole)

    def _process(self, prepared: DecodedFrame | UndecodableFrame) -> Done:
        name = prepared.frame.name
        self.tell_troubles()
        if isinstance(prepared, UndecodableFrame):
            self.store.may_come_again(prepared.frame)
            self.store.settle(name, FrameState.DAMAGED, prepared.reason)
            return Done(name, FrameState.DAMAGED, prepared.reason, None, {})
        seen = prepared.features
        self.store.note_measured(name, (seen.width, seen.height), seen.sharpness)
        start = time.perf_counter()
        aircraft = self._camera_of(prepared.frame)
        self._renderer.begin_look(name, prepared.image, aircraft, prepared.features.area)
        with stage("place", name):
            in_sight = self._renderer.in_sight(prepared.features, prepared.image, aircraft)
            outcome = self.mosaic.place(in_sight, name, self.store.order_of(name), aircraft)
        if not self._paint_first:
            self._adjusted(self.mosaic.adjust, name)
        placed = time.perf_counter()
        state, reason = _state_of(outcome)
        if state is not FrameState.REJECTED:
            self.decoders.note_true_frame(prepared.features.width * prepared.features.height)
        self.store.settle(name, state, reason)
        covered_by = outcome.by if isinstance(outcome, Covered) else None
        if isinstance(outcome, Covered):
            self.store.note_covered(outcome)
        with stage("paint", name):
            found = self._paint_moved(prepared)
        seconds = {"place": placed - start, "paint": time.perf_counter() - placed}
        island = outcome.island if isinstance(outcome, Placement) else None
        on_map = (*found, name) if covered_by else found
        return Done(name, state, reason, island, prepared.seconds | seconds, covered_by, on_map)

    def adjust(self) -> None:
        """Adjust what has grown, after each frame that was painted first; never raises. Call `save` afterwards."""
        self._adjusted(self.mosaic.adjust)
        self._tried(self._follow_moved, "frames that have moved could not be noted")

    def repaint_some(self) -> bool:
        """Use spare time to repaint a moved frame; False if there is nothing to do. Call `save` afterwards."""
        with stage("repaint", ""):
            some = self._render_stage.repaint_some()
        self._say_problem("canvas", self._renderer.canvas.problem)
        return some

    def adjust_in_a_pause(self) -> bool:
        """Use a pause in the flight to adjust every island that has grown. Call `save` afterwards.

        Call again while it returns True: the adjustment is running in the background.
        """
        self.store.in_a_pause = True
        under_way = self._adjusted(self.mosaic.adjust_in_a_pause) or self._connected_some()
        self._follow_moved()
        return bool(under_way)

    def settle_in_a_pause(self) -> None:
        """Use a pause in which nothing is left to be adjusted: all frames get the brightness and places that they would have at
        the end, and `repaint_some` shows it; never raises. Call `save` afterwards."""
        with stage("repaint", ""):
            self._tried(self._settled, "the whole map could not be painted in a pause")

    def _settled(self) -> None:
        self._render_stage.settle(self.mosaic.placements())

    def _connected_some(self) -> bool:
        """Compare some unconnected frames that look alike; returns whether there are more."""
        try:
            with stage("connect", ""):
                more = self.mosaic.connect_some()
        except Exception as error:
            logger.exception("frames could not be compared")
            self._say_problem(
                "islands", f"some frames could not be compared with those that look like them ({error!r})"
            )
            more = True  # perhaps; a comparison that raised is not repeated, so this terminates
        self._adjusted(self.mosaic.adjust)
        return more

    def finish(self) -> Iterator[None]:
        """End the flight: settle it, then paint everything, step by step. `save` may be called after each step."""
        yield from self.settle()
        yield from self.repaint_all()

    def settle(self, may_connect: Callable[[], bool] = lambda: True) -> Iterator[None]:
        """End the flight: connect what can be connected, adjust everything, reject the rest, step by step.

        Must be exhausted, or frames stay waiting; when time is short, let `may_connect` return False. It decides whether to
        compare more unconnected frames: a painted map takes priority over one with fewer islands.
        """
        self.store.in_a_pause = True
        self._tried(self.mosaic.retry_waiting, "a frame that waits could not be tried again")
        while self._connected_some():
            if not may_connect():
                text = "there was no time to connect more parts of the map: stitch goes on with it"
                self._say(Notice(source="adjustment", level="info", text=text))
                break
            self._follow_moved()
            yield
        self._tried(self.mosaic.retry_waiting, "a frame that waits could not be tried again")
        self._adjusted(partial(self.mosaic.adjust, everything=True))
        with transaction(self):
            self._paint_moved(None)
            for rejection in self.mosaic.finish():
                self.store.settle(rejection.name, FrameState.REJECTED, rejection.reason)
        yield

    def link_across(self) -> None:
        """After `settle`, of several flights: link them wherever they overlap, and adjust again."""
        self._tried(self.mosaic.link_across, "frames of several flights could not be linked")
        self._adjusted(partial(self.mosaic.adjust, everything=True))
        self._follow_moved()

    def repaint_all(self) -> Iterator[None]:
        """Repaint everything at its final place and brightness, step by step; may be abandoned at any step when time is up."""
        with closing(self._render_stage.repaint_all(self.mosaic.placements())) as steps:
            while self._one_more(steps):
                yield

    def _one_more(self, steps: Iterator[None]) -> bool:
        """Whether there was another step of repainting to do."""
        with stage("repaint", ""):
            return next(steps, False) is None

    def _paint_moved(self, prepared: DecodedFrame | None) -> tuple[str, ...]:
        """Paint newly placed frames and return their names; note those that must be repainted elsewhere."""
        self._leave_out_previews()
        moved = self.mosaic.moved()
        self.store.note_placed(moved)
        found = tuple(placement.name for placement in moved if not self._renderer.is_painted(placement.name))
        for name in found:
            self.store.settle(name, FrameState.PLACED, None)
        self._render_stage.follow(moved, prepared)
        return found

    def _follow_moved(self) -> None:
        """As `_paint_moved` between frames: all of it, or nothing."""
        with transaction(self):
            self._paint_moved(None)

    def _leave_out_previews(self) -> None:
        """Of shots whose whole picture has a place by now."""
        for covered, size in self.mosaic.replaced():
            self._render_stage.take_away(covered.name)
            self.store.settle(covered.name, FrameState.COVERED, None)
            self.store.note_replaced(covered, size)

    def _adjusted(self, adjust: Callable[[], T], of: str = "") -> T | None:
        """A failure here must not reject the frame just placed: the map is valid without the adjustment."""
        with stage("adjust", of):
            found = self._tried(adjust, "the map could not be adjusted")
        self._say_problem("adjustment", self.mosaic.problem)
        self._say_problem("features", self._shelf.problem)
        return found

    def _tried(self, attempt: Callable[[], T], otherwise: str) -> T | None:
        """The result of `attempt`; None if it raises. A fault that recurs at every frame is reported and logged once."""
        try:
            found = attempt()
        except Exception as error:
            text = f"{otherwise} ({error!r})"
            if text != self._said_problems.get(otherwise):
                logger.exception("%s", otherwise)
                self._say(Notice(source="adjustment", level="error", text=text))
            self._said_problems[otherwise] = text
            return None
        self._said_problems.pop(otherwise, None)
        return found

    def keep_lost_originals(self, until: float) -> list[Notice]:
        """Keep those that are not kept and can be found, one after another, until this monotonic time, but one at least; tiles
        that have waited for them are painted again. Returns what to say."""
        said, store = list[Notice](), self.store
        while store.seeks_originals(now := time.monotonic()):
            said += store.keep_lost(now)
            if now >= until:
                break
        self._renderer.canvas.look_again(store.take_regained())
        return said

    def tell_troubles(self) -> None:
        """Say what has happened to the processes that decode."""
        while text := self.decoders.take_trouble():
            self._say(Notice(source="decoding", level="warning", text=text))

    def _say_problem(self, source: str, problem: str | None) -> None:
        if problem and problem != self._said_problems.get(source):
            self._say(Notice(source=source, level="warning", text=problem))
        self._said_problems[source] = problem

    def load_original(self, name: str, reduction: int | None = None) -> Bands | None:
        """A frame's original, reduced by this flight's factor or another; None if it is missing or has changed."""
        data = self.store.original(name)
        if data is None:
            return None
        image = self.decoders.decode(data, self.store.content_hash(name), reduction or self._reduction)
        return None if isinstance(image, Unreadable) else image

    def _finer_features(self, name: str) -> Features | None:
        """A frame's features at a second look; None if its original is missing."""
        look = self._stitch.second_look.features(self._stitch.features)
        image, reduction = self.load_original(name), self._reduction
        if image is None:
            return None
        finer = finer_reduction(image.shape[0] * image.shape[1], reduction, look.megapixels * 1e6)
        looked_at = image if finer == reduction else self.load_original(name, finer)
        return None if looked_at is None else extract(looked_at, look, finer)

    def _note_painted(self, painted: RenderItem) -> None:
        self.store.note_painted(painted)
        self.mosaic.anchor_drawn_pose(painted.name, painted.pose, painted.camera)

    def save(self) -> float:
        """Write all changes; returns the seconds it took."""
        start = time.perf_counter()
        mosaic = self.mosaic
        islands = [IslandRecord(id=island.number, merged_into=island.merged_into) for island in mosaic.islands]
        self.store.save(self._renderer.canvas, islands, mosaic.frame_counts(), mosaic.held_out)
        return time.perf_counter() - start

    def close(self) -> None:
        """Release all resources; unsaved changes are lost."""
        if self._checkpoints is not None:
            self._checkpoints.close()
        self._worker.close()
        self.decoders.close()
        self._renderer.close()
        self._shelf.close()
        self.store.close()


def _of_flight(config: Config) -> Snapshot:
    """What a checkpoint tells of its flight as such."""
    return {"settings": settings_of(config), "source": source_of(config), "runs": [Run(0, 0, utc_of_zero(), boot_id())]}


def _state_of(outcome: Outcome) -> tuple[FrameState, str | None]:
    match outcome:
        case Placement():
            return FrameState.PLACED, None
        case Covered():
            return FrameState.COVERED, None
        case Waiting():
            return FrameState.WAITING, None
        case Rejection():
            return FrameState.REJECTED, outcome.reason

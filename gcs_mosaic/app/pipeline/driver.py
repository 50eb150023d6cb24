"""Per-frame sequence shared by all modes: accept, decode ahead, place, paint, save; and the end of a flight.

Modes differ in where frames come from and in their processing order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from gcs_mosaic.app.machine import give_back
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, UndecodableFrame
from gcs_mosaic.messages import DamagedFile, DroppedFrame, Frame

GIVE_BACK_EACH = 4  # frames: less than a hundredth of the time
GIVE_BACK_STEPS = 4  # of repainting, of a frame each


class Driver:
    """Drives a pipeline."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._processed, self._repainted = 0, 0

    def accept(self, item: Frame | DamagedFile | DroppedFrame) -> Frame | None:
        """Accept an arrival; returns the frame to process, as kept, or None."""
        match item:
            case Frame():
                return self._pipeline.accept(item)
            case DamagedFile():
                self._pipeline.store.accept_damaged(item)
            case DroppedFrame():
                self._pipeline.store.accept_dropped(item)
        return None

    def process(self, decoded: DecodedFrame | UndecodableFrame, between: Callable[[Done], None] | None = None) -> Done:
        """Place, paint and save a frame; `between` is called before the save."""
        done = self._pipeline.process(decoded)
        if between is not None:
            between(done)
        done.seconds["write"] = self.save()
        self._processed += 1
        if self._processed % GIVE_BACK_EACH == 0:
            give_back()
        return done

    def finish(self) -> Iterator[None]:
        """End the flight: settle it and paint everything, step by step, saving after each."""
        for _ in self._pipeline.finish():
            self.save()
            self._note_step()
            yield
        self.save()

    def repaint_all(self) -> Iterator[None]:
        """The last part of it, saving nothing: what is saved once at the end is encoded once."""
        for _ in self._pipeline.repaint_all():
            self._note_step()
            yield

    def repaint_some(self, between: Callable[[], None] | None = None) -> bool:
        """Use spare time to repaint a little, and save it; `between` is called before the save. False if there is nothing to
        do."""
        some = self._pipeline.repaint_some()
        if some:
            if between is not None:
                between()
            self.save()
            self._note_step()
        return some

    def _note_step(self) -> None:
        self._repainted += 1
        if self._repainted % GIVE_BACK_STEPS == 0:
            give_back()

    def save(self) -> float:
        """Write all changes; returns the seconds it took."""
        return self._pipeline.save()

"""A frame's way, the same in every kind of run: accepted, decoded ahead, placed, painted, saved; and the end of a flight.

What differs between runs is where frames come from and whose turn it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from gcs_mosaic.app.pipeline import Done, Pipeline
from gcs_mosaic.app.prefetch import DecodedFrame, UndecodableFrame
from gcs_mosaic.messages import DamagedFile, DroppedFrame, Frame


class Driver:
    """Drives a pipeline."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline

    def accept(self, item: Frame | DamagedFile | DroppedFrame) -> Frame | None:
        """Something has come; returns the frame that is to be processed, as it is kept, None if there is none."""
        match item:
            case Frame():
                return self._pipeline.accept(item)
            case DamagedFile():
                self._pipeline.store.accept_damaged(item)
            case DroppedFrame():
                self._pipeline.store.accept_dropped(item)
        return None

    def process(self, decoded: DecodedFrame | UndecodableFrame, between: Callable[[Done], None] | None = None) -> Done:
        """Place a frame, paint it, and save; `between` is called before that is written."""
        done = self._pipeline.process(decoded)
        if between is not None:
            between(done)
        done.seconds["write"] = self.save()
        return done

    def finish(self) -> Iterator[None]:
        """The flight is over: settle it and paint all, step by step, each saved."""
        for _ in self._pipeline.finish():
            self.save()
            yield
        self.save()

    def save(self) -> float:
        """Write everything that has changed; returns the seconds it took."""
        return self._pipeline.save()

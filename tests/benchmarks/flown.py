"""Frames placed as a flight places them, from their features to the end of the flight, without painting or writing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from gcs_mosaic.stitch.bundle.worker import WorkerProcess
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.placement import Placement, Rejection
from gcs_mosaic.stitch.mapping.second_look import Finer
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from tests.benchmarks.stages import Stages


class Flown:
    """Does with a mosaic what `pipeline.Pipeline` does with it; a context, for the process that adjusts large islands.

    `unplaced`: why frames are not on the map, by name; `troubles`: what adjustments have raised. `stages`: what placing and
    adjusting have cost; an observer makes adjusting a quarter dearer, for it is told what is left over of every match.
    """

    def __init__(self, settings: StitchSettings, observer: Observer | None = None, finer: Finer | None = None) -> None:
        self._worker = WorkerProcess()
        self.mosaic = Mosaic(settings, self._worker, punctual=True, observer=observer, finer=finer)
        self.unplaced: dict[str, str] = {}
        self.troubles: list[str] = []
        self.stages = Stages()

    def __enter__(self) -> Flown:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the process that adjusts."""
        self._worker.close()

    def place(self, name: str, features: Features) -> None:
        """Place a frame and adjust what has grown enough; a frame that raises has changed nothing."""
        try:
            with self.stages.timed("place"):
                outcome = self.mosaic.place(features, name)
        except Exception as error:  # as in the product, one frame must not end the flight
            self.unplaced[name] = f"it could not be processed ({error!r})"
            return
        if isinstance(outcome, Rejection):
            self.unplaced[name] = outcome.reason
        with self._adjusting():
            self.mosaic.adjust()
        self.mosaic.moved()

    def finish(self) -> list[Placement]:
        """The end of a flight: what waits is tried once more, everything adjusted, the rest rejected."""
        with self.stages.timed("place"):
            self.mosaic.retry_waiting()
        while self._connected_some():
            pass
        with self.stages.timed("place"):
            self.mosaic.retry_waiting()
        with self._adjusting():
            self.mosaic.adjust(everything=True)
        self.unplaced |= {rejection.name: rejection.reason for rejection in self.mosaic.finish()}
        return self.mosaic.placements()

    def _connected_some(self) -> bool:
        with self.stages.timed("place"):
            more = self.mosaic.connect_some()
        with self._adjusting():
            self.mosaic.adjust()
        return more

    @contextmanager
    def _adjusting(self) -> Iterator[None]:
        try:
            with self.stages.timed("adjust"):
                yield
        except Exception as error:  # as in the product, a map that cannot be bettered is still a map
            self.troubles.append(repr(error))

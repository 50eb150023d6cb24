"""The output folder of a live flight: guarded, and everything that belongs into it written again if it was lost."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of
from gcs_mosaic.config.tree import Config
from gcs_mosaic.messages import Notice, Topic
from gcs_mosaic.store.durability import Durability
from gcs_mosaic.store.folder import LEDGER_NAME, FlightFolder
from gcs_mosaic.store.guard import FolderGuard, Retaken

logger = logging.getLogger(__name__)

SETTLES_S = (
    2.0  # after which is looked whether the folder still lost files while it was taken again (`rm -r` takes its time)
)
SLOW_S = 3.0  # a sync that takes longer is told: the map is as far behind


class OutputFolder:
    """Keeps the folder of one flight whole. For use by the flight's thread.

    `reopen()` opens again the files that stay open, in a folder that was made anew. `say` receives notices for the operator.
    """

    def __init__(
        self,
        folder: FlightFolder,
        config: Config,
        pipeline: Pipeline,
        reopen: Callable[[], None],
        say: Callable[[Notice], None],
    ) -> None:
        self._config, self._pipeline, self._say = config, pipeline, say
        self._out, self._reopen = folder.path, reopen
        self._guard = FolderGuard(folder.path, folder.lock, pipeline.store.ledger)
        self._durability = Durability(pipeline.store.ledger.make_durable)
        self._taken: Retaken | None = None  # but not everything is written again
        self._look_again: float | None = None  # monotonic time
        self._is_slow = False
        self.is_ours = self._guard.is_ours

    def ensure(self) -> bool:
        """Return at once if the folder is in place; else take it again, write into it what it must hold, and return True.

        Raises CannotWrite, OSError and DiskFull while that is impossible; may be repeated.
        """
        self._taken = self._guard.ensure() or self._taken
        if self._taken is None:
            self._complete()
            return False
        gone = self._write_again() if self._taken.everything else 0
        lost = f"; {gone} originals are gone, and sought in {self._config.watch}" if gone else ""
        what = "everything" if self._taken.everything else LEDGER_NAME
        text = f"{self._out}: {self._taken.what}; {what} is written anew from memory{lost}"
        self._taken = None
        self._say(Notice(source="disk", level="warning", text=text, topic=Topic.DISK))
        return True

    def verify(self) -> None:
        """See that the ledger's file holds the whole flight, and write it anew if not. Raises like `ensure`."""
        self._pipeline.store.ledger.verify()
        self.ensure()

    def report(self) -> None:
        """Tell once of a disk that is slow, or does not take the ledger, and when that is over."""
        slow = self._durability.takes_s > SLOW_S
        if slow and not self._is_slow:
            text = f"the disk of {self._out} is slow, it needs {self._durability.takes_s:.0f} s to write: the map falls behind"
            self._say(Notice(source="disk", level="warning", text=text, topic=Topic.DISK))
        elif self._is_slow and not slow:
            self._say(Notice(source="disk", level="info", text="the disk is as fast as before", topic=Topic.DISK))
        self._is_slow = slow

    def close(self) -> None:
        """Bring the ledger to the disk a last time."""
        self._durability.close()

    def _complete(self) -> None:
        """Some time after the folder was taken again: write anew what was deleted after we had written it."""
        if self._look_again is None or time.monotonic() < self._look_again:
            return
        self._reopen()
        if self._pipeline.store.lacks_files():
            logger.warning("%s: files were deleted after they had been written anew", self._out)
            self._write_again()
        else:
            self._look_again = None

    def _write_again(self) -> int:
        """Returns the number of originals that are gone."""
        self._look_again = time.monotonic() + SETTLES_S
        self._reopen()
        self._pipeline.checkpoint_into(checkpoints_of(self._out, self._config))
        return self._pipeline.store.write_again()

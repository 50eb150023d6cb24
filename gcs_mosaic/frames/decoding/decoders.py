"""Decoding for the whole program: every picture for the first time in a worker process, some at a time."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import cv2
import numpy as np

from gcs_mosaic.frames.decode import Unreadable, bytes_of, counts_instead, decode_whole
from gcs_mosaic.frames.decoding.limits import DecodeSettings, allowance, machine_memory, refusal
from gcs_mosaic.frames.decoding.process import WHAT, DecoderProcess, Job, ProcessEnded
from gcs_mosaic.frames.integrity import MAX_PIXELS, NotWhole, is_whole
from gcs_mosaic.messages import Frame
from gcs_mosaic.processes.keeper import Pauses
from gcs_mosaic.stitch.arrays import Bands

logger = logging.getLogger(__name__)

PROCESSES = 2  # as many as frames are prepared at one time
LONGEST_PAUSE_S = 2.0  # before a process is started again: frames wait for it
STARTING_S = 60.0  # after which a process that cannot be started is given up for a frame
ENDING = Unreadable("the program is ending", passing=True)


class Decoders:
    """Worker processes for pictures. Its methods may be called from any thread.

    A file whose exact bytes have been decoded in a process before, at this size, is decoded where it is asked for: that is
    safe then, and saves a copy. A process that ends is replaced; what it was doing is tried once more if something outside may
    have ended it.
    """

    def __init__(
        self, settings: DecodeSettings | None = None, max_pixels: int = MAX_PIXELS, processes: int = PROCESSES
    ) -> None:
        # Of each tag that libtiff does not know, as of cameras and GDAL, OpenCV would write a line to the operator's terminal.
        # The worker processes go on to say it: what libraries complain of is looked at there.
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
        self._settings, self._max_pixels = settings or DecodeSettings(), max_pixels
        self._memory_bytes = machine_memory()
        self._largest = 0
        self._known: set[tuple[str, int]] = set()  # content hash and reduction of what was decoded in a process
        self._troubles: deque[str] = deque(maxlen=PROCESSES)
        self._closing = threading.Event()
        self._desks = [_Desk(self._closing, self._tell) for _ in range(processes)]
        # Last in, first out: a process that is there is taken before another one is started.
        self._free: queue.LifoQueue[_Desk] = queue.LifoQueue()
        for desk in self._desks:
            self._free.put(desk)

    def begin(self) -> None:
        """Start a process now, which takes some tenths of a second, and not when the first frame is there."""
        with self._desk() as desk:
            desk.begin()

    def load_frame(self, frame: Frame, reduction: int = 1) -> Bands | Unreadable:
        """The frame's pixels as in `frames.decode.decode_image`, from the bytes that were found."""
        data = bytes_of(frame)
        return data if isinstance(data, Unreadable) else self.decode(data, frame.content_hash, reduction)

    def decode(self, data: bytes, content_hash: str, reduction: int = 1) -> Bands | Unreadable:
        """As `frames.decode.decode_image`; `content_hash`: of `data`."""
        whole = is_whole(data, self._max_pixels)
        if isinstance(whole, NotWhole):
            return Unreadable(whole.reason)
        if (content_hash, reduction) in self._known:
            return counts_instead(data, decode_whole(data, whole, reduction, is_proven=True), whole, reduction)
        refused = refusal(whole, self._largest, self._memory_bytes, self._settings)
        if refused is not None:
            return Unreadable(refused, passing=True)
        found = self._decoded(
            Job(data, whole, reduction, allowance(whole, len(data), self._settings), self._settings.wall_s)
        )
        if isinstance(found, np.ndarray):
            self._known.add((content_hash, reduction))
        return found

    def note_true_frame(self, pixels: int) -> None:
        """A frame of this size, with something to be seen on it, is among those of this flight."""
        self._largest = max(self._largest, pixels)

    def take_trouble(self) -> str | None:
        """What the operator should know of the processes, each thing once."""
        try:
            return self._troubles.popleft()
        except IndexError:
            return None

    def close(self) -> None:
        """End the processes; whoever waits for one gets `ENDING`."""
        self._closing.set()
        for desk in self._desks:
            desk.kill()
        for desk in [self._free.get() for _ in self._desks]:
            desk.close()
            self._free.put(desk)

    def _decoded(self, job: Job) -> Bands | Unreadable:
        with self._desk() as desk:
            found = desk.decode(job)
            if isinstance(found, ProcessEnded) and found.from_outside:
                found = desk.decode(job)
            if self._closing.is_set() and not isinstance(found, np.ndarray):
                return ENDING
            if isinstance(found, ProcessEnded):
                return Unreadable(_reason(found, job), passing=found.by_time_limit or found.from_outside)
            return found

    @contextmanager
    def _desk(self) -> Iterator[_Desk]:
        desk = self._free.get()
        try:
            yield desk
        finally:
            self._free.put(desk)

    def _tell(self, ended: ProcessEnded, in_a_row: int) -> None:
        if self._closing.is_set():
            return
        logger.warning("%s has ended (%s), %d in a row", WHAT, ended, in_a_row)
        if in_a_row == 1 and not ended.by_time_limit:
            self._troubles.append(f"{WHAT} has ended ({ended}); it is started again")


class _Desk:
    """The place of one process at a time. For one thread at a time, but for `kill`. `tell(ended, in_a_row)` is called whenever
    a process has ended."""

    def __init__(self, closing: threading.Event, tell: Callable[[ProcessEnded, int], None]) -> None:
        self._closing, self._tell = closing, tell
        self._lock = threading.Lock()  # a process is begun, or all are ended
        self._process: DecoderProcess | None = None
        self._ended_in_a_row = 0
        self._pauses = Pauses(LONGEST_PAUSE_S)

    def decode(self, job: Job) -> Bands | Unreadable | ProcessEnded:
        """By a process that is there, or by a new one."""
        until = time.monotonic() + STARTING_S
        while True:
            found = self._once(job)
            if not isinstance(found, ProcessEnded):
                self._ended_in_a_row = 0
                self._pauses.forget()
                return found
            self._ended_in_a_row += 1
            self._tell(found, self._ended_in_a_row)
            if found.began or self._closing.is_set() or time.monotonic() > until:
                return found

    def kill(self) -> None:
        with self._lock:
            if self._process is not None:
                self._process.kill()

    def close(self) -> None:
        """Release the process; none is started any more."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def _once(self, job: Job) -> Bands | Unreadable | ProcessEnded:
        if self._process is None:
            self._closing.wait(self._pauses.after(0.0))
            self.begin()
        if self._process is None:
            return ProcessEnded(None, began=False)
        found = self._process.decode(job)
        if isinstance(found, ProcessEnded):
            self._process = None
            if self._ended_in_a_row == 0:
                self.begin()  # it takes a moment: not only when the next frame is there
        return found

    def begin(self) -> None:
        """Start a process if there is none; says so in the log if that cannot be done."""
        with self._lock:
            if self._closing.is_set() or self._process is not None:
                return
            try:
                self._process = DecoderProcess()
            except OSError:
                logger.warning("%s cannot be started", WHAT, exc_info=True)


def _reason(ended: ProcessEnded, job: Job) -> str:
    """Why a frame is refused whose process has ended."""
    if ended.by_time_limit:
        return f"needs more than {job.allowed.cpu_s:.3g} s of computing time: damaged, or made to harm"
    if not ended.began:
        return f"could not be decoded: the process for it could not be started ({ended})"
    if ended.from_outside:
        return f"could not be decoded: the process for it was ended twice ({ended})"
    return f"cannot be decoded: the decoder crashed ({ended})"

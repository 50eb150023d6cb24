"""One worker process, as the program sees it."""

from __future__ import annotations

import logging
import signal
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.frames.decode import Unreadable, reduced_shape
from gcs_mosaic.frames.decoding.channel import DecoderChannel, close_file, nameless_file
from gcs_mosaic.frames.decoding.limits import Allowance
from gcs_mosaic.frames.decoding.worker import READY, request_of, work
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.processes.child import ChildProcess, ending
from gcs_mosaic.processes.pipe import Message
from gcs_mosaic.stitch.arrays import Bands

logger = logging.getLogger(__name__)

WHAT = "a process that decodes frames"
KINDS = {"uint8": np.uint8, "uint16": np.uint16}


@dataclass(frozen=True, slots=True)
class Job:
    """A complete file, its header, and what decoding it may cost."""

    data: bytes
    whole: Whole
    reduction: int
    allowed: Allowance
    wall_s: float


@dataclass(frozen=True, slots=True)
class ProcessEnded:
    """The process has ended while it was at work, or before it could begin."""

    exit_code: int | None  # negative: the signal's number; None: it was ended here, after too long a time
    began: bool  # whether it had been ready for work

    @property
    def by_time_limit(self) -> bool:
        """Whether the system ended it, because it had computed for as long as it may."""
        return hasattr(signal, "SIGPROF") and self.exit_code == -signal.SIGPROF

    @property
    def from_outside(self) -> bool:
        """Whether the picture is perhaps not to blame: memory ran out, somebody killed it, the machine stood still."""
        outside = [getattr(signal, name, None) for name in ("SIGKILL", "SIGTERM", "SIGBUS")]
        return self.exit_code is None or not self.began or -self.exit_code in outside

    def __str__(self) -> str:
        return ending(self.exit_code)


class DecoderProcess:
    """A worker process; ready some tenths of a second after it is made. For one thread at a time, but for `kill`."""

    def __init__(self) -> None:
        file = nameless_file()
        try:
            self._child = ChildProcess(WHAT, work, file, shared=() if file is None else (file,))
        except BaseException:
            close_file(file)
            raise
        self._channel = DecoderChannel(self._child.pipe, file)
        self._is_ready = False
        self.pid = self._child.pid

    def decode(self, job: Job) -> Bands | Unreadable | ProcessEnded:
        """The picture, or why there is none. After ProcessEnded this object is of no more use."""
        try:
            found = self._decoded(job)
        except (EOFError, OSError):
            logger.info("%s has ended", WHAT, exc_info=True)
            code = self._child.end()
            self.close()
            return ProcessEnded(code, self._is_ready)
        if found is None:
            logger.warning("%s has brought nothing for %g s", WHAT, job.wall_s)
            self.close()
            return ProcessEnded(None, self._is_ready)
        return found

    def _decoded(self, job: Job) -> Bands | Unreadable | None:
        """None if nothing has come in time."""
        request = request_of(len(job.data), job.whole, job.reduction, job.allowed)
        self._channel.send(request, memoryview(job.data))
        answer = self._answer(job.wall_s)
        if answer == READY:
            self._is_ready = True
            answer = self._answer(job.wall_s)
        return None if answer is None else self._taken(answer, job)

    def _answer(self, wall_s: float) -> Message | None:
        return self._channel.receive() if self._channel.poll(wall_s) else None

    def _taken(self, answer: Message, job: Job) -> Bands | Unreadable:
        if "shape" not in answer:
            logger.info("a picture is refused: %s", answer)
            return Unreadable(str(answer.get("reason", "cannot be decoded")), passing=bool(answer.get("passing")))
        shape, told = reduced_shape(job.whole, job.reduction), str(answer.get("kind"))
        kind = KINDS.get(told)
        counts = *shape[:2], 1  # of a radiometric JPEG
        if answer["shape"] not in (list(shape), list(counts)) or kind is None:
            raise OSError(f"a picture of {answer['shape']} {told} came instead of {shape}")
        image = np.empty(answer["shape"], kind)
        self._channel.fill(image.data.cast("B"))
        return image

    def kill(self) -> None:
        """End it, whatever it is doing; whoever waits for it is told. From any thread."""
        self._child.kill()

    def close(self) -> None:
        """End it, whatever it is doing, and release everything."""
        self.kill()
        self._child.end()
        self._channel.close()

"""One worker process, as the program sees it."""

from __future__ import annotations

import atexit
import contextlib
import logging
import multiprocessing
import signal
from dataclasses import dataclass
from json import JSONDecodeError

import numpy as np

from gcs_mosaic.children import starting
from gcs_mosaic.frames.decode import Unreadable, reduced_shape
from gcs_mosaic.frames.decoding.channel import DecoderChannel, Message, nameless_file
from gcs_mosaic.frames.decoding.limits import Allowance
from gcs_mosaic.frames.decoding.worker import READY, request_of, work
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.stitch.arrays import Bands

logger = logging.getLogger(__name__)

GRACE_S = 1.0  # for a process whose pipe is closed to be gone
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
        if self.exit_code is None:
            return "no answer"
        if self.exit_code >= 0:
            return f"exit code {self.exit_code}"
        names = {one.value: one.name for one in signal.Signals}
        return names.get(-self.exit_code, f"signal {-self.exit_code}")


class DecoderProcess:
    """A worker process; ready some tenths of a second after it is made. For one thread at a time, but for `kill`."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # threads are running: a fork could inherit their locks
        ours, theirs = context.Pipe()
        file = nameless_file()
        self._channel = DecoderChannel(ours, file)
        self._process = context.Process(target=work, args=(DecoderChannel(theirs, file),), name="decode", daemon=True)
        self._is_ready = False
        try:
            with starting():
                self._process.start()
        except BaseException:
            self._channel.close()
            raise
        finally:
            theirs.close()
        self.pid = self._process.pid
        atexit.register(self.kill)  # it does not end on a signal that is for the program

    def decode(self, job: Job) -> Bands | Unreadable | ProcessEnded:
        """The picture, or why there is none. After ProcessEnded this object is of no more use."""
        try:
            found = self._decoded(job)
        except (EOFError, OSError, JSONDecodeError):
            logger.info("a process that decodes has ended", exc_info=True)
            self._process.join(GRACE_S)
            return self._ended(self._process.exitcode)
        if found is None:
            logger.warning("a process that decodes has brought nothing for %g s", job.wall_s)
            return self._ended(None)
        return found

    def _ended(self, exit_code: int | None) -> ProcessEnded:
        began = self._is_ready
        self.close()
        return ProcessEnded(exit_code, began)

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
        shape, kind = reduced_shape(job.whole, job.reduction), KINDS.get(answer["kind"])
        if answer["shape"] != list(shape) or kind is None:
            raise OSError(f"a picture of {answer['shape']} {answer['kind']} came instead of {shape}")
        image = np.empty(shape, kind)
        self._channel.fill(image.data.cast("B"))
        return image

    def kill(self) -> None:
        """End it, whatever it is doing; whoever waits for it is told. From any thread."""
        with contextlib.suppress(ValueError):  # it is closed
            self._process.kill()

    def close(self) -> None:
        """End it and release everything."""
        atexit.unregister(self.kill)
        self._process.kill()
        self._process.join()
        self._process.close()
        self._channel.close()

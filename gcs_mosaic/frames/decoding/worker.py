"""A worker process: files in, pixels out, until the program ends."""

from __future__ import annotations

import contextlib
import os
import signal
import traceback
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.children import outlive_signals
from gcs_mosaic.frames.decode import Unreadable, decode_whole
from gcs_mosaic.frames.decoding.channel import DecoderChannel, Message
from gcs_mosaic.frames.decoding.complaints import Complaints, cut_short
from gcs_mosaic.frames.decoding.limits import Allowance
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.stitch.arrays import Bands

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

_STATM = Path("/proc/self/statm")  # Linux: pages of address space first
READY: Message = {"ready": True}


def request_of(size: int, whole: Whole, reduction: int, allowed: Allowance) -> Message:
    """The message for a file of this many bytes."""
    return {"size": size, "whole": asdict(whole), "reduction": reduction, "allowed": asdict(allowed)}


def work(channel: DecoderChannel) -> None:
    """Main function of the process."""
    begin_as_child()
    cv2.setNumThreads(1)  # there is a process for each picture that is decoded at one time
    complaints = Complaints(channel.descriptors)
    try:
        channel.send(READY)
        while True:
            _serve(channel, complaints)
    except (EOFError, OSError):  # the program has ended
        return


def begin_as_child() -> None:
    """Leave signals for the whole group to the program. No core dump: what reads foreign data is expected to crash."""
    outlive_signals()
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _serve(channel: DecoderChannel, complaints: Complaints) -> None:
    request = channel.receive()
    data = bytearray(request["size"])
    channel.fill(memoryview(data))
    found = _tried(request, bytes(data), complaints)
    if isinstance(found, np.ndarray):
        answer = {"shape": found.shape, "kind": found.dtype.name}
        channel.send(answer, np.ascontiguousarray(found).data.cast("B"))
    else:
        channel.send(found)


def _tried(request: Message, data: bytes, complaints: Complaints) -> Bands | Message:
    """The picture, or why there is none."""
    whole, allowed = Whole(**request["whole"]), Allowance(**request["allowed"])
    try:
        with _limited(allowed):
            found = decode_whole(data, whole, request["reduction"])
            said = complaints.take()
            cut = None if isinstance(found, Unreadable) else cut_short(data, whole, found, said, request["reduction"])
    except MemoryError:
        return {"reason": f"cannot be decoded within {allowed.memory_bytes / 1e9:.1f} GB of memory", "passing": True}
    except Exception as error:  # whatever a library may raise
        return {"reason": f"cannot be decoded ({error!r})", "traceback": traceback.format_exc()}
    if isinstance(found, Unreadable):
        return {"reason": found.reason, "passing": found.passing, "said": said}
    return found if cut is None else {"reason": cut, "said": said}


@contextlib.contextmanager
def _limited(allowed: Allowance) -> Iterator[None]:
    """The system ends this process when it has computed for too long, and refuses it more memory, where systems can."""
    before = limit_memory(allowed.memory_bytes)
    _limit_time(allowed.cpu_s)
    try:
        yield
    finally:
        _limit_time(0.0)
        if before is not None:
            resource.setrlimit(resource.RLIMIT_AS, before)


def _limit_time(cpu_s: float) -> None:
    """In seconds; 0 for no limit."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, cpu_s)


def limit_memory(more_bytes: int) -> tuple[int, int] | None:
    """Refuse this process more memory than so much more; returns the limits to go back to, None if nothing was done."""
    if resource is None or not _STATM.exists():
        return None
    now = int(_STATM.read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    before: tuple[int, int] = resource.getrlimit(resource.RLIMIT_AS)
    if any(limit != resource.RLIM_INFINITY and now + more_bytes > limit for limit in before):
        return None  # the operator's own limit is tighter
    resource.setrlimit(resource.RLIMIT_AS, (now + more_bytes, before[1]))
    return before

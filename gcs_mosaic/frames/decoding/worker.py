"""A worker process: files in, pixels out, until the program ends."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Iterator
from dataclasses import asdict
from multiprocessing.connection import Connection

import cv2
import numpy as np

from gcs_mosaic.frames.decode import Unreadable, counts_instead, decode_whole
from gcs_mosaic.frames.decoding.channel import DecoderChannel
from gcs_mosaic.frames.decoding.complaints import Complaints, cut_short
from gcs_mosaic.frames.decoding.limits import Allowance
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.processes.limits import lift_memory_limit, limit_memory, limit_time
from gcs_mosaic.processes.pipe import Message
from gcs_mosaic.stitch.arrays import Bands

READY: Message = {"ready": True}


def request_of(size: int, whole: Whole, reduction: int, allowed: Allowance) -> Message:
    """The message for a file of this many bytes."""
    return {"size": size, "whole": asdict(whole), "reduction": reduction, "allowed": asdict(allowed)}


def work(pipe: Connection, file: int | None) -> None:
    """Main function of the process; `file`: the descriptor of the nameless one that is shared."""
    channel = DecoderChannel(pipe, file)
    cv2.setNumThreads(1)  # there is a process for each picture that is decoded at one time
    complaints = Complaints()
    try:
        channel.send(READY)
        while True:
            _serve(channel, complaints)
    except (EOFError, OSError):  # the program has ended
        return


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
            found = counts_instead(data, found, whole, request["reduction"])
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
    limit_time(allowed.cpu_s)
    try:
        yield
    finally:
        limit_time(0.0)
        lift_memory_limit(before)

"""The process that reads a recorded video: what FFmpeg does with foreign bytes can end it, but not the flight.

It sends the bytes of a frame's file with the frame's message, and waits while nobody takes them: however much faster it is than
the stitching, only what lies in the pipe is in memory.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path

import cv2

from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.processes.limits import limit_memory, limit_time
from gcs_mosaic.processes.pipe import Message, send

MOST_BYTES = 3 << 30  # of address space: pictures of 8K, and the threads of their decoder
CPU_S = 60.0  # computing time, of all threads, from one picture to the next
TELL_EACH_S = 0.5


def read_video(pipe: Connection, path: str, settings: StreamSettings, max_pixels: int, go_on: object) -> None:
    """Main function of the process. `go_on`: see `extraction.extract`."""
    limit_memory(MOST_BYTES)
    cv2.setNumThreads(1)
    limit_time(CPU_S)
    with suppress(OSError):  # the program has ended, or wants no more
        for message, mass in _messages(Path(path), settings, max_pixels, go_on):
            send(pipe, message, mass)


def describe_videos(pipe: Connection, paths: list[str], max_pixels: int) -> None:
    """Main function of a process that opens one video after another, and tells what it is."""
    limit_memory(MOST_BYTES)
    from gcs_mosaic.frames.video.film import Film  # loads PyAV, which is an extra

    with suppress(OSError):
        for path in paths:
            limit_time(CPU_S)
            film = Film.open(Path(path), max_pixels)
            message = {"refused": film} if isinstance(film, str) else {"described": asdict(film.described)}
            send(pipe, message)
            if not isinstance(film, str):
                film.close()


def _messages(path: Path, settings: StreamSettings, max_pixels: int, go_on: object) -> Iterator[tuple[Message, bytes]]:
    from gcs_mosaic.frames.video.described import Described
    from gcs_mosaic.frames.video.extraction import ChosenPicture, GoOn, Reached, ReadToTheEnd, extract

    av_quiet()
    begun = GoOn(*go_on) if isinstance(go_on, tuple) else None
    next_s = 0.0
    for one in extract(path, settings, max_pixels, begun):
        limit_time(CPU_S)
        match one:
            case str():
                yield {"refused": one}, b""
            case Described():
                yield {"described": asdict(one)}, b""
            case ChosenPicture():
                place = None if one.position is None else asdict(one.position)
                yield {"frame": {"ms": one.ms, "position": place, "told_by": one.told_by, "utc": one.utc}}, one.jpeg
            case Reached() if time.monotonic() >= next_s:
                next_s = time.monotonic() + TELL_EACH_S
                yield {"reached": asdict(one)}, b""
            case ReadToTheEnd():
                yield {"end": asdict(one)}, b""


def av_quiet() -> None:
    """What FFmpeg says of each damaged packet is for nobody."""
    import av.logging

    av.logging.set_level(None)
    logging.disable(logging.WARNING)

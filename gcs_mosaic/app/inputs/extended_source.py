"""Frames of an installed extension, beside the watched folder: whatever goes wrong in it is said, and ends nothing else."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import count
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.extensions import load, trouble
from gcs_mosaic.frames.exif import captured_s
from gcs_mosaic.frames.pending_file import versioned
from gcs_mosaic.mavlink.messages import base_name
from gcs_mosaic.messages import Frame, Notice, content_hash
from gcs_mosaic.store.folder import LEDGER_NAME, FlightFolder
from gcs_mosaic.store.ledger import Ledger

logger = logging.getLogger(__name__)


def extension_frames(told: str, known: dict[str, str | None], stop: threading.Event) -> Iterator[Frame | Notice]:
    """The frames of the source that is told as NAME or NAME:ADDRESS. `known`: content hashes of the flight's frames, by name."""
    name, _, address = told.partition(":")
    try:
        for file, data in load("frame_sources", name)(address, stop):
            if stop.is_set():
                return
            frame = _frame(name, file, data, known)
            if frame is not None:
                known[frame.name] = frame.content_hash
                yield frame
        yield Notice(source="frames", level="info", text=f"the frame source {name!r} has no more frames")
    except UsageError as error:
        yield Notice(source="frames", level="error", text=f"{error}; the flight goes on without it")
    except (Exception, SystemExit) as error:  # the second would end this thread without a word
        logger.exception("the frame source %s has failed", name)
        text = trouble("frame_sources", name, "has failed", error)
        yield Notice(source="frames", level="error", text=f"{text}; the flight goes on without it")


def known_frames(folder: FlightFolder) -> dict[str, str | None]:
    """What a resumed flight has already."""
    if not folder.resumed:
        return {}
    with closing(Ledger(folder.path / LEDGER_NAME, read_only=True)) as ledger:
        return {frame.name: frame.content_hash for frame in ledger.frames()}


def _frame(source: str, file: str, data: bytes, known: dict[str, str | None]) -> Frame | None:
    """A frame of what an extension has yielded; None for one that the flight has by this name. Raises TypeError.

    It is called SOURCE//FILE: two slashes are in no name of a watched folder's file, so that neither is taken for the other.
    """
    if not isinstance(file, str) or not isinstance(data, bytes):
        raise TypeError(f"expected name and bytes, got {type(file).__name__} and {type(data).__name__}")
    content = content_hash(data)
    first = f"{source.replace('/', '-')}//{base_name(file.replace('#', '-')) or 'frame'}"
    for version in count(1):
        unused = versioned(first, version)
        if known.get(unused) == content:
            return None
        if unused not in known:
            break
    return Frame(
        name=unused,
        path=Path(unused),
        content_hash=content,
        size=len(data),
        received=time.monotonic(),
        modified=time.time(),
        captured=captured_s(data),
        data=data,
    )

"""Files that are written again while the flight goes on: the same picture in new bytes is the same frame."""

from __future__ import annotations

from dataclasses import replace
from hashlib import blake2b

import numpy as np

from gcs_mosaic.app.waiting.prefetch import DecodedFrame
from gcs_mosaic.frames.pending_file import file_and_version, versioned
from gcs_mosaic.frames.picture_hash import picture_hash
from gcs_mosaic.messages import Frame
from gcs_mosaic.store.flight_store import FlightStore
from gcs_mosaic.store.ledger import Ledger

PREVIEW = "preview"  # what it is to its shot, in the ledger


def taken_as_rewritten(store: FlightStore, frame: Frame) -> bool:
    """Whether `frame` is the picture that its file held before, as where a program has written tags into it: then its bytes are
    that frame's original from now on, and it is no frame of its own."""
    name = None if frame.earlier is None else store.known_as(frame.earlier)
    if name is None or frame.picture is None:
        return False
    same = store.has_picture(name, frame.picture)
    if same is None:
        original = store.original(name)
        same = original is not None and picture_hash(original) == frame.picture
    if same:
        store.take_new_bytes(frame, name)
    return same


class SeenPictures:
    """What decoded frames look like, to know one again that was encoded anew without loss (an optimised JPEG, another PNG)."""

    def __init__(self) -> None:
        self._digests: dict[str, bytes] = {}  # by frame name

    def is_again(self, prepared: DecodedFrame) -> bool:
        """Whether the file held the very same pixels before."""
        frame, image = prepared.frame, prepared.image
        thumbnail = np.ascontiguousarray(
            prepared.thumbnail
        )  # of thousands of means: two photographs never have the same
        digest = blake2b(repr(image.shape).encode() + thumbnail.tobytes(), digest_size=16).digest()
        self._digests[frame.name] = digest
        return frame.earlier is not None and self._digests.get(frame.earlier) == digest


def previews_of(ledger: Ledger) -> list[tuple[str, str]]:
    """Each preview of a flight and the frame of its whole picture, which is what the same file held next."""
    names = [name for name, what in ledger.other_files() if what == PREVIEW]
    return [(name, versioned(file, version + 1)) for name in names for file, version in [file_and_version(name)]]


def as_whole_of_damaged(store: FlightStore, frame: Frame) -> Frame:
    """The same frame, told to be the rest of what its file held before, if that could not be decoded: an upload went on."""
    if frame.earlier is not None and store.was_unreadable(frame.earlier):
        return replace(frame, is_whole_of_earlier=True)
    return frame

"""Originals to pixels for whoever looks: hash and header first, then in a process with the limits of a flight's decoders.

The folder may be a stranger's, and whoever asks may ask for each of its files: nothing is decoded that is not what the ledger
says, and what decoding costs is refused, or ends that process, before it costs the page its memory or its answers.
"""

from __future__ import annotations

from functools import cache

from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.store import inside
from gcs_mosaic.store.originals import original_bytes, place_of
from gcs_mosaic.store.records import FrameRecord
from gcs_mosaic.views.flight_view import FlightView

MOST_REDUCTION = 4


def original_pixels(view: FlightView, record: FrameRecord, reduction: int) -> Bands | Unreadable:
    """The pixels (h, w, bands) of a frame's original, reduced 1, 2 or 4 times."""
    data = original_bytes(view.root, record)
    if data is None or record.content_hash is None:
        return Unreadable("its original is not what came", passing=_is_away(view, record))
    whole = is_whole(data)
    if isinstance(whole, NotWhole):
        return Unreadable(whole.reason)
    if not _is_as_told((whole.width, whole.height), (record.width or 0, record.height or 0)):
        return Unreadable(f"it has {whole.width} x {whole.height} pixels, the ledger says otherwise")
    decoders = _decoders()
    decoders.note_true_frame(_usual_pixels(view))
    return decoders.decode(data, record.content_hash, reduction)


def _is_away(view: FlightView, record: FrameRecord) -> bool:
    path = place_of(view.root, record.original or "")
    return path is not None and not inside.is_file(path, view.root)


def _is_as_told(size: tuple[int, int], told: tuple[int, int]) -> bool:
    """Whether a picture has the size that the ledger says: that of a reduced one, rounded up, times its reduction."""
    return all(abs(one - other) < MOST_REDUCTION for one, other in zip(size, told, strict=True))


def get_ready() -> None:
    """Start the process now: somebody is about to ask for an original."""
    _decoders().begin()


@cache
def _decoders() -> Decoders:
    return Decoders(processes=1)


def _usual_pixels(view: FlightView) -> int:
    """Of the frames that are painted: the middle one by size."""
    sizes = sorted(one.camera.width * one.camera.height for one in view.table().frames)
    return sizes[len(sizes) // 2] if sizes else 0
